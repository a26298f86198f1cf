"""Other gains, another origin: the current does not jump."""

from __future__ import annotations

import math

import pytest

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage
from stagectl.kernels import law
from stagectl.realtime.bumpless_transfer import flattened, rebuilt, shifted, transferred
from tests.conftest import CONFIG


def loaded(p: law.Law) -> tuple[law.State, law.Setpoint]:
    """A law some way into a motion with an error."""
    x = law.AT_REST
    for k in range(50):
        asked = law.Setpoint(0.01 * k, 0.01 * k, 0.1, 0.2, 0.01)
        _, x = law.step(p, x, asked, 0.01 * k - 1e-4 * math.sin(0.3 * k))
    return x, asked


def laws() -> dict[str, law.Law]:
    screw = load_stage(CONFIG / "ball-screw.yaml")
    slider = load_stage(CONFIG / "linear-slider.yaml")
    wide, p = screw.file.control, screw.stage
    assert isinstance(wide, design.Control)
    slow = design.design(p, wide._replace(bandwidth=20.0)).law
    watched = wide._replace(bandwidth=20.0, layers=("ptc", "friction", "observer"))
    return {
        "pid": design.design(p, wide).law,
        "slow": slow,
        "observed": design.design(p, watched).law,
        "cascade": design.design(slider.stage, slider.file.control).law._replace(current_limit=1e6),
    }


LAWS = laws()


@pytest.mark.parametrize("new", LAWS)
@pytest.mark.parametrize("old", LAWS)
def test_the_command_goes_on_where_it_was(old: str, new: str) -> None:
    x, asked = loaded(LAWS[old])
    measured = asked.reference - 2e-4
    before, _ = law.step(LAWS[old], x, asked, measured)
    after, _ = law.step(LAWS[new], transferred(LAWS[old], LAWS[new], x, asked, measured), asked, measured)
    assert after.command == pytest.approx(before.command, rel=1e-9, abs=1e-9)
    jump, _ = law.step(LAWS[new], law.AT_REST, asked, measured)
    assert abs(jump.command - before.command) > 1e-3  # without it, there is something to be avoided


def test_the_same_law_keeps_its_state() -> None:
    x, asked = loaded(LAWS["pid"])
    kept = transferred(LAWS["pid"], LAWS["pid"], x, asked, asked.reference)
    assert kept.feedback == pytest.approx(x.feedback)


@pytest.mark.parametrize("name", LAWS)
def test_another_origin_is_not_noticed(name: str) -> None:
    x, asked = loaded(LAWS[name])
    measured = asked.reference - 2e-4
    before, _ = law.step(LAWS[name], x, asked, measured)
    moved = asked._replace(reference=asked.reference - 3.0, target=asked.target - 3.0)
    after, _ = law.step(LAWS[name], shifted(x, 3.0), moved, measured - 3.0)
    assert after.command == pytest.approx(before.command, rel=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_a_law_survives_as_numbers(name: str, ball_screw: Setup) -> None:
    p = LAWS[name]
    assert rebuilt(LAWS["pid"], iter(tuple(flattened(p)))) == p
    assert isinstance(rebuilt(p, iter(tuple(flattened(p)))).observer.delay, int)
