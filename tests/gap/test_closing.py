"""The gap closed on a simulated machine: what is found is applied and measured, and what is worse is not kept."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.api.arguments import reported
from stagectl.api.gap_closing import GapClosing, close_gap
from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.experiment_design.battery import battery
from stagectl.gap.experiment_design.unseen import judged, unseen
from stagectl.plan import plan
from stagectl.recording.hdf5 import open_recording
from stagectl.service.single_motion import Motion
from stagectl.simulation import simulate
from stagectl.workflows import campaign, closing_errors, closing_patch, gap_closing
from stagectl.workflows.motion import prepare
from stagectl.workflows.trials import Machine, Shown, run_once
from tests.conftest import CONFIG
from tests.short_battery import shorten

STAGE = CONFIG / "ball-screw.yaml"


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    shorten(monkeypatch, "sine-slow", "stairs", "check-sine-slow")


def machine(folder: Path) -> Path:
    """The stage with an asymmetry of its viscous friction, cogging, and noise."""
    text = STAGE.read_text(encoding="utf-8").replace("motor:\n", "motor:\n  cogging: {amplitude: 30 mN m, order: 4}\n")
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
def test_effects_are_found_applied_and_worth_what_they_take(tmp_path: Path) -> None:
    closed = close_gap(STAGE, plant=machine(tmp_path), rounds=1, folder=tmp_path / "closed")
    (done,) = closed.result["rounds"]
    assert {"viscous_asymmetry", "cogging"} <= set(done["found"]) and done["kept"] and done["foretold"] > 0.6
    levels, shares = closed.result["levels"], closed.result["shares"]
    assert levels["after"] < 0.3 * levels["before"]
    assert shares["viscous_asymmetry"] == pytest.approx(0.83, abs=0.1) and shares["cogging"] > 0.1
    model = load_stage(closed.model)
    assert model.stage.mechanics.viscous_asymmetry == pytest.approx(0.2, abs=0.02)
    assert model.stage.motor.cogging.amplitude == pytest.approx(0.03, abs=0.003)
    assert (tmp_path / "closed" / "stage-0.yaml").read_text() == STAGE.read_text()  # the way back
    page = closed.page()
    assert len(page.figures) == 1 and len(closed.sheet().tables[0].rows) == 12


def closed_without_a_diagnosis(folder: Path, patch: pytest.MonkeyPatch, errors: dict[str, Any]) -> GapClosing:
    """Whatever the diagnosis says; `errors` that are measured, by the folder that they are recorded in."""
    found = SimpleNamespace(
        named=(SimpleNamespace(name="cogging"),), sentence="Cogging.", blocks={}, coordinates=(),
        gap=SimpleNamespace(closure=0.9),
    )  # fmt: skip
    change = SimpleNamespace(changes=("cogging",), after=STAGE.read_text(encoding="utf-8"))
    patch.setattr(gap_closing, "_recorded", lambda closing, *_: closing)
    patch.setattr(gap_closing, "_diagnosed", lambda *_: (SimpleNamespace(result=found), None))
    patch.setattr(closing_patch, "patch_of", lambda *_: change)
    patch.setattr(gap_closing, "_compared", lambda _, __, place, *___: errors[place.name])
    return close_gap(STAGE, plant=machine(folder), rounds=3, folder=folder / "closed")


def test_a_model_that_makes_the_error_larger_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    larger = measured([1e-6] * 3, [2e-6, 2.1e-6, 1.9e-6])
    closed = closed_without_a_diagnosis(tmp_path, monkeypatch, {"compared": larger})
    assert closed.result["rounds"] == [] and closed.model == tmp_path / "closed" / "stage-0.yaml"
    assert "2 times" in closed.result["ended"]


def test_a_model_that_was_smaller_by_chance_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the runs that decided it was; those that judge it at the end are others."""
    judged = measured([1e-6] * 3, [1.02e-6] * 3)
    judged["motion"]["without cogging"] = judged["motion"]["after"]
    errors = {"compared": measured([1e-6] * 3, [9e-7] * 3)} | {f"judged-{k}": judged for k in (1, 2, 3)}
    closed = closed_without_a_diagnosis(tmp_path, monkeypatch, errors)
    assert closed.result["rounds"] == [] and closed.model == tmp_path / "closed" / "stage-0.yaml"
    assert "repeats vary" in closed.result["ended"]


