"""What the whole loop reaches on simulated stage A: the figures of the issue and of control-math.md."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.kernels import law, rollout, stage
from stagectl.plan import command_delay
from stagectl.trajectories import Dwell, SCurve, Sequence, Sine
from tests.conftest import Run, varied

SINES = {0.8: Sine(0.010, 0.8, 3), 1.6: Sine(0.005, 1.6, 4), 3.2: Sine(0.002, 3.2, 6)}
MICRO = Sine(2e-6, 1.6, 4)
BARE = frozenset({"friction"})
Tracked = Callable[..., Run]

# Peak without compensation (um): control-math.md, "Tracking reached on stage A".
WITHOUT = {(0, 3.2): 5.49, (0, 1.6): 5.35, (0, 0.8): 4.98, (1, 3.2): 5.95, (1, 1.6): 5.74, (1, 0.8): 5.20}


@pytest.mark.parametrize(("nd", "frequency"), WITHOUT)
def test_without_compensation(tracked: Tracked, nd: int, frequency: float) -> None:
    peak = tracked(SINES[frequency], BARE, nd=nd).peak()
    assert peak == pytest.approx(WITHOUT[nd, frequency], rel=0.01)


@pytest.mark.parametrize("nd", [0, 1])
@pytest.mark.parametrize("frequency", SINES)
def test_stop_operators_from_the_true_friction(tracked: Tracked, nd: int, frequency: float) -> None:
    """<= 0.03 um, and not better than the encoder's step and the prototype's floor allow."""
    run = tracked(SINES[frequency], nd=nd)
    assert 0.006 < run.peak() <= 0.03
    assert run.peak("true_position") <= 0.02


@pytest.mark.parametrize("nd", [0, 1])
def test_a_motion_within_the_rolling_zone(tracked: Tracked, nd: int) -> None:
    assert 0.006 < tracked(MICRO, nd=nd).peak() <= 0.02
    assert tracked(MICRO, BARE, nd=nd).peak() == pytest.approx(0.55, rel=0.03)


@pytest.mark.parametrize("frequency", SINES)
def test_start_from_rest(tracked: Tracked, frequency: float) -> None:
    """The whole run, from the first sample."""
    assert np.max(np.abs(tracked(SINES[frequency]).error())) <= 0.03


@pytest.mark.parametrize("distance", [5e-3, 30e-6, 3e-6])
@pytest.mark.parametrize(("nd", "continuous", "bound"), [(0, False, 0.03), (1, True, 0.012), (1, False, 0.045)])
def test_stop_and_continue(tracked: Tracked, distance: float, nd: int, continuous: bool, bound: float) -> None:
    """Two moves one way with a stop between, then two back: restarting must not reset the state.

    Whole run, peak in um.  With nd = 1 the loop's 26 degrees of margin amplify the encoder's steps to 3 or 4
    counts when it creeps to a stop; with a continuous encoder (0.001 counts) the same run stays below 0.012.
    """
    there = SCurve(distance, 0.02, 0.25, 20.0, 0.2, 2, True)
    changes = {"step": 6e-9} if continuous else {}
    run = tracked(Sequence((there, there._replace(distance=-distance))), nd=nd, **changes)
    assert np.max(np.abs(run.error())) <= bound


@pytest.mark.parametrize("name", ["0.8", "1.6", "3.2", "micro"])
def test_halving_the_step_changes_nothing(tracked: Tracked, name: str) -> None:
    """True error with 10 and with 20 sub-steps: within 2 nm in peak and 0.3 nm in rms."""
    trajectory = MICRO if name == "micro" else SINES[float(name)]
    coarse, fine = (tracked(trajectory, substeps=n) for n in (10, 20))
    assert coarse.peak("true_position") == pytest.approx(fine.peak("true_position"), abs=2e-3)
    rms = [float(np.sqrt(np.mean(run.error("true_position")[run.steady()] ** 2))) for run in (coarse, fine)]
    assert rms[0] == pytest.approx(rms[1], abs=3e-4)
    bare = [tracked(trajectory, BARE, substeps=n).peak() for n in (10, 20)]
    assert bare[0] == pytest.approx(bare[1], abs=0.012)  # one encoder count


def with_references(run: Run, change: Callable[[Any, Any, Setup], None], trajectory: Any) -> float:
    """Peak error (um) when the rows the law reads are changed by ``change(rows, at, setup)``."""
    setup, rows = run.setup, run.plan.references.copy()
    scale = setup.file.axis.travel_per_unit
    t = setup.dt * np.arange(len(rows))

    def at(offset: float) -> tuple[Any, Any]:
        motion = trajectory.at(t + offset)
        return motion.position / scale, motion.velocity / scale

    change(rows, at, setup)
    wrong = np.zeros((len(rows), rollout.WIDTH))
    p = rollout.Loop(run.law, setup.stage)
    states = law.at_rest(run.law), stage.at_rest(setup.stage)
    rollout.closed_loop(p, *states, (rows, np.zeros((len(rows), 2)), wrong), setup.dt, 10)
    measured = wrong[:, rollout.COLUMNS.index("measured")]
    return float(np.max(np.abs((run.plan.references[:, 1] - measured)[run.steady()]))) * scale * 1e6


def lag_ignored(rows: Any, at: Any, setup: Setup) -> None:
    rows[:, 2], rows[:, 3] = at(2.0 * setup.dt)
    rows[:, 6] = at(0.5 * setup.dt)[0]


def lag_ignored_in_feedforward(rows: Any, at: Any, setup: Setup) -> None:
    rows[:, 2], rows[:, 3] = at(2.0 * setup.dt)


def target_advanced(rows: Any, at: Any, setup: Setup) -> None:
    rows[:, 4], rows[:, 5] = at(2.0 * setup.dt + command_delay(setup))


def measurement_delay_ignored(rows: Any, at: Any, setup: Setup) -> None:
    rows[:, 4], rows[:, 5] = at(2.0 * setup.dt)


def friction_now(rows: Any, at: Any, setup: Setup) -> None:
    rows[:, 6] = at(0.0)[0]


# What the wrong variants cost at 1.6 Hz, 5 mm (control-math.md, "Delay rule"): peak um for nd, nm.  A target that
# is early costs the speed, 50.3 mm/s, times the time: L for the first, nm Ts for the second.
WRONG = [
    (lag_ignored, 0, 0, 0.10),
    (lag_ignored, 1, 0, 0.50),
    (lag_ignored, 2, 0, 1.04),
    (target_advanced, 0, 0, 8.0),
    (target_advanced, 1, 0, 33.1),
    (target_advanced, 2, 0, 58.3),
    (measurement_delay_ignored, 0, 1, 25.1),
    (measurement_delay_ignored, 1, 1, 25.1),
    (measurement_delay_ignored, 0, 2, 50.3),
]


@pytest.mark.parametrize(("change", "nd", "nm", "cost"), WRONG)
def test_each_wrong_delay_costs_what_it_should(tracked: Tracked, change: Any, nd: int, nm: int, cost: float) -> None:
    run = tracked(SINES[1.6], nd=nd, nm=nm, quantum=0.0)
    assert with_references(run, lambda *_: None, SINES[1.6]) == pytest.approx(run.peak(), rel=1e-9)
    assert run.peak() < 0.03
    assert with_references(run, change, SINES[1.6]) == pytest.approx(cost, rel=0.2)


@pytest.mark.parametrize("nd", [0, 1])
def test_lag_ignored_in_the_feedforward_alone(tracked: Tracked, nd: int) -> None:
    """Slow sines hide it; one of 20 Hz does not."""
    fast = Sine(5e-5, 20.0, 8, 4)
    run = tracked(fast, nd=nd, quantum=0.0)
    assert with_references(run, lag_ignored_in_feedforward, fast) > 4.0 * run.peak()


@pytest.mark.parametrize("nd", [0, 1])
def test_friction_compensated_at_the_wrong_instant(tracked: Tracked, nd: int) -> None:
    run = tracked(SINES[1.6], nd=nd, quantum=0.0)
    assert with_references(run, friction_now, SINES[1.6]) > 4.0 * run.peak()


def test_target_held_over_a_frame(tracked: Tracked) -> None:
    """y0 held over 2 Ts costs 12.6 um: the law stepped by hand, with the target of the even samples held."""
    run = tracked(SINES[1.6], nd=0, quantum=0.0)
    unlimited = run.setup.stage.drive._replace(current_limit=1e9)  # the jumps ask for more than 15 A
    p, running = run.setup.stage._replace(drive=unlimited), run.law._replace(current_limit=1e9)
    plant, state = stage.at_rest(p), law.at_rest(running)
    worst, target, steady = 0.0, 0.0, run.steady()
    for k, row in enumerate(run.plan.references[:3000].tolist()):
        measured = stage.measured(p.encoder, plant, stage.SILENT)
        target = row[0] if k % 2 == 0 else target
        shift = target - _target(run, state, row)
        out, state = law.step(running, state, law.Reference(*row), measured - shift)
        plant = stage.period(p, plant, out.current, stage.SILENT, run.setup.dt, 10)
        worst = max(worst, abs(row[0] - measured) * steady[k])
    assert worst * run.setup.file.axis.travel_per_unit * 1e6 == pytest.approx(12.6, rel=0.2)


def _target(run: Run, state: law.State, row: list[float]) -> float:
    """The law's own target in this period."""
    if state.feedforward.second_half:
        return state.feedforward.passed
    return state.feedforward.late.position


