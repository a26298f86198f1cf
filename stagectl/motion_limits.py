"""What a stage forbids: checks of a motion's travel, speed, acceleration, current and duration before it begins."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.machine_file import composed
from stagectl.config.source import node_at
from stagectl.config.stage_file import Setup
from stagectl.kernels import equilibrium, rollout, stage
from stagectl.kernels.feedforward import Foreseen
from stagectl.kernels.jit import table
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.problem import Problem, ProblemKind
from stagectl.trajectories import Trajectory, TrajectoryError, peaks
from stagectl.units import StageError, factor, parse, unit_in

LIMIT_SLACK = 1e-9  # of a limit by which a trajectory may exceed it: rounding of its own peaks
JUMP_SLACK = 1e-6  # of the largest change of velocity in a period: rounding of a difference of velocities


class LimitError(TrajectoryError):
    """A motion that exceeds a limit of its stage; nothing has moved."""

    def __init__(self, problem: Problem, needed: float = math.nan, allowed: float = math.nan, *others: Problem) -> None:
        super().__init__(problem, *others)
        # Of the first problem, in its unit; of a travel downwards, its length.
        self.needed, self.allowed = needed, allowed


def check_duration(duration: float, dt: float, most: int) -> None:
    """Refuse a motion of more than `most` periods.  Raises LimitError."""
    longest = most * dt
    if duration > longest:
        reason = f"must be at most {longest:g} s, {most} control periods"
        problem = Problem(reason, ProblemKind.LIMIT, "duration", f"{duration:g} s", "s")
        raise LimitError(_unmoved(problem, "run fewer periods or cycles at a time"), duration, longest)


def check_noticeable(setup: Setup, reference: NDArray[np.float64], duration: float) -> None:
    """Refuse a motion that no encoder or cycle sees, by its `reference` (n,) rad | m: its unit is mistaken.

    Raises LimitError; a dwell passes.
    """
    axis, count, dt = setup.file.axis, setup.file.encoder.one_count, setup.dt
    span = float(np.ptp(reference))
    remedy = "check the unit"
    if 0.0 < span < count:
        moved, least = span * axis.travel_per_unit, count * axis.travel_per_unit
        reason = f"the motion covers {moved:.3g} {axis.travel_unit}, and one encoder count is {least:.4g}"
        problem = Problem(reason, ProblemKind.LIMIT, unit=axis.travel_unit)
        raise LimitError(_unmoved(problem, remedy), moved, least)
    if duration < dt:
        reason = f"the motion lasts {duration:.3g} s, and control.period is {dt:g}"
        raise LimitError(_unmoved(Problem(reason, ProblemKind.LIMIT, unit="s"), remedy), duration, dt)


def check_current(setup: Setup, amplitude: float, what: str = "the experiment's amplitude") -> None:
    """Refuse an injected current of this `amplitude` (A) above the drive's limit; `what` it is.  Raises LimitError."""
    limit = setup.file.drive.current_limit
    if amplitude > limit:
        reason = f"{what} is {amplitude:g} A"
        problem = Problem(reason, ProblemKind.LIMIT, "drive.current_limit", f"{limit:g} A", "A")
        raise LimitError(_unmoved(problem, f"lower {what}"), amplitude, limit)


def beyond_current(setup: Setup, rows: NDArray[np.float64]) -> str:
    """What to say before a motion of these `rows` (n, 8), where its feedforward alone takes more than the drive gives.

    Empty elsewhere.  It is not refused: the feedback makes up for what lacks for a short time, and the model may err.
    """
    limit, scale, unit = setup.file.drive.current_limit, setup.file.axis.travel_per_unit, setup.file.axis.travel_unit
    feedforward, speed = (rows[:, SETPOINT_COLUMNS[name]] for name in ("feedforward", "velocity"))
    worst = int(np.argmax(np.abs(feedforward)))
    if not (needed := abs(float(feedforward[worst]))) > limit:
        return ""
    at = f"at {worst * setup.dt:.3g} s, {abs(speed[worst]) * scale:.3g} {unit}/s"
    takes = f"by the model this motion takes up to {needed:.3g} A without its friction ({at})"
    cause = f"the axis cannot follow while that is more than drive.current_limit, {limit:g} A"
    return f"{takes}: {cause}; {_slower(setup, abs(float(speed[worst])))}"


def _slower(setup: Setup, speed: float) -> str:
    """What the current gives at this speed (rad/s | m/s): what to change."""
    p, axis = setup.stage, setup.file.axis
    scale, unit, viscous = axis.travel_per_unit, axis.travel_unit, p.mechanics.viscous
    left = p.drive.current_limit * p.motor.force_constant - stage.sliding(p.friction) - equilibrium.weight(p.mechanics)
    most = (left - viscous * speed) / p.mechanics.inertia
    if most > 0.0:
        return f"take an acceleration of at most {most * scale:.2g} {unit}/s^2"
    return f"lower the speed, too: the current carries the axis at no more than {left / viscous * scale:.3g} {unit}/s"


