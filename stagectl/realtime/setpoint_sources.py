"""Where the setpoints of a powered axis come from: a held position, rows that were planned, or a ramp of speed."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from stagectl.kernels.law import Setpoint
from stagectl.realtime.shared_memory import Board


class Source(Protocol):
    """A supply of setpoints."""

    over: bool  # the last one was given: it is held from now on

    def next(self, passed: int) -> Setpoint | None:
        """The setpoint `passed` periods after the last one; None where it is not there yet."""


class Hold:
    """One position, for ever."""

    over = False

    def __init__(self, position: float, friction: float = 0.0) -> None:
        self._held = held(position, friction)

    def next(self, passed: int) -> Setpoint:
        """The same each time."""
        return self._held


def held(position: float, friction: float) -> Setpoint:
    """Stand at `position` (rad | m) with the current (A) that the loaded friction needs."""
    return Setpoint(position, position, 0.0, friction)


class Rows:
    """Rows that the service has planned, relative to where the motion begins."""

    def __init__(self, board: Board, first: int, count: int, origin: float) -> None:
        self._board, self._first, self.count, self._origin = board, first, count, origin
        self.row, self._last, self.over = -1, -1, False

    def next(self, passed: int) -> Setpoint | None:
        """The row that is due; after a stall the rows between are left out, as the axis did not wait either."""
        row = min(self.row + passed, self.count - 1)
        found = self._board.setpoint(self._first + row)
        if found is None:
            return None
        self.row, self.over = row, row == self.count - 1
        reference, target, *known = found
        return Setpoint(reference + self._origin, target + self._origin, *known)


class Model(NamedTuple):
    """What a ramp must know of the axis to feed forward."""

    dt: float  # s
    acceleration: float  # rad/s^2 | m/s^2, of ramps
    inertia: float  # A s^2/rad | A s^2/m, J/Kt
    viscous: float  # A s/rad | A s/m, D/Kt
    friction: float  # A, sliding friction that is compensated
    late: float  # s, of the measurement


class Ramp:
    """From one speed to another at the model's acceleration; over when the goal is 0 and reached."""

    def __init__(self, p: Model, start: Setpoint, speed: float, goal: float) -> None:
        """Begin at the reference of `start` with `speed` (rad/s | m/s); its friction is kept where it brakes."""
        self._p, self._position, self._speed, self._goal = p, start.reference, speed, goal
        self._friction = start.friction
        self.over = False

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

    @property
    def stops_at(self) -> float:
        """Where it comes to rest if it brakes now (rad | m)."""
        return self._position + math.copysign(self._speed * self._speed / (2.0 * self._p.acceleration), self._speed)
