"""A trajectory on a stage: checked against the limits, then the rows that the law reads, period by period.

The delay rule, with ``L = current lag + nd Ts`` and the measurement late by ``nm Ts``::

    feedforward   desired state at the frame's end, t + 2 Ts + L     (the current acts L later)
    target y0     desired state late by nm Ts                        (so is the measurement)
    friction      position at t + L + Ts/2                           (the middle of the period it acts in)
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.trajectories import Trajectory, TrajectoryError, peaks
from stagectl.trajectories.motion import Array

LONGEST = 10_000_000  # control periods, 83 minutes at 2 kHz; their rows take 0.6 GB
_ARTICLE = {"travel": "a", "speed": "a", "acceleration": "an"}
SETTLE = 0.1  # s of standstill after the motion, in which the axis must come into position


class Plan(NamedTuple):
    """What is about to run."""

    references: NDArray[np.float64]  # (n, 7), columns of kernels.law.Reference, axis units
    steady: tuple[float, float]  # s, window of the tracking error
    duration: float  # s, without the standstill at its end


def command_delay(setup: Setup) -> float:
    """L (s): from the command to the current."""
    drive = setup.stage.drive
    return drive.current_lag + drive.delay_samples * setup.dt


def plan(setup: Setup, trajectory: Trajectory) -> Plan:
    """Check against the stage's limits and lay out the rows.

    Raises TrajectoryError with value, limit and the field to change; nothing has moved then.
    """
    dt = setup.dt
    if trajectory.duration > LONGEST * dt:
        raise TrajectoryError(
            f"the trajectory takes {trajectory.duration:g} s; must be at most {LONGEST * dt:g} s, {LONGEST} control "
            "periods: nothing has moved; run fewer periods or cycles at a time"
        )
    _within_limits(setup, trajectory)
    t: Array = dt * np.arange(2 * math.ceil((trajectory.duration + SETTLE) / (2.0 * dt)), dtype=np.float64)
    rows = np.empty((len(t), 7))
    late, ahead = setup.stage.encoder.delay_samples * dt, command_delay(setup)
    rows[:, 0] = _at(setup, trajectory, t)[0]
    rows[:, 1] = _at(setup, trajectory, t - late)[0]
    rows[:, 2], rows[:, 3] = _at(setup, trajectory, t + 2.0 * dt + ahead)
    rows[:, 4], rows[:, 5] = _at(setup, trajectory, t + 2.0 * dt - late)
    rows[:, 6] = _at(setup, trajectory, t + ahead + 0.5 * dt)[0]
    return Plan(rows, trajectory.steady, trajectory.duration)


def _at(setup: Setup, trajectory: Trajectory, t: Array) -> tuple[Any, Any]:
    """Position and velocity in axis units."""
    motion = trajectory.at(t)
    scale = setup.file.axis.travel_per_unit
    return motion.position / scale, motion.velocity / scale


def _within_limits(setup: Setup, trajectory: Trajectory) -> None:
    limits, axis = setup.file.limits, setup.file.axis
    scale, unit = axis.travel_per_unit, axis.travel_unit
    found = peaks(trajectory, setup.dt)
    low, high = limits.travel[0] * scale, limits.travel[1] * scale
    start = abs(getattr(trajectory, "initial_velocity", 0.0)) / setup.dt
    for name, value, limit, of in (
        ("travel", found.highest, high, f"{unit} upwards"),
        ("travel", -found.lowest, -low, f"{unit} downwards"),
        ("speed", found.speed, limits.speed * scale, f"{unit}/s"),
        ("acceleration", found.acceleration, limits.acceleration * scale, f"{unit}/s^2"),
        ("acceleration", start, limits.acceleration * scale, f"{unit}/s^2 at its start, as it does not begin at rest"),
    ):
        if not value <= limit * (1.0 + 1e-9):
            raise TrajectoryError(
                f"the trajectory needs {_ARTICLE[name]} {name} of {value:.6g} {of}; limits.{name} of "
                f"{setup.file.name} allows {limit:.6g} {of.split(' at')[0]}: nothing has moved; lower the trajectory's "
                f"amplitude, speed or frequency, or raise the limit in {setup.path}"
            )
