"""The slider's guide as a contact with memory: its friction follows the speed late (frictional lag).

The stage file's friction depends on the place and on the speed of the same instant, so every stop from the same
deceleration ends alike.  The paper's guide does not forget so fast: the force at zero velocity and the way back after
a release differ with the speed before (Figs. 3 and 5).  Here the velocity in Stribeck's factor lags behind; that is an
effect of the plant (`friction.lag`), no law of its own.

Source of the lag: D. P. Hess, A. Soom, Journal of Tribology 112, 1990.  Its size is chosen (`chosen.FRICTION_LAG`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl_studies.reproduction import chosen
from stagectl_studies.reproduction.bench import CONFIG, Bench, Run, carried_out
from stagectl_studies.reproduction.release import released

SAME_DECELERATION, SAME_TIME = "same deceleration", "same time"
PROFILES = (SAME_DECELERATION, SAME_TIME)
REFERENCE_SPEED = 10.0  # mm/s, at which both profiles are the trajectory file's
BEFORE = 10e-3  # s over which the force before the reversal is a mean
HELD = 0.1  # s before the release, of the holding force


class Standstill(NamedTuple):
    """What a stop from one speed leaves."""

    reversal: float  # N, output force before the reference reverses
    holding: float  # N
    offset: float  # m, from where it was let go to where it rests


Cases = dict[tuple[float, str, str], Standstill]  # by lag (s), profile and speed


def remembering(setup: Setup, lag: float = chosen.FRICTION_LAG) -> Setup:
    """`setup` with friction that follows the speed late by `lag` (s)."""
    friction = setup.stage.friction
    rise = friction.stribeck._replace(rise=chosen.FRICTION_RISE)
    return setup._replace(stage=setup.stage._replace(friction=friction._replace(lag=lag, stribeck=rise)))


def motion(setup: Setup, speed: str, profile: str = SAME_DECELERATION) -> Any:
    """The reversals at `speed` (mm/s)."""
    trajectory: Any = load_trajectory(CONFIG / "trajectories" / f"slider-{speed}mms.yaml", axis_of(setup))
    return _ramped(trajectory, speed, profile)


def release(setup: Setup, speed: str, profile: str = SAME_DECELERATION) -> Any:
    """The stop from `speed` (mm/s) and the release behind it."""
    experiment: Any = load_trajectory(CONFIG / "experiments" / f"release-{speed}mms.yaml", axis_of(setup))
    return experiment._replace(motion=_ramped(experiment.motion, speed, profile))


def _ramped(trajectory: Any, speed: str, profile: str) -> Any:
    share = float(speed) / REFERENCE_SPEED if profile == SAME_TIME else 1.0
    return trajectory._replace(acceleration=trajectory.acceleration * share)


def cases(bench: Bench, speeds: tuple[str, ...], lags: tuple[float, ...], tell: Callable[[int, int], None]) -> Cases:
    """Every lag, profile and speed, on the machine of `bench`."""
    keys = [(lag, profile, speed) for lag in lags for profile in PROFILES for speed in speeds]
    standstills = {}
    for number, (lag, profile, speed) in enumerate(keys):
        here = bench._replace(machine=remembering(bench.machine, lag))
        standstills[lag, profile, speed] = _standstill(here, speed, profile)
        tell(number + 1, len(keys))
    return standstills


def _standstill(bench: Bench, speed: str, profile: str) -> Standstill:
    turned = carried_out(bench, motion(bench.machine, speed, profile), speed)
    freed = carried_out(bench, release(bench.machine, speed, profile), speed)
    rows, opened = freed.samples, opening(freed)
    before = (rows["time"] >= opened - HELD) & (rows["time"] < opened)
    constant = bench.machine.stage.motor.force_constant
    ringing = released(rows["time"], rows["measured"], opened, bench.machine.stage.encoder.step)
    return Standstill(
        current_before(turned, turning(turned)) * constant,
        constant * float(np.mean(rows["measured_current"][before])),
        ringing.offset,
    )


def opening(run: Run) -> float:
    """When the loop was opened (s)."""
    return float(run.samples["time"][run.samples["closed"].argmin()])


def turning(run: Run) -> float:
    """First change of the reference's direction (s)."""
    v = run.samples["velocity"]
    return float(run.samples["time"][np.flatnonzero((v[:-1] > 0.0) & (v[1:] <= 0.0))[0] + 1])


def current_before(run: Run, instant: float) -> float:
    """Mean motor current (A) over the BEFORE seconds to an `instant` (s): the encoder's steps shake single samples."""
    time = run.samples["time"]
    inside = (time >= instant - BEFORE) & (time < instant)
    return float(np.mean(run.samples["measured_current"][inside]))