@pytest.mark.parametrize("counts", [0, 1, 2, 3])
def test_standstill_under_measurement_noise(ball_screw: Setup, counts: int) -> None:
    """<= 20 nm rms with 0-3 LSB, peak to peak, of measurement noise; the compensation never flips its sign."""
    run = Run(ball_screw, Sequence((SCurve(5e-3, 0.05, 0.5, 50.0, 0.2, 1, True), Dwell(5.0))))
    noise = np.zeros((len(run.plan.references), 2))
    noise[:, 1] = np.random.default_rng(7).integers(0, counts, len(noise), endpoint=True) - 0.5 * counts
    noise[:, 1] *= ball_screw.stage.encoder.step
    held = _held(run, noise)
    assert np.sqrt(np.mean(held["error"] ** 2)) <= 0.020
    assert np.all(held["friction"] == held["friction"][0])
    assert held["friction"][0] == pytest.approx(1.0 / 0.72, rel=1e-12)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_standstill_under_actuator_noise(ball_screw: Setup, seed: int) -> None:
    """<= 25 nm rms with 0.045 A rms of actual current noise, and not below what that noise must cost."""
    setup = varied(ball_screw, current_noise=0.045, seed=seed)
    run = Run(setup, Sequence((SCurve(5e-3, 0.05, 0.5, 50.0, 0.2, 1, True), Dwell(5.0))))
    late = run.samples["time"] > 1.0
    rms = float(np.sqrt(np.mean(run.error("true_position")[late] ** 2)))
    assert 0.015 < rms <= 0.025
    assert np.all(run.samples["friction"][late] == run.samples["friction"][-1])


def _held(run: Run, noise: Any) -> dict[str, Any]:
    """True error (um) and compensation (A) in the standstill, under this noise."""
    rows = np.zeros((len(noise), rollout.WIDTH))
    states = law.at_rest(run.law), stage.at_rest(run.setup.stage)
    loop = rollout.Loop(run.law, run.setup.stage)
    rollout.closed_loop(loop, *states, (run.plan.references, noise, rows), run.setup.dt, 10)
    late = rows[:, 0] > 1.0
    column = {name: rows[late, k] for k, name in enumerate(rollout.COLUMNS)}
    error = (column["reference"] - column["true_position"]) * run.setup.file.axis.travel_per_unit * 1e6
    return {"error": error, "friction": column["friction"]}