def measured(before: list[float], after: list[float]) -> dict[str, dict[str, Any]]:
    """Rms errors (m) of the repeats of one motion."""
    return {"motion": variants(before, after)}


def variants(before: list[float], after: list[float]) -> dict[str, Any]:
    """Of one motion: rms errors (m) of its repeats before and after; peaks are three times as large."""
    pairs = (("before", before), ("after", after))
    peaks = {"before": [3.0 * x for x in before], "after": [3.0 * x for x in after]}
    return {name: {"rms": {"values": x, "mean": sum(x) / len(x)}, "peak": {"values": peaks[name]}} for name, x in pairs}


def test_an_error_counts_as_smaller_beyond_what_its_repeats_vary_by() -> None:
    assert closing_errors.smaller(measured([2e-6, 2.1e-6, 1.9e-6], [1e-6, 1.1e-6, 1.05e-6]))
    assert not closing_errors.smaller(measured([2e-6, 2.1e-6, 1.9e-6], [1.9e-6, 2.2e-6, 1.7e-6]))  # by chance
    assert closing_errors.smaller(measured([2e-6] * 3, [1.9e-6] * 3))  # nothing varies: no noise to be seen
    assert not closing_errors.smaller(measured([1.9e-6] * 3, [2e-6] * 3))


def test_motions_that_gain_differently_are_no_chance() -> None:
    """Two repeats of three motions, as a machine with a compliance gave them: each of them is better."""
    errors = {
        "sine": variants([1212e-9, 804e-9], [837e-9, 620e-9]),
        "stop and go": variants([2465e-9, 2144e-9], [2295e-9, 2084e-9]),
        "strokes": variants([1218e-9, 888e-9], [941e-9, 775e-9]),
    }
    assert closing_errors.smaller(errors) and closing_errors.refusal(errors) == ""
    assert "repeats vary" in closing_errors.refusal({**errors, "sine": variants([8e-7, 9e-7], [9e-7, 8e-7])})
    assert "sine" in closing_errors.refusal({**errors, "sine": variants([8e-7, 8e-7], [9e-7, 9e-7])})


def test_a_peak_that_grows_in_every_repeat_is_not_kept() -> None:
    errors = measured([2e-6, 2.1e-6], [1e-6, 1.1e-6])
    peaks = errors["motion"]["after"]["peak"]
    peaks["values"] = [9e-6, 5e-6]  # one by chance: the other one is smaller than before
    assert closing_errors.refusal(errors) == ""
    peaks["values"] = [9e-6, 9e-6]
    assert "largest error of all motions was 1.4 times" in closing_errors.refusal(errors)
    larger = variants([3e-6, 3.1e-6], [2e-6, 2.1e-6])  # another motion that errs more, before and after
    assert closing_errors.refusal({**errors, "strokes": larger}) == ""


@pytest.mark.parametrize(("repeats", "motions"), [(2, 3), (3, 3), (2, 1)])
def test_chance_is_taken_for_a_gain_as_rarely_as_stated(repeats: int, motions: int) -> None:
    source, tried = np.random.default_rng(1), 4000
    draws = np.exp(0.1 * source.standard_normal((tried, motions, 2, repeats)))
    taken = sum(
        closing_errors.smaller({str(k): variants(*pair.tolist()) for k, pair in enumerate(draw)}) for draw in draws
    )
    assert 0.018 < taken / tried < 0.032  # one-sided 2.5 %


