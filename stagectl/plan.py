"""A trajectory on a stage: checked against the limits, then laid out period by period.

The delay rule, with ``L = current lag + nd Ts + dead time`` and the measurement late by ``nm Ts``::

    feedforward   desired states at t + L             (the current acts L later)
    target y0     desired states at t - nm Ts         (so late is the measurement)
    friction      position at t + L + Ts/2            (the middle of the period it acts in)
"""

from __future__ import annotations

import math
import shlex
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.compensation import model_effects
from stagectl.compensation.forms import Model
from stagectl.compensation.legs import legs
from stagectl.config.stage_file import Setup
from stagectl.kernels import friction_path, rollout, stage
from stagectl.kernels.feedforward import Feedforward, Foreseen, setpoints
from stagectl.kernels.friction import relaxed
from stagectl.kernels.friction_bristle import Bristle
from stagectl.kernels.jit import table
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.problem import Problem, ProblemKind
from stagectl.trajectories import Experiment, Phases, Span, Trajectory, TrajectoryError, peaks, phases
from stagectl.trajectories.motion import Array

# Chosen, not derived:
LONGEST = 10_000_000  # control periods of a trajectory, 83 minutes at 2 kHz: what a memory holds
SETTLE = 0.1  # s of standstill after the motion, in which the axis must come into position
LIMIT_SLACK = 1e-9  # of a limit by which a trajectory may exceed it: rounding of its own peaks
JUMP_SLACK = 1e-6  # of the largest change of velocity in a period: rounding of a difference of velocities


class LimitError(TrajectoryError):
    """A motion that exceeds a limit of its stage; nothing has moved."""

    def __init__(self, problem: Problem, needed: float = math.nan, allowed: float = math.nan) -> None:
        super().__init__(problem)
        self.needed, self.allowed = needed, allowed  # in the unit of the problem; of a travel downwards, its length


class Start(NamedTuple):
    """Where a motion begins, and what earlier ones left of the friction."""

    position: float = 0.0  # rad | m, of the axis: the motion's reference is relative to it
    stops: Any = None  # friction operators; None: relaxed
    effects: model_effects.Memory | None = None  # None: at rest, not moved yet

    def copy(self) -> Start:
        """One of its own to move on."""
        stops = None if self.stops is None else np.array(self.stops)
        return Start(self.position, stops, None if self.effects is None else self.effects.copy())


AT_ZERO = Start()


class Plan(NamedTuple):
    """A motion laid out period by period."""

    setpoints: NDArray[np.float64]  # (n, 8), fields of kernels.law.Setpoint, relative to the axis' position
    steady: tuple[float, float]  # s, window of the tracking error
    duration: float  # s, without the standstill at its end
    excitation: tuple[Span, ...] = ()  # steady parts of an injected current
    effects: model_effects.Memory | None = None  # of the model's effects at its end; None where it has none
    limited: tuple[model_effects.Limited, ...] = ()  # effects whose current reached its share of the limit
    mapped: bool = False  # whether the target holds what the encoder adds to the reference


def command_delay(setup: Setup) -> float:
    """L (s): from the command to the current, its dead time included."""
    drive = setup.stage.drive
    return drive.current_lag + drive.delay_samples * setup.dt + drive.dead_time


def plan(setup: Setup, experiment: Experiment, feedforward: Feedforward, start: Start = AT_ZERO) -> Plan:
    """Check against the stage's limits and lay out the rows.

    `start` is what earlier motions left; its friction states are moved on.

    Raises LimitError with value, limit and the field to change; nothing has moved then.
    """
    parts = phases(experiment)
    check_duration(parts.duration, setup.dt, LONGEST)
    _within_limits(setup, parts.motion)
    seen = foresee(setup, parts.motion, parts.duration)
    _check_jumps(setup, seen)
    force = _further_friction(setup, parts.motion, seen) if feedforward.with_friction else None
    model = isinstance(setup.file.compensation, Model)
    ahead = feedforward._replace(with_friction=feedforward.with_friction and model)
    rows = setpoint_rows(ahead, seen, relaxed(feedforward.friction) if start.stops is None else start.stops, force)
    answer = _add_effects(setup, parts.motion, rows, start) if feedforward.with_effects else model_effects.Answer()
    _experiment(setup, parts, rows)
    return Plan(rows, parts.steady, parts.duration, _excitation(parts), *answer)


def setpoint_rows(p: Feedforward, seen: Foreseen, stops: Array, force: Array | None) -> NDArray[np.float64]:
    """Rows (n, 8) of `kernels.law.Setpoint`, for a reference at the instants `seen`.

    The friction operators move on from their state `stops`; `force` (n,) N m | N is friction of any other law.
    """
    rows = np.zeros((len(seen.reference), rollout.SETPOINTS))
    setpoints(p, seen, stops, rows)
    column = SETPOINT_COLUMNS["friction"]
    if force is not None:
        current = force / p.force_constant
        rows[:, column] = rows[:, column] + current if p.with_friction else current
    rows[:, column] *= p.friction_scale
    return rows


