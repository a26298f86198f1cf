"""Motions laid out for a service: a task that can be sent to another process, and what becomes of it.

And the pace of a move, as somebody has typed it: what no move may have, and what is a slip of a unit.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.kernels.feedforward import Feedforward
from stagectl.motion_limits import LIMIT_SLACK, check_duration, check_end, check_noticeable
from stagectl.number_format import length
from stagectl.plan import Plan, Start, plan
from stagectl.problem import Problem, ProblemKind
from stagectl.service.limits import PLANNED_ROWS
from stagectl.trajectories import Experiment, SCurve, phases
from stagectl.trajectories.profiles import unreached
from stagectl.units import StageError

LEAST = 1e-9  # m/s | m/s^2, rad/s | rad/s^2 of travel: the least that a profile is computed with


class ServiceError(StageError):
    """An order that the service cannot carry out: why, and what to do instead."""


class Upload(NamedTuple):
    """A trajectory file as a client sent it, with the tables that it names."""

    yaml: str
    tables: Mapping[str, str]
    unanswered: tuple[str, ...] = ()  # dotted places of effects that this motion leaves to the feedback


class Task(NamedTuple):
    """A motion to be laid out from where the axis stands."""

    name: str
    setup: Setup  # with the travel that is left to both sides
    feedforward: Feedforward
    start: Start  # where the axis stands, and what the last motion left of the friction
    trajectory: Experiment | Upload
    dead_man: float = math.inf  # s of it that the loop has at most: see `AxisController.fill`


class Motion(NamedTuple):
    """A motion that is laid out and goes, or has gone."""

    name: str
    rows: bytes  # empty while it is on its way from the planning process
    length: int  # rows
    span: tuple[float, float]  # rad | m, lowest and highest position, from where it begins
    left: Start  # what it leaves of the friction; its position is that of its beginning
    limited: str = ""  # words, where the current against the model's effects was limited
    dead_man: float = math.inf  # s, as of its task


class Refusal(NamedTuple):
    """Why it cannot be laid out."""

    problems: tuple[Problem | str, ...]


def laid_out(task: Task) -> Motion:
    """The motion.  Raises StageError where a limit or a file forbids it."""
    motion, rows = rows_of(task)
    return motion._replace(rows=rows.tobytes())


def rows_of(task: Task) -> tuple[Motion, NDArray[np.float64]]:
    """The motion, and apart from it its rows (n, 8)."""
    trajectory, setup = task.trajectory, task.setup
    if isinstance(trajectory, Upload):
        setup = leaving(setup, trajectory.unanswered)
        place = Path(f"{task.name}.yaml")  # what messages call it
        trajectory = load_trajectory(place, axis_of(setup), trajectory.yaml, trajectory.tables)
    if isinstance(trajectory, SCurve):  # an order: what is beyond the travel is so at any speed
        check_end(setup, trajectory.distance)
    check_duration(phases(trajectory).duration, setup.dt, PLANNED_ROWS)
    start = task.start.copy()
    laid_out = plan(setup, trajectory, task.feedforward, start)
    rows = np.ascontiguousarray(laid_out.setpoints)
    if isinstance(task.trajectory, Upload):  # an order may move less, to where the axis nearly is
        check_noticeable(setup, rows[:, 0], laid_out.duration)
    span = (float(rows[:, 0].min()), float(rows[:, 0].max()))
    left = start._replace(effects=laid_out.effects)
    return Motion(task.name, b"", len(rows), span, left, _limited(task, laid_out), task.dead_man), rows


def leaving(setup: Setup, places: Sequence[str]) -> Setup:
    """The set-up that leaves the effects at these dotted `places`, too, to the feedback."""
    control = setup.file.control
    return setup.having(control=control._replace(unanswered=tuple(dict.fromkeys((*control.unanswered, *places)))))


def _limited(task: Task, laid_out: Plan) -> str:
    """Which effect's current was limited, in words; empty where none was."""
    if not laid_out.limited:
        return ""
    each = "; ".join(
        f"{one.place or 'all effects together'} would take up to {one.demanded:.3g} A and gets {one.most:.3g} A, in "
        f"{one.periods} of {len(laid_out.setpoints)} periods"
        for one in laid_out.limited
    )
    return (
        f"{task.name}: the current against the model's effects is limited: {each}. The feedback takes the rest; check "
        f"the values: `stagectl gap close {task.setup.path}` tells what each effect is worth"
    )


def check_pace(axis: str, setup: Setup, speed: float | None, acceleration: float | None) -> None:
    """Raise ServiceError for a speed or an acceleration (m | rad of travel) that no move of the `axis` may have."""
    limits, scale, travel = setup.file.limits, setup.file.axis.travel_per_unit, setup.file.axis.travel_unit
    for name, value, most, per in (
        ("speed", speed, limits.speed * scale, "s"),
        ("acceleration", acceleration, limits.acceleration * scale, "s^2"),
    ):
        unit = f"{travel}/{per}"
        if value is not None and not LEAST <= value <= most * (1.0 + LIMIT_SLACK):
            interval, shown = f"[{LEAST:g}, {most:g}]", f"[{length(LEAST, unit)}, {length(most, unit)}]"
            problem = Problem("", ProblemKind.RANGE, name, length(value, unit), unit, interval, admissible=shown)
            raise ServiceError(problem._replace(remedy=f"limits.{name} of {axis}"))


def check_time(axis: str, setup: Setup, move: SCurve, stated: tuple[bool, bool]) -> None:
    """Refuse a move that a speed, an acceleration or both, where they are `stated`, make absurdly slow: a slip.

    Raises ServiceError.
    """
    unit, longest, (paced, sloped) = setup.file.axis.travel_unit, PLANNED_ROWS * setup.dt, stated
    if paced and sloped and (words := unreached(move, unit)):
        raise ServiceError(f"{axis}: {words[0]}; nothing has moved")
    if move.duration <= longest or not (paced or sloped):
        return
    name = "speed" if paced else "acceleration"
    value = length(move.velocity, f"{unit}/s") if paced else length(move.acceleration, f"{unit}/s^2")
    reason = f"the move takes {move.duration:.3g} s, and {longest:g} s is the longest"
    raise ServiceError(Problem(reason, ProblemKind.LIMIT, name, value, remedy="nothing has moved; check the unit"))