def _unmoved(problem: Problem, remedy: str) -> Problem:
    return problem._replace(remedy=f"nothing has moved; {remedy}")


def check_open(setup: Setup, currents: NDArray[np.float64]) -> None:
    """No loop holds an axis that a current moves: the model predicts where it would go."""
    p, limits, axis = setup.stage, setup.file.limits, setup.file.axis
    # One call for the whole motion: an interrupt between thousands of compiled ones has crashed the interpreter.
    steps = stage.steps_that_hold(p, setup.dt, 1)
    low, high, speed = rollout.carried(p, stage.at_rest(p), table(currents), setup.dt, steps)
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


class _Need(NamedTuple):
    """What a trajectory needs of a limit, in units of travel."""

    limit: str  # entry of the block `limits`
    needed: float
    allowed: float
    unit: str
    side: int = 0  # of the travel: 1 upwards, -1 downwards


def check_limits(setup: Setup, trajectory: Trajectory) -> None:
    """Refuse a motion beyond travel, speed or acceleration.  Raises LimitError with all that it exceeds."""
    limits, axis = setup.file.limits, setup.file.axis
    scale, unit = axis.travel_per_unit, axis.travel_unit
    extremes = peaks(trajectory, setup.dt)
    _check(
        setup,
        *_travel(setup, extremes.lowest, extremes.highest),
        _Need("speed", extremes.speed, limits.speed * scale, f"{unit}/s"),
        _Need("acceleration", extremes.acceleration, limits.acceleration * scale, f"{unit}/s^2"),
    )


def check_end(setup: Setup, end: float) -> None:
    """Refuse a motion whose `end` (rad | m) lies beyond the travel, however long it takes.  Raises LimitError."""
    _check(setup, *_travel(setup, end, end))


def _travel(setup: Setup, lowest: float, highest: float) -> tuple[_Need, _Need]:
    scale, unit = setup.file.axis.travel_per_unit, setup.file.axis.travel_unit
    low, high = (end * scale for end in setup.file.limits.travel)
    return _Need("travel", highest, high, unit, 1), _Need("travel", -lowest, -low, unit, -1)


def _check(setup: Setup, *needs: _Need) -> None:
    if beyond := [need for need in needs if not need.needed <= need.allowed * (1.0 + LIMIT_SLACK)]:
        first, *others = [_beyond(setup, need) for need in beyond]
        raise LimitError(first, beyond[0].needed, beyond[0].allowed, *others)


class _Written(NamedTuple):
    """How the stage file states a limit."""

    unit: str
    scale: float  # of that unit in SI
    start: float  # rad | m of travel; of the motion, which a service lays out with the travel that is left
    file: Path | None = None
    line: int = 0


def _written(setup: Setup, need: _Need) -> _Written:
    key = f"limits.{need.limit}" + {1: "[1]", -1: "[0]"}.get(need.side, "")
    try:
        file, root = composed(setup.path, setup.text or None)
        node = node_at(root, key)
        text = str(node.value)
        scale, value = factor(unit_in(text), need.unit), parse(text, need.unit)
    except StageError:  # a stage in memory, or a limit in the unit of the motor
        return _Written(need.unit, 1.0, 0.0)
    start = value - need.side * need.allowed if need.side else 0.0
    return _Written(unit_in(text), scale, start, file, node.start_mark.line + 1)


def _beyond(setup: Setup, need: _Need) -> Problem:
    unit, scale, start, file, line = _written(setup, need)

    def shown(value: float) -> str:
        return f"{(start + value) / scale:.6g}"

    begins = f" from {start / scale:.6g} {unit}" if abs(start) > LIMIT_SLACK else ""
    reason = f"the trajectory{begins} needs {shown((need.side or 1) * need.needed)} {unit}"
    ends = (shown(end * setup.file.axis.travel_per_unit) for end in setup.file.limits.travel)
    value = f"[{', '.join(ends)}] {unit}" if need.side else f"{shown(need.allowed)} {unit}"
    change = "make the motion shorter" if need.side else "make the motion slower"
    if need.side and need.allowed < 0.0:
        reason, change = f"the motion begins {-need.allowed / scale:.6g} {unit} outside", "begin within the travel"
    problem = Problem(reason, ProblemKind.LIMIT, f"limits.{need.limit}", value, need.unit, file=file, line=line)
    return _unmoved(problem, f"{change}, or raise the limit")


def check_jumps(setup: Setup, seen: Foreseen) -> None:
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
