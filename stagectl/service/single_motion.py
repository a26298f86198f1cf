"""One motion on a drive: start the loop and its recorder, watch them, report how it went.

::

    this process -- job, board -> real-time process (axes.py) == CAN == drive (virtual: a process of its own)
         |                        | ring in shared memory
         +------ order -------> recorder process ---> recording.h5
         +------ order -------> companion, e.g. the live twin (twin/process.py): reads the ring, nothing else
"""

import contextlib
import json
import math
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import DriveError, Fault
from stagectl.kernels import law, rollout
from stagectl.plan import Plan
from stagectl.realtime import safety
from stagectl.realtime import shared_memory as boards
from stagectl.realtime.axes import Post
from stagectl.realtime.shared_memory import Board, Move
from stagectl.realtime.states import Event
from stagectl.recording.recorder import Order
from stagectl.recording.ring import Ring
from stagectl.service.child_process import Child, Companion, running_companion, start
from stagectl.service.job_from_stage import orders, post, relative
from stagectl.service.shutdown_signals import heard, taken_by

Progress = Callable[[int, int], None]  # (cycles done, cycles in all)


class Motion(NamedTuple):
    """What to run, and where to record it."""

    setup: Setup
    plan: Plan
    law: law.Law
    meta: dict[str, Any]
    recording: Path
    companion: Companion | None = None
    located: Callable[[float], Plan] | None = None  # the plan from another position (rad | m), where it depends on it
    reset_fault: bool = False  # of the drive, before the motion: a person has asked for it


def starting_at(motion: Motion, position: float) -> Motion:
    """The motion laid out for an axis that stands at `position` (rad | m).

    Raises DriveError where the position matters and is not known.
    """
    if motion.located is None:
        return motion
    if math.isnan(position):
        raise DriveError(
            "the model has effects that depend on the position, and the drive does not say where the axis stands:"
            " run it with `--without effects`"
        )
    rows = motion.plan.setpoints.copy()
    columns = [law.SETPOINT_COLUMNS[name] for name in ("target", "feedforward", "friction")]
    rows[:, columns] = motion.located(position).setpoints[:, columns]  # the rest is relative, or was learned
    return motion._replace(plan=motion.plan._replace(setpoints=rows))


class Shared(NamedTuple):
    """What this process and the loop's have in common."""

    ring: Ring
    board: Board


class Ended(NamedTuple):
    """The loop's report of the motion."""

    cycles: int
    late: int
    fault: int
    words: str
    reason: str
    refused: list[str]  # what the kernel refused
    recorded: bool  # whether the recorder wrote all of it
    companion: int | None  # exit code of the companion; None: there was none


def move(motion: Motion, progress: Progress) -> Ended:
    """Run the motion to its end or its first fault.

    Raises DriveError where the drive cannot be reached or enabled, or the loop's process dies.
    """
    motion.recording.parent.mkdir(parents=True, exist_ok=True)
    shared = Shared(Ring.create(rollout.WIDTH), Board.create(len(motion.plan.setpoints)))
    ring, board = shared
    alive, held = os.pipe()
    with (
        closed_after(ring.descriptor, board.descriptor, alive),
        running_companion(motion.companion, ring, alive) as (companion, codes),
        started("recorder", (ring.descriptor, alive)) as recorder,
        started("loop", (ring.descriptor, board.descriptor, held)) as loop,
    ):
        os.close(held)
        loop.send(posted(motion, shared))
        ready = event_of(loop, "ready")
        motion = starting_at(motion, ready["position"])
        if companion is not None:
            companion.say(repr(float(ready["position"])))
        meta = {**motion.meta, "drive": ready["drive"], "origin": ready["position"]}
        recorder.send(Order(ring.place, alive, str(motion.recording), meta, rollout.COLUMNS))
        if (said := recorder.line()) != "ready":
            raise DriveError(f"{said or 'the recorder did not start'}; nothing has moved")
        board.order(boards.Order(Event.ENABLE))
        board.order(laid_on(board, motion.plan.setpoints))
        loop.say("go")
        ended = _follow(loop, ring, len(motion.plan.setpoints), progress)
        recorded = recorder.wait() == 0
    facts = {name: ended[name] for name in ("cycles", "late", "fault", "words", "reason")}
    return Ended(**facts, refused=ready["refused"], recorded=recorded, companion=codes[0] if codes else None)


def laid_on(board: Board, rows: NDArray[np.float64]) -> boards.Order:
    """Put the setpoints (n, 8) of a motion on the board; the order that begins it."""
    first = board.filled
    board.fill(np.ascontiguousarray(rows).tobytes())
    span = float(rows[:, 0].min()), float(rows[:, 0].max())
    return boards.Order(Event.MOVE, Move(float(first), float(len(rows)), *span, 1.0))


def _follow(loop: Child, ring: Ring, total: int, progress: Progress) -> dict[str, Any]:
    """Show progress from the ring until the loop says that it has ended; hand an interrupt on to it."""
    with _handing_on(loop) as stops:
        while not loop.readable(0.05):
            progress(ring.written, total)
        ended = event_of(loop, "ended")
        progress(ended["cycles"], total)
    if stops and not ended["fault"]:  # it came with the last period: what would follow is not wanted either
        ended |= {"fault": Fault.OPERATOR, "words": safety.words(Fault.OPERATOR)}
    return ended


@contextlib.contextmanager
def _handing_on(loop: Child) -> Iterator[list[int]]:
    """What ends a command stops the axis, whatever goes on here; then the loop is heard out.  Yields what came.

    A KeyboardInterrupt can be lost, and a shell's background process inherits SIGINT as ignored.
    """
    came: list[int] = []

    def hand_on(number: int, _: object) -> None:
        came.append(number)
        loop.signal(signal.SIGINT)

    with taken_by(hand_on, heard()):
        yield came


def posted(motion: Motion, shared: Shared) -> Post:
    """The order of the real-time process for this motion."""
    setup = motion.setup
    friction = "friction" in setup.file.control.layers
    axis = orders(setup.file.name, setup, motion.law, friction, *shared)
    job = post(setup, [relative(axis)], single=True)
    return job._replace(reset=motion.reset_fault)


def event_of(process: Child, expected: str) -> dict[str, Any]:
    """The next event of the loop, which must be `expected`.  Raises DriveError with the loop's reason otherwise."""
    line = process.line()
    if not line and expected == "ready":
        raise DriveError("the real-time process did not start, nothing has moved; see the message above")
    if not line:
        raise DriveError("the real-time process died; the drive stops by itself within its heartbeat time-out")
    event: dict[str, Any] = json.loads(line)
    if event["event"] != expected:
        raise DriveError(event.get("reason", f"the real-time process reported {event['event']} instead of {expected}"))
    return event


@contextlib.contextmanager
def closed_after(*descriptors: int) -> Iterator[None]:
    """Close them when the processes have ended: a campaign is many motions."""
    try:
        yield
    finally:
        for descriptor in descriptors:
            os.close(descriptor)


@contextlib.contextmanager
def started(part: str, descriptors: tuple[int, ...]) -> Iterator[Child]:
    """A part of a motion as a process, the ``loop`` or the ``recorder``; at the end the axis stands and it is gone."""
    module = {"loop": "stagectl.realtime.axes", "recorder": "stagectl.recording.recorder"}[part]
    child = start(module, descriptors, "interpreted")  # no numba in their memory
    try:
        yield child
    finally:
        if part == "loop":
            child.terminate()  # it stops the axis and leaves; then the recorder ends by itself
        child.wait()
