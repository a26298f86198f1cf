"""One trial under power: a real-time process as `run` starts it, with a slowly rising current in open loop.

::

    current  _/|_     from 0 to the test current in RAMP_TIME; the loop is open, so a wrong sign cannot run away
    position    ...   this process reads the ring, and acts when the axis moves: stop, kill -9, SIGSTOP

Whatever happens here, the loop stops the axis by itself at a small speed, and within a window around the start.
"""

import contextlib
import math
import signal
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import DriveError, Fault
from stagectl.kernels import feedback, law, rollout
from stagectl.realtime import safety
from stagectl.realtime import shared_memory as boards
from stagectl.realtime.axes import Post
from stagectl.realtime.shared_memory import Board
from stagectl.realtime.states import Event
from stagectl.recording.ring import Ring
from stagectl.service.child_process import Child
from stagectl.service.job_from_stage import orders, post, relative
from stagectl.service.single_motion import Shared, closed_after, event_of, laid_on, started
from stagectl.workflows.acceptance.limits import FALL_TIME, GUARD_SHARE, LOOK, LOOP_PATIENCE, SPEED_TIME
from stagectl.workflows.acceptance.traces import CURRENT, FLOWING, MEASURED


class Push(NamedTuple):
    """A current in open loop, and the window in which the axis may move."""

    currents: NDArray[np.float64]  # (n,) A, one a period
    limit: float  # A, at which the law clips
    low: float  # rad | m
    high: float


class Seen(NamedTuple):
    """The axis in its last period."""

    rows: int  # in all
    position: float  # rad | m
    speed: float  # rad/s | m/s, over SPEED_TIME
    current: float  # A, commanded
    flowing: float  # A, measured; NaN: the drive reports none


class Ended(NamedTuple):
    """How the loop ended by itself or by an order."""

    fault: Fault
    words: str
    stop_distance: float  # rad | m


class Trial:
    """A loop that moves the axis."""

    def __init__(self, loop: Child, shared: Shared, dt: float) -> None:
        self.loop, self._ring, self._board = loop, shared.ring, shared.board
        self._window = max(2, round(SPEED_TIME / dt))
        self._dt = dt

    def until(self, true: Callable[[Seen], bool], patience: float) -> Seen | None:
        """The axis when that is true of it; None where the loop ended before.  Raises DriveError."""
        end = time.monotonic() + patience + LOOP_PATIENCE
        while time.monotonic() < end:
            seen = self.seen()
            if seen is not None and true(seen):
                return seen
            if self.loop.readable(LOOK):
                return None
        raise DriveError("the real-time process neither moves the axis nor ends; it is stopped: see the messages above")

    def seen(self) -> Seen | None:
        """The axis now; None where it has not begun."""
        rows = self.rows(self._window)
        if not len(rows):
            return None
        position = rows[:, MEASURED]
        span = (len(rows) - 1) * self._dt
        speed = float(position[-1] - position[0]) / span if len(rows) == self._window else 0.0
        last = rows[-1]
        return Seen(self._ring.written, float(last[MEASURED]), speed, float(last[CURRENT]), float(last[FLOWING]))

    def rows(self, most: int) -> NDArray[np.float64]:
        """The last rows (n, WIDTH), at most so many."""
        first = max(0, self._ring.written - most)
        return np.frombuffer(self._ring.read(first, most)[1]).reshape(-1, rollout.WIDTH)

    def all_rows(self) -> tuple[int, NDArray[np.float64]]:
        """Number of the first row that is still in the ring, and the rows (n, WIDTH) from there on."""
        first, data = self._ring.read(0, self._ring.written)
        return first, np.frombuffer(data).reshape(-1, rollout.WIDTH)

    def stop(self) -> Ended:
        """Order the quick stop and wait for its end."""
        self._board.order(boards.Order(Event.QUICK_STOP))
        return self.end()

    def end(self) -> Ended:
        """How it ended; the loop must be on its way to it.  Raises DriveError with the loop's reason."""
        facts: dict[str, Any] = event_of(self.loop, "ended")
        words = f"{facts['words']}. {facts['reason']}".strip(". ")
        return Ended(Fault(facts["fault"]), words, self._board.status().stop_distance)

    def kill(self) -> None:
        """SIGKILL: nothing of the process acts any more, and no descriptor of it is open when this returns."""
        self.loop.signal(signal.SIGKILL)
        self.loop.wait()

    def freeze(self) -> None:
        """SIGSTOP: the process is there and sends nothing."""
        self.loop.signal(signal.SIGSTOP)


@contextlib.contextmanager
def trying(setup: Setup, push: Push) -> Iterator[Trial]:
    """Connect, switch power on, push; at the end the loop is gone.  Raises DriveError where the drive refuses.

    A fault of the drive is reset: the trial before this one has caused it, as `connected` has found none.
    """
    rows = np.zeros((len(push.currents), len(law.Setpoint._fields)))
    rows[:, law.SETPOINT_COLUMNS["injection"]] = push.currents
    with _begun(len(rows)) as (loop, shared):
        try:
            loop.send(_post(setup, shared, push)._replace(reset=True))
            event_of(loop, "ready")
            shared.board.order(boards.Order(Event.ENABLE))
            shared.board.order(laid_on(shared.board, rows))
            loop.say("go")
            yield Trial(loop, shared, setup.dt)
        finally:
            with contextlib.suppress(ProcessLookupError):
                loop.signal(signal.SIGCONT)  # a stopped process would not hear that it is to end


def connected(setup: Setup) -> dict[str, str]:
    """Set the drive up as `run` does, and leave it without power; what it reported.  Raises DriveError."""
    with _begun(1) as (loop, shared):
        nothing = Push(np.zeros(1), 0.0, -math.inf, math.inf)
        loop.send(_post(setup, shared, nothing))
        drive: dict[str, str] = event_of(loop, "ready")["drive"]
        loop.say("no")
        return drive


@contextlib.contextmanager
def _begun(rows: int) -> Iterator[tuple[Child, Shared]]:
    """A real-time process that waits for its job, and what it shares with this one: a board of so many rows."""
    shared = Shared(Ring.create(rollout.WIDTH), Board.create(rows))
    descriptors = (shared.ring.descriptor, shared.board.descriptor)
    with closed_after(*descriptors), started("loop", descriptors) as loop:
        yield loop, shared


def ramp(top: float, rise: float, dt: float) -> NDArray[np.float64]:
    """From 0 to `top` (A) in `rise` (s), and back in FALL_TIME."""
    falls = max(1, round(FALL_TIME / dt))
    return np.concatenate([np.linspace(0.0, top, max(2, round(rise / dt))), np.linspace(top, 0.0, falls)])


def _post(setup: Setup, shared: Shared, push: Push) -> Post:
    """The job of `run`'s process, in the window of this push; its law gives back no current of its own."""
    axis = orders(setup.file.name, setup, law.Law(feedback.Pid(0.0, 0.0, 0.0, 0.0), push.limit), False, *shared)
    envelope = axis.envelope._replace(
        low=push.low, high=push.high, speed=GUARD_SHARE * setup.file.limits.speed,
        freeze=safety.INF, breakaway=safety.INF,  # that it does not move yet is what the ramp finds out
    )  # fmt: skip
    return post(setup, [relative(axis)._replace(envelope=envelope)], single=True)
