"""The gap closed on a simulated machine: what is found is applied and measured, and what is worse is not kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from stagectl.api.gap_closing import close_gap
from stagectl.config.stage_file import load_stage
from stagectl.gap.experiment_design.battery import battery as whole_battery
from stagectl.gap.experiment_design.battery import held_out as whole_held_out
from stagectl.gap.experiment_design.experiment import Experiment
from stagectl.gap.experiment_design.unseen import unseen
from stagectl.plan import plan
from stagectl.workflows import gap_closing
from tests.conftest import CONFIG

STAGE = CONFIG / "ball-screw.yaml"
FEW = ("sine-slow", "sine-fast", "stairs", "check-sine-slow", "check-stairs")


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A battery of the motions that show the asymmetry; the whole one takes a minute."""

    def few(experiments: tuple[Experiment, ...]) -> tuple[Experiment, ...]:
        return tuple(experiment for experiment in experiments if experiment.name in FEW)

    monkeypatch.setattr(gap_closing, "battery", lambda setup: few(whole_battery(setup)))
    monkeypatch.setattr(gap_closing, "held_out", lambda setup: few(whole_held_out(setup)))


def machine(folder: Path) -> Path:
    """The stage with an asymmetry of its viscous friction, and noise."""
    text = STAGE.read_text(encoding="utf-8")
    viscous, noise = "  viscous: 0.14 N m s/rad\n", "simulation:\n"
    assert viscous in text and noise in text
    text = text.replace(viscous, f"{viscous}  viscous_asymmetry: 0.2\n").replace(
        noise, f"{noise}  current_noise: 20 mA\n"
    )
    (folder / "drives").symlink_to(CONFIG / "drives")
    path = folder / "machine.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.usefixtures("short")
def test_an_asymmetry_is_found_applied_and_worth_what_it_takes(tmp_path: Path) -> None:
    closed = close_gap(STAGE, plant=machine(tmp_path), rounds=1, folder=tmp_path / "closed")
    (only,) = closed.result["rounds"]
    assert "viscous_asymmetry" in only["found"] and only["kept"] and only["foretold"] > 0.9
    levels = closed.result["levels"]
    assert levels["after"] < 0.4 * levels["before"]
    assert closed.result["shares"]["viscous_asymmetry"] == pytest.approx(1.0, abs=0.1)
    model = load_stage(closed.model)
    assert model.stage.mechanics.viscous_asymmetry == pytest.approx(0.2, abs=0.02)
    assert (tmp_path / "closed" / "stage-0.yaml").read_text() == STAGE.read_text()  # the way back
    page = closed.page()
    assert len(page.figures) == 1 and len(closed.sheet().tables[0].rows) == 9


@pytest.mark.usefixtures("short")
def test_a_model_that_makes_the_error_larger_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    errors = measured([1e-6] * 3, [2e-6, 2.1e-6, 1.9e-6])
    monkeypatch.setattr(gap_closing, "_compared", lambda *_: errors)
    closed = close_gap(STAGE, plant=machine(tmp_path), rounds=3, folder=tmp_path / "closed")
    assert closed.result["rounds"] == [] and closed.model == tmp_path / "closed" / "stage-0.yaml"


def measured(before: list[float], after: list[float]) -> dict[str, dict[str, dict[str, dict[str, list[float]]]]]:
    """Rms errors (m) of the repeats of one motion."""
    return {"motion": {name: {"rms": {"values": values}} for name, values in (("before", before), ("after", after))}}


def test_an_error_counts_as_smaller_beyond_what_its_repeats_vary_by() -> None:
    assert gap_closing._smaller(measured([2e-6, 2.1e-6, 1.9e-6], [1e-6, 1.1e-6, 1.05e-6]))
    assert not gap_closing._smaller(measured([2e-6, 2.1e-6, 1.9e-6], [1.9e-6, 2.2e-6, 1.7e-6]))  # by chance
    assert gap_closing._smaller(measured([2e-6] * 3, [1.9e-6] * 3))  # nothing varies: no noise to be seen
    assert not gap_closing._smaller(measured([1.9e-6] * 3, [2e-6] * 3))


def test_the_motions_are_within_the_limits_of_every_stage() -> None:
    for name in ("ball-screw", "linear-slider"):
        setup = load_stage(CONFIG / f"{name}.yaml")
        motions = unseen(setup)
        assert len({motion.name for motion in motions}) == 3
        for motion in motions:
            plan(setup, motion.trajectory, setup.controller.feedforward)
            assert 1.0 < motion.duration < 12.0