def test_the_motions_are_within_the_limits_of_every_stage() -> None:
    for name in ("ball-screw", "linear-slider"):
        setup = load_stage(CONFIG / f"{name}.yaml")
        motions = unseen(setup)
        assert len({motion.name for motion in motions}) == 3
        for motion in motions:
            plan(setup, motion.trajectory, setup.controller.feedforward)
            assert 1.0 < motion.duration < 12.0
            begin, end = judged(motion)  # behind the reversal that loads the friction
            assert 0.1 < begin < 1.0 and motion.duration - 0.2 < end < motion.duration


def test_an_exact_model_leaves_two_counts_on_each_of_them(ball_screw: Setup) -> None:
    """The first period asks for nothing that the delay forbids: that would be the largest error of any good model."""
    p = ball_screw.controller
    for motion in unseen(ball_screw):
        rows = simulate(ball_screw, plan(ball_screw, motion.trajectory, p.feedforward), p.law)
        assert np.abs(rows["error"]).max() <= 2.0 * ball_screw.stage.encoder.step, motion.name


def test_an_effect_that_is_dropped_is_named_in_the_new_stage_file(tmp_path: Path) -> None:
    setup = load_stage(STAGE)
    closing = gap_closing.Closing(Machine(setup, True, None), tmp_path, 1, 1)
    model = closing.version(1)
    model.write_text(STAGE.read_text(encoding="utf-8"), encoding="utf-8")
    dropped = gap_closing._unanswered(closing, model, ("cogging", "backlash", "stribeck"))
    assert closing.setup(dropped).file.control.unanswered == (
        "motor.cogging",
        "mechanics.transmission",
        "friction.stribeck",
        "friction.bristle.stribeck",
    )
    assert closing.setup(model).file.control.unanswered == ()


def test_a_model_that_is_not_kept_is_sought_again_without_its_effects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not kept with cogging and its parameters, kept with the parameters alone, and then nothing is left."""
    better, worse = measured([2e-6] * 3, [1e-6] * 3), measured([1e-6] * 3, [2e-6] * 3)
    course = {(): (("cogging", "viscous"), worse), ("cogging",): (("viscous",), better)}
    asked: list[tuple[str, ...]] = []

    def told(_: Any, stage: Path, number: int, struck: tuple[str, ...], __: Any) -> gap_closing.Round | str:
        asked.append(struck)
        if number == 3:
            return "nothing is left"
        found, errors = course[struck]
        return gap_closing.Round(stage, found, "", "", 0.9, errors, errors is better)

    monkeypatch.setattr(gap_closing, "_round", told)
    closing = gap_closing.Closing(Machine(load_stage(STAGE), True, None), tmp_path, 3, 1)
    rounds, ended = gap_closing._rounds(closing, closing.version(0), SimpleNamespace())  # type: ignore[arg-type]
    assert [done.kept for done in rounds] == [False, True]
    assert asked == [(), ("cogging",), ("cogging",)] and ended == "without cogging: nothing is left"


def test_runs_take_place_elsewhere(tmp_path: Path) -> None:
    """Each run of a campaign begins where it says, those that are compared at the end of the session."""
    setup, begun = load_stage(STAGE), []

    def elsewhere(motion: Motion, start: float) -> Any:
        begun.append(start)
        return simulate(motion.setup, motion.plan, motion.law)

    machine, shown = Machine(setup, True, None, 70.0, elsewhere), Shown(lambda _: None, partial(reported, False))
    runs = campaign.chosen(battery(setup), ["sine-strong"], [])
    campaign.record(campaign.planned(machine, runs, 2, tmp_path, 1), shown)
    motion = prepare(setup, tmp_path / "trajectories" / "sine-strong.yaml", frozenset(), tmp_path / "again.h5")
    run_once(machine, motion, lambda *_: None)
    assert begun[0] == 0.0 and begun[1] > motion.plan.duration and begun[2] == 70.0
    one, other = (open_recording(tmp_path / name).samples for name in ("sine-strong-1.h5", "again.h5"))
    assert one.tobytes() == other.tobytes()
