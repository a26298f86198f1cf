"""Entries that are admissible each by itself, and together a slip of a unit: what is named, and what is not."""

from __future__ import annotations

import pytest

import stagectl as sc
from stagectl.config.source import ConfigError
from stagectl.config.stage_checks import doubtful
from stagectl.config.stage_file import load_stage
from stagectl.problem import ProblemKind
from tests.conftest import CONFIG
from tests.problems import refused

STAGE = CONFIG / "ball-screw.yaml"


@pytest.mark.parametrize(
    ("right", "wrong", "named"),
    [
        ("limits:", "limits:\n  deceleration: 1 um/s^2", "limits.deceleration"),
        ("ion: 5 m/s^2\n    reset", "ion: 5 mm/s^2\n    reset", "drive.wire.quick_stop_deceleration"),
        ("inertia: 0.010 kg", "inertia: 10 kg", "mechanics.inertia"),
        ("speed: 300 mm", "speed: 300 m", "limits.speed and limits.travel"),
    ],
)
def test_what_cannot_stop_the_axis_within_its_travel_is_named_alone(right: str, wrong: str, named: str) -> None:
    text = STAGE.read_text()
    assert not doubtful(load_stage(STAGE).file) and right in text
    _, _, suspects = doubtful(load_stage(STAGE, text=text.replace(right, wrong)).file).partition("check ")
    others = {"limits.deceleration", "quick_stop_deceleration", "mechanics.inertia"} - {
        named.removeprefix("drive.wire.")
    }
    assert named in suspects and not any(other in suspects for other in others)


def test_a_travel_given_in_the_motors_unit_is_noted() -> None:
    """A tenth of a radian at the motor is a fifth of a millimetre of travel: no speed is reached there."""
    stage = sc.load_stage(STAGE)
    assert not any("limits.travel" in note for note in stage.sheet().notes)
    short = stage.changed({"limits.travel": [-0.15, 0.15]})
    assert any("limits.travel" in note for note in short.sheet().notes)
    right = stage.changed({"limits.travel": ["-40 mm", "40 mm"]})
    assert right.setup.file.limits.travel == pytest.approx((-20.943951, 20.943951))


@pytest.mark.parametrize(
    ("right", "wrong", "fields"),
    [
        ("viscous: 0.14 N", "viscous: 140 N", {"key": "mechanics.viscous", "kind": ProblemKind.CONFLICT}),
        (
            "mechanics:",
            "mechanics:\n  cogging: 5 N m",
            {"remedy": "did you mean motor.cogging?"},
        ),
        ("revolution: 1048576", "revolution: 20", {"key": "limits.following_error", "kind": ProblemKind.CONFLICT}),
    ],
)
def test_the_entry_that_is_wrong_is_named(right: str, wrong: str, fields: dict[str, object]) -> None:
    with refused(ConfigError, **fields):
        load_stage(STAGE, text=STAGE.read_text().replace(right, wrong))


def test_a_number_without_its_unit_is_told_which() -> None:
    with refused(ConfigError, kind=ProblemKind.UNIT, remedy="write '0.02 kg m^2', or the number 0.02"):
        sc.load_stage(STAGE).changed({"mechanics.inertia": "0.02"})
