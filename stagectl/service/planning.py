"""Motions laid out for a service: a task that can be sent to another process, and what becomes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.kernels.feedforward import Feedforward
from stagectl.motion_limits import check_duration, check_noticeable
from stagectl.plan import Plan, Start, plan
from stagectl.problem import Problem
from stagectl.service.limits import PLANNED_ROWS
from stagectl.trajectories import Experiment, phases


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


class Motion(NamedTuple):
    """A motion that is laid out and goes, or has gone."""

    name: str
    rows: bytes  # empty while it is on its way from the planning process
    length: int  # rows
    span: tuple[float, float]  # rad | m, lowest and highest position, from where it begins
    left: Start  # what it leaves of the friction; its position is that of its beginning
    limited: str = ""  # words, where the current against the model's effects was limited


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
    check_duration(phases(trajectory).duration, setup.dt, PLANNED_ROWS)
    start = task.start.copy()
    laid_out = plan(setup, trajectory, task.feedforward, start)
    rows = np.ascontiguousarray(laid_out.setpoints)
    if isinstance(task.trajectory, Upload):  # an order may move less, to where the axis nearly is
        check_noticeable(setup, rows[:, 0], laid_out.duration)
    span = (float(rows[:, 0].min()), float(rows[:, 0].max()))
    left = start._replace(effects=laid_out.effects)
    return Motion(task.name, b"", len(rows), span, left, _limited(task, laid_out)), rows


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