def _add_effects(setup: Setup, motion: Trajectory, rows: Array, start: Start) -> model_effects.Answer:
    """Put the current against the model's further effects into `rows`, with the friction."""
    p, dt = model_effects.without(setup.stage, setup.file.control.unanswered), setup.dt
    if not isinstance(setup.file.compensation, Model):
        p = model_effects.rubbing_answered(p)
    memory = model_effects.going_on(p, start.position, start.effects)
    if not model_effects.present(p) and memory.held == 0.0:
        return model_effects.Answer()
    each = model_effects.steps(p, dt)
    t: Array = dt / each * np.arange(each * len(rows) + 1, dtype=np.float64) + command_delay(setup)
    path = np.stack(motion.at(t)[:3], axis=1) / setup.file.axis.travel_per_unit
    path[:, 0] += start.position
    current, answer = model_effects.along(p, memory, path, dt)
    model_effects.put_into(rows, p, current, start.position)
    return answer


def _further_friction(setup: Setup, motion: Trajectory, seen: Foreseen) -> Array | None:
    """Friction (n,) N m | N to compensate that is not of stop operators; None where there is none."""
    if not isinstance(setup.file.compensation, Model):
        return _compensation(setup, motion, len(seen.reference))
    bristle = setup.stage.friction.bristle
    return bristle_force(bristle, seen, setup.dt) if bristle.coulomb > 0.0 else None


def _experiment(setup: Setup, parts: Phases, rows: NDArray[np.float64]) -> None:
    """Put the injected current into `rows`, and open the loop where the experiment does."""
    t = setup.dt * np.arange(len(rows))
    if parts.current is not None:
        _check_current(setup, parts.current.amplitude)
        rows[:, SETPOINT_COLUMNS["injection"]] = parts.current.at(t - parts.start)
    opened = t >= parts.opens - 1e-9
    for name in ("feedforward", "friction", "velocity", "closed"):
        rows[opened, SETPOINT_COLUMNS[name]] = 0.0
    if parts.opens == 0.0:
        _check_open(setup, rows[:, SETPOINT_COLUMNS["injection"]])


def _compensation(setup: Setup, motion: Trajectory, count: int) -> Array:
    """Friction (n,) N m | N along the reference by the form that the stage file chose, at t + L + Ts/2."""
    t: Array = setup.dt * np.arange(count, dtype=np.float64) + (command_delay(setup) + 0.5 * setup.dt)
    place, speed = _at(setup, motion, t).T
    force: Array = setup.file.compensation.along(legs(place, speed, setup.dt))
    return force


def bristle_force(p: Bristle, seen: Foreseen, dt: float) -> Array:
    """Friction (n,) N m | N of a bristle along the reference, from rest."""
    place = np.concatenate([seen.reference[:1], seen.friction])
    columns = np.empty((len(place), 2))
    friction_path.bristle(p, place, dt, columns)
    force: Array = (columns[:, 0] + p.damping * columns[:, 1])[1:]
    return force


def _excitation(parts: Phases) -> tuple[Span, ...]:
    spans = parts.current.spans if parts.current is not None else ()
    return tuple(span._replace(start=span.start + parts.start, end=span.end + parts.start) for span in spans)


def check_duration(duration: float, dt: float, most: int) -> None:
    """Refuse a motion of more than `most` periods.  Raises LimitError."""
    longest = most * dt
    if duration > longest:
        reason = f"must be at most {longest:g} s, {most} control periods"
        problem = Problem(reason, ProblemKind.LIMIT, "duration", f"{duration:g} s", "s")
        raise LimitError(_unmoved(problem, "run fewer periods or cycles at a time"), duration, longest)


def _check_current(setup: Setup, amplitude: float) -> None:
    limit = setup.file.drive.current_limit
    if amplitude > limit:
        reason = f"the experiment's amplitude is {amplitude:g} A"
        problem = Problem(reason, ProblemKind.LIMIT, "drive.current_limit", f"{limit:g} A", "A")
        raise LimitError(_unmoved(problem, "lower the amplitude"), amplitude, limit)


def _unmoved(problem: Problem, remedy: str) -> Problem:
    return problem._replace(remedy=f"nothing has moved; {remedy}")


