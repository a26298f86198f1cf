"""Where the setpoints of a powered axis come from: a held position, rows that were planned, or a ramp of speed."""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.kernels.law import Setpoint
from stagectl.realtime.shared_memory import Board


class Source:
    """A supply of setpoints."""

    over = False  # the last one was given: it is held from now on

    def next(self, passed: int) -> Setpoint | None:
        """The setpoint `passed` periods after the last one; None where it is not there yet."""
        raise NotImplementedError

    def prepare(self) -> None:
        """Have the next one ready, where that takes time: it is then no part of the reaction to the position."""


class Hold(Source):
    """One setpoint, for ever."""

    def __init__(self, setpoint: Setpoint) -> None:
        self._held = setpoint

    def next(self, passed: int) -> Setpoint:
        """The same each time."""
        return self._held


def held(position: float, friction: float) -> Setpoint:
    """Stand at `position` (rad | m) with the current (A) that the loaded friction needs."""
    return Setpoint(position, position, 0.0, friction)


def stopped(asked: Setpoint, by: float = 0.0) -> Setpoint:
    """Stand where `asked` has led, on positions that are smaller `by` (rad | m).

    What the encoder's map adds to the reference stays: without it the axis would jump as a motion ends.
    """
    return Setpoint(asked.reference - by, asked.target - by, 0.0, asked.friction)


def caught(p: Model, position: float, speed: float) -> Setpoint:
    """Where a loop closes that was open: at the measured `position` (rad | m), against the friction of its `speed`.

    `speed` in rad/s | m/s.
    """
    return held(position + p.late * speed, math.copysign(p.friction, speed) if speed != 0.0 else 0.0)


class Rows(Source):
    """Rows of a motion that are on the board, relative to where it begins."""

    def __init__(self, board: Board, first: int, count: int, origin: float) -> None:
        self._board, self._first, self.count, self._origin = board, first, count, origin
        self.row, self._last = -1, count - 1
        self._prepared, self._ready = -1, held(origin, 0.0)  # number and content of a row that was fetched
        self.prepare()

    def next(self, passed: int) -> Setpoint | None:
        """The row that is due; after a stall the rows between are left out, as the axis did not wait either."""
        row = self.row + passed
        if row != self._prepared:
            row = min(row, self._last) if self.row >= 0 else 0  # a motion begins with its first row, however late
            if row != self._prepared and not self._fetch(row):
                return None
        self.row, self.over = row, row == self._last
        return self._ready

    def prepare(self) -> None:
        """Fetch the row that is due in the next period."""
        if self.row < self._last:
            self._fetch(self.row + 1)

    def _fetch(self, row: int) -> bool:
        """Whether this row is on the board; then it is ready."""
        fetched = self._board.setpoint(self._first + row, self._origin)
        if fetched is None:
            return False
        self._prepared, self._ready = row, fetched
        return True


class Model(NamedTuple):
    """What a ramp must know of the axis to feed forward."""

    dt: float  # s
    acceleration: float  # rad/s^2 | m/s^2, of ramps
    inertia: float  # A s^2/rad | A s^2/m, J/Kt
    viscous: float  # A s/rad | A s/m, D/Kt
    friction: float  # A, sliding friction that is compensated
    late: float  # s, of the measurement


class Ramp(Source):
    """From one speed to another at the model's acceleration; over when the goal is 0 and reached."""

    def __init__(self, p: Model, start: Setpoint, speed: float, goal: float) -> None:
        """Begin at the reference of `start` with `speed` (rad/s | m/s); its friction is kept where it brakes."""
        self._p, self._position, self._speed, self._goal = p, start.reference, speed, goal
        self._friction = start.friction

    def next(self, passed: int) -> Setpoint:
        """The reference one period on, or more after a stall."""
        p, time = self._p, self._p.dt * passed
        change = min(max(self._goal - self._speed, -p.acceleration * time), p.acceleration * time)
        self._position += (self._speed + 0.5 * change) * time
        self._speed += change
        if self._goal != 0.0:
            self._friction = p.friction * self._speed / abs(self._goal)
        elif self._speed == 0.0:
            self.over = True
        current = p.inertia * change / time + p.viscous * self._speed
        late = self._position - p.late * self._speed
        return Setpoint(self._position, late, current, self._friction, self._speed)

    def brake(self) -> None:
        """Come to rest from here."""
        self._goal = 0.0
