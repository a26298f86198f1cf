"""The twin over simulated runs whose machine is not the model: what it names, and when it keeps silent."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage
from stagectl.kernels import rollout
from stagectl.recording.metadata import portable
from stagectl.recording.ring import Ring
from stagectl.trajectories import Sine
from stagectl.twin import estimate, live_model
from stagectl.twin.process import RingFollower, restored
from stagectl.twin.record import form, residuals, verdict, words
from stagectl.twin.start import companion
from stagectl.twin.thresholds import SAME_COMMAND
from tests.conftest import CONFIG
from tests.twin.live import beside, dahl, followed, machine, names, rows_of, seen

ABOUT = {"kind": "rotary", "limit": SAME_COMMAND}
OFF = [  # what the machine is off by, and how far the twin may be from it
    ({"viscous": 0.14 * 1.2}, "viscous", 0.2, 0.005),
    ({"viscous": 0.14 * 0.92}, "viscous", -0.08, 0.005),
    ({"inertia": 0.01 * 1.1}, "inertia", 0.1, 0.005),
    ({"coulomb": 1.15}, "coulomb", 0.15, 0.01),
    ({"bias": 0.1}, "bias", 0.1, 0.01),
    ({"force_constant": 0.72 * 0.95}, "force_constant", -0.05, 0.005),
]


@pytest.mark.parametrize(("changes", "name", "size", "within"), OFF)
def test_one_parameter_that_is_off_is_named_with_its_size(
    ball_screw: Setup, changes: dict[str, Any], name: str, size: float, within: float
) -> None:
    status = seen(ball_screw, machine(ball_screw, **changes))
    assert names(status) == [name]
    drift = status.named[0].drift
    assert drift.size == pytest.approx(size, abs=within)
    assert abs(drift.size - size) < 5.0 * drift.error + 2e-3
    assert status.controller == 0.0
    assert verdict(status, SAME_COMMAND) == "effects"
    assert f"{name} {100 * drift.size:+.3g} %" in words(status, ABOUT)


def test_two_at_once_are_both_named_the_larger_first(ball_screw: Setup) -> None:
    status = seen(ball_screw, machine(ball_screw, viscous=0.14 * 1.2, inertia=0.0095))
    assert names(status) == ["viscous", "inertia"]
    assert [named.drift.size for named in status.named] == pytest.approx([0.2, -0.05], abs=0.005)


@pytest.mark.parametrize(("noise", "seed"), [(0.0, 1), (0.045, 2)])
def test_a_machine_that_is_the_model_is_silent(ball_screw: Setup, noise: float, seed: int) -> None:
    status = seen(ball_screw, machine(ball_screw, noise, seed))
    assert names(status) == []
    assert verdict(status, SAME_COMMAND) == "none"
    assert words(status, ABOUT).startswith("silent")
    fit = status.mechanics_fit
    assert fit is not None
    for drift in fit.drifts:
        assert abs(drift.size) < max(5.0 * drift.error, 1e-3), drift.candidate.name
    assert form(status) == ""
    assert status.mechanics < 0.01  # N m, of 1 N m of friction


def test_another_friction_law_is_no_effect_but_is_said(ball_screw: Setup) -> None:
    """Dahl's curve against Maxwell's elements: the same friction at speed, 4 um of another way into it."""
    status = seen(ball_screw, machine(ball_screw, 0.0, friction=dahl(4e-6 * 2.0 * math.pi / 0.012)))
    assert names(status) == []
    assert form(status) != ""
    fit = status.mechanics_fit
    assert fit is not None
    assert all(
        abs(drift.size) < 0.01 for drift in fit.drifts if drift.candidate.name in ("inertia", "viscous", "coulomb")
    )


@pytest.mark.parametrize(
    ("file", "motion"),
    [("linear-slider", Sine(0.01, 0.5, 2.0, 0.5)), ("emps", Sine(0.02, 0.5, 2.0, 0.5))],
)
def test_other_machines(file: str, motion: Sine) -> None:
    """A linear axis under a cascade; noise that shakes the axis is no inertia; EMPS runs at 1 kHz."""
    setup = load_stage(CONFIG / f"{file}.yaml")
    p = beside(setup)
    silent = estimate.status_of(p, followed(p, rows_of(setup, machine(setup, 0.02), motion)))
    assert names(silent) == []
    assert silent.controller == 0.0
    heavier = machine(setup, 0.02, inertia=1.15 * setup.stage.mechanics.inertia)
    status = estimate.status_of(p, followed(p, rows_of(setup, heavier, motion)))
    assert names(status) == ["inertia"]
    assert status.named[0].drift.size == pytest.approx(0.15, abs=0.03)


def test_a_drive_that_gives_more_than_it_is_told(ball_screw: Setup) -> None:
    rows = rows_of(ball_screw, machine(ball_screw))
    at = rollout.COLUMNS.index("measured_current")
    rows[:, at] = 1.02 * rows[:, at] + 0.06
    p = beside(ball_screw)
    status = estimate.status_of(p, followed(p, rows))
    fit = status.drive_fit
    assert fit is not None
    values = {drift.candidate.name: drift.value for drift in fit.drifts}
    assert values == pytest.approx({"current_gain": 0.02, "current_offset": 0.06, "dead_time": 0.0}, abs=1e-3)
    named = {named_drift.drift.candidate.name: named_drift.alternatives for named_drift in fit.named}
    assert named == {"current_gain": ("force_constant",), "current_offset": ("bias",)}


def test_a_slower_current_loop_shows_in_the_drive(ball_screw: Setup) -> None:
    """0.159 ms more of lag; a first-order lag is as late at low frequency as a delay of its time constant."""
    status = seen(ball_screw, machine(ball_screw, 0.0, current_lag=2.0 * 0.159e-3))
    assert names(status) == ["dead_time"]
    assert 0.08e-3 < status.named[0].drift.value < 0.17e-3
    assert residuals(status)["drive"] == pytest.approx(0.0096, rel=0.2)


def test_without_a_measured_current_the_drive_is_not_judged(ball_screw: Setup) -> None:
    rows = rows_of(ball_screw, machine(ball_screw, viscous=0.14 * 1.2))
    rows[:, rollout.COLUMNS.index("measured_current")] = math.nan
    p = beside(ball_screw)
    status = estimate.status_of(p, followed(p, rows))
    assert (status.drive, status.drive_fit) == (None, None)
    assert names(status) == ["viscous"]


def test_another_controller_than_the_files_is_said(ball_screw: Setup) -> None:
    rows = rows_of(ball_screw)
    law = design.design(ball_screw.stage, ball_screw.file.control).law
    stiffer = law.feedback._replace(proportional=1.01 * law.feedback.proportional)
    p = live_model.twin_of(law._replace(feedback=stiffer), ball_screw.stage, ball_screw.dt)
    status = estimate.status_of(p, followed(p, rows))
    assert status.controller is not None
    assert 1e-5 < status.controller < 1e-3
    assert verdict(status, SAME_COMMAND) == "controller"
    assert f"{status.controller:.3g} A" in words(status, ABOUT)


def test_blocks_of_any_size_give_the_same_sums(ball_screw: Setup) -> None:
    rows = rows_of(ball_screw, machine(ball_screw, viscous=0.14 * 1.2), Sine(0.005, 1.6, 2.0, 1.0))[:4000]
    p = beside(ball_screw)
    once, often = followed(p, rows, 2000), followed(p, rows, 250)
    for blocks in (once, often):
        assert sum(block.rows for block in blocks) == 4000
    whole = estimate.sum_of([block.mechanics for block in once])
    two = estimate.sum_of([block.mechanics for block in often])
    assert np.allclose(whole[0], two[0], rtol=1e-9)
    assert np.allclose(whole[1], two[1], rtol=1e-9)


def test_missing_periods_begin_anew_and_the_law_is_not_judged_after_them(ball_screw: Setup) -> None:
    whole = rows_of(ball_screw, machine(ball_screw, viscous=0.14 * 1.2))
    p = beside(ball_screw)
    blocks = followed(p, np.delete(whole, range(1250, 1270), axis=0))
    assert [block.controller is None for block in blocks[:5]] == [False, False, False, True, True]
    assert not blocks[3].informative  # it begins anew in the middle of the motion
    status = estimate.status_of(p, blocks)
    assert status.controller is None
    assert names(status) == ["viscous"]
    assert status.named[0].drift.size == pytest.approx(0.2, abs=0.01)


def test_an_axis_that_stands_tells_nothing(ball_screw: Setup) -> None:
    rows = rows_of(ball_screw, machine(ball_screw, bias=0.2), Sine(0.002, 4.0, 1.0, 1.0))
    still = np.repeat(rows[-1:], 10000, axis=0)
    still[:, 0] = rows[-1, 0] + ball_screw.dt * np.arange(1, 10001)
    p = beside(ball_screw)
    status = estimate.status_of(p, followed(p, np.concatenate([rows, still])))
    assert status.mechanics_fit is None
    early = estimate.status_of(p, followed(p, rows_of(ball_screw)[:3000]))
    assert verdict(early, SAME_COMMAND) == "waiting"
    assert "too little motion" in words(early, ABOUT)


def test_what_the_motion_does_not_tell_keeps_the_priors_width(ball_screw: Setup) -> None:
    """Slow: 1 mm at 0.4 Hz makes 2 % of the friction of inertia."""
    p = beside(ball_screw)
    plant = machine(ball_screw, inertia=0.012, coulomb=1.1)
    status = estimate.status_of(p, followed(p, rows_of(ball_screw, plant, Sine(0.001, 0.4, 2.0, 0.5))))
    fit = status.mechanics_fit
    assert fit is not None
    drifts = {drift.candidate.name: drift for drift in fit.drifts}
    assert drifts["coulomb"].size == pytest.approx(0.1, abs=0.02)
    assert drifts["inertia"].error > 10.0 * drifts["coulomb"].error


def test_a_run_that_begins_elsewhere_is_followed_where_the_drive_counts(ball_screw: Setup) -> None:
    """The same blocks as from rows with the origin in all of their positions; the law sees the rows themselves."""
    rows = rows_of(ball_screw)[:1000]
    moved = rows.copy()
    moved[:, [rollout.COLUMNS.index(name) for name in ("reference", "target", "measured")]] += 0.3
    p = beside(ball_screw)
    ours, expected = followed(p._replace(origin=0.3), rows), followed(p, moved)
    for block, other in zip(ours, expected, strict=True):
        assert np.array_equal(block.mechanics.gram, other.mechanics.gram)
        assert np.array_equal(block.mechanics.cross, other.mechanics.cross)
        assert block.controller == 0.0
    assert any(
        not np.array_equal(block.mechanics.gram, other.mechanics.gram)
        for block, other in zip(ours, followed(p, rows), strict=True)
    )


@pytest.mark.parametrize(("line", "origin"), [(b"0.3\n", 0.3), (b"nan\n", 0.0), (b"", 0.0)])
def test_the_run_says_where_it_begins(ball_screw: Setup, tmp_path: Any, line: bytes, origin: float) -> None:
    reader = reader_of(ball_screw, Ring.create(rollout.WIDTH, 4096), tmp_path)
    reader.stands_at(line)
    assert reader.twin.origin == origin


def reader_of(setup: Setup, ring: Ring, tmp_path: Any) -> RingFollower:
    law = design.design(setup.stage, setup.file.control).law
    order = companion(setup, law, tmp_path / "run.h5").order(ring, 0)
    return RingFollower(order, ring)  # type: ignore[arg-type]


def test_a_twin_that_falls_behind_skips_and_says_so(ball_screw: Setup, tmp_path: Any) -> None:
    import json

    rows = rows_of(ball_screw)
    ring = Ring.create(rollout.WIDTH, 4096)
    reader = reader_of(ball_screw, ring, tmp_path)
    for row in rows[:1000]:
        ring.write(row.tolist())
    reader.catch_up(False)
    assert (reader.done, reader.skipped) == (1000, 0)
    for row in rows[1000:4000]:
        ring.write(row.tolist())
    reader.catch_up(False)
    reader.show("", 0.1)
    shown = json.loads((tmp_path / "run.twin.json").read_text())
    assert (shown["rows"], shown["skipped_rows"]) == (1500, 2500)
    assert shown["behind"] == pytest.approx(3000 * ball_screw.dt)
    assert shown["residual"]["controller"] is None


def test_parameters_come_back_from_another_process_as_they_went(ball_screw: Setup) -> None:
    back = restored(portable(ball_screw.stage))
    assert portable(back) == portable(ball_screw.stage)
    assert isinstance(back.friction.operators.weight, np.ndarray)