def _check_open(setup: Setup, currents: NDArray[np.float64]) -> None:
    """No loop holds an axis that a current moves: the model predicts where it would go."""
    p, limits, axis = setup.stage, setup.file.limits, setup.file.axis
    # One call for the whole motion: an interrupt between thousands of compiled ones has crashed the interpreter.
    low, high, speed = rollout.carried(p, stage.at_rest(p), table(currents), setup.dt)
    scale, unit = axis.travel_per_unit, axis.travel_unit
    remedy = "lower the amplitude or raise the frequency"
    if low < limits.travel[0] or high > limits.travel[1]:
        reason = f"by the model the current would move the axis over [{low * scale:.4g}, {high * scale:.4g}] {unit}"
        travel = f"[{limits.travel[0] * scale:g}, {limits.travel[1] * scale:g}] {unit}"
        problem = _unmoved(Problem(reason, ProblemKind.LIMIT, "limits.travel", travel, unit), remedy)
        if high > limits.travel[1]:
            raise LimitError(problem, high * scale, limits.travel[1] * scale)
        raise LimitError(problem, -low * scale, -limits.travel[0] * scale)
    if speed > limits.speed:
        reason = f"by the model the current would move the axis at {speed * scale:.4g} {unit}/s"
        allowed = limits.speed * scale
        problem = Problem(reason, ProblemKind.LIMIT, "limits.speed", f"{allowed:g} {unit}/s", f"{unit}/s")
        raise LimitError(_unmoved(problem, remedy), speed * scale, allowed)


def foresee(setup: Setup, trajectory: Trajectory, duration: float | None = None) -> Foreseen:
    """The trajectory at the instants that the feedforward needs, by the delay rule; `duration` (s) if not its own."""
    dt, lead = setup.dt, command_delay(setup)
    whole = trajectory.duration if duration is None else duration
    t: Array = dt * np.arange(2 * math.ceil((whole + SETTLE) / (2.0 * dt)) + 2, dtype=np.float64)
    late = _at(setup, trajectory, t - setup.stage.encoder.delay_samples * dt)
    friction = _at(setup, trajectory, t[:-2] + (lead + 0.5 * dt))
    return Foreseen(_at(setup, trajectory, t[:-2])[:, 0], _at(setup, trajectory, t + lead), late, friction[:, 0])


def _at(setup: Setup, trajectory: Trajectory, t: Array) -> Array:
    """Position and velocity (n, 2) in axis units."""
    motion = trajectory.at(t)
    return np.ascontiguousarray(np.stack(motion[:2], axis=1) / setup.file.axis.travel_per_unit)


class _Need(NamedTuple):
    """What a trajectory needs of a limit, in units of travel."""

    limit: str  # entry of the block `limits`
    needed: float
    allowed: float
    unit: str
    direction: str = ""  # of the travel


def _within_limits(setup: Setup, trajectory: Trajectory) -> None:
    limits, axis = setup.file.limits, setup.file.axis
    scale, unit = axis.travel_per_unit, axis.travel_unit
    extremes = peaks(trajectory, setup.dt)
    low, high = limits.travel[0] * scale, limits.travel[1] * scale
    for need in (
        _Need("travel", extremes.highest, high, unit, " upwards"),
        _Need("travel", -extremes.lowest, -low, unit, " downwards"),
        _Need("speed", extremes.speed, limits.speed * scale, f"{unit}/s"),
        _Need("acceleration", extremes.acceleration, limits.acceleration * scale, f"{unit}/s^2"),
    ):
        if not need.needed <= need.allowed * (1.0 + LIMIT_SLACK):
            raise LimitError(_beyond(setup, need), need.needed, need.allowed)


def _beyond(setup: Setup, need: _Need) -> Problem:
    unit = f"{need.unit}{need.direction}"
    reason, value = f"the trajectory needs {need.needed:.6g} {unit}", f"{need.allowed:.6g} {unit}"
    change = "make the motion shorter" if need.direction else "make the motion slower"
    if need.direction and need.allowed < 0.0:
        ends = ", ".join(f"{end * setup.file.axis.travel_per_unit:g}" for end in setup.file.limits.travel)
        reason, value = f"the motion begins {-need.allowed:.6g} {need.unit} outside", f"[{ends}] {need.unit}"
        change = "begin within the travel"
    remedy = (
        f"{change}, or raise the limit in {setup.path} and try it: "
        f"stagectl simulate {shlex.quote(str(setup.path))} TRAJECTORY"
    )
    return _unmoved(Problem(reason, ProblemKind.LIMIT, f"limits.{need.limit}", value, need.unit), remedy)


def _check_jumps(setup: Setup, seen: Foreseen) -> None:
    """Velocity that changes at once, as where a record begins or ends in motion; no acceleration shows it."""
    change = np.abs(np.diff(seen.late[:, 1], prepend=0.0))
    worst, allowed = int(np.argmax(change)), setup.file.limits.acceleration * setup.dt
    if change[worst] > allowed * (1.0 + JUMP_SLACK):
        scale, unit = setup.file.axis.travel_per_unit, f"{setup.file.axis.travel_unit}/s"
        jump, largest = float(change[worst]) * scale, allowed * scale
        reason = (
            f"the trajectory's speed jumps by {jump:.4g} {unit} at {worst * setup.dt:.6g} s, and {largest:.4g} {unit} "
            "in a period is allowed"
        )
        value = f"{setup.file.limits.acceleration * scale:.6g} {unit}^2"
        problem = Problem(reason, ProblemKind.LIMIT, "limits.acceleration", value, f"{unit}^2")
        remedy = "let it begin and end at rest (a csv trajectory takes run_up and run_out)"
        raise LimitError(_unmoved(problem, remedy), jump, largest)
