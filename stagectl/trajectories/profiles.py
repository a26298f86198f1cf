r"""Point-to-point moves within limits: as fast as velocity, acceleration and jerk allow, and no faster.

::

    trapezoid   velocity        s_curve   acceleration
                   ______                  ____
                  /      \                /    \  reached: jerk +, 0, -, 0, -, 0, +
                 /        \          ____/      \_____________         _____
                /          \                                 \_____/
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
import numpy.typing as npt

from stagectl.number_format import length
from stagectl.trajectories.bounds import FAR_BELOW
from stagectl.trajectories.motion import Array, Motion, contained
from stagectl.units import Quantity

_Distance = Annotated[
    float, Quantity("m", "[-1e6, 1e6]", "distance of one move; its sign is the direction, and 0 is refused")
]
_Speed = Annotated[float, Quantity("m/s", "[1e-9, 1e6]", "limit, reached where the distance allows")]
_Stop = Annotated[float, Quantity("s", "[0, 86400]", "standstill after each move")]
_Cycles = Annotated[int, Quantity("", "[1, 10000000]", "moves there and back; with one_way: moves")]
_OneWay = Annotated[bool, "each move begins at the end of the last, without a way back"]


class Dwell(NamedTuple):
    """Standing still."""

    duration: Annotated[float, Quantity("s", "(0, 86400]", "how long")]

    @property
    def end(self) -> float:
        """Where it stands (m)."""
        return 0.0

    def at(self, t: npt.ArrayLike) -> Motion:
        """Zeros at the times `t` (n,) s."""
        zero = np.zeros(np.shape(t))
        return Motion(zero, zero.copy(), zero.copy())


class Trapezoid(NamedTuple):
    """Moves of constant acceleration; a triangle where the velocity is not reached."""

    distance: _Distance
    velocity: _Speed
    acceleration: Annotated[float, Quantity("m/s^2", "[1e-9, 1e9]", "acceleration of both ramps")]
    dwell: _Stop = 0.0
    cycles: _Cycles = 1
    one_way: _OneWay = False

    @property
    def duration(self) -> float:
        """All moves and dwells (s)."""
        return _legs(self) * (self._phases.time[-1] + self.dwell)

    @property
    def end(self) -> float:
        """Position afterwards (m)."""
        return _end(self)

    def at(self, t: npt.ArrayLike) -> Motion:
        """Motion at the times `t` (n,) s; the acceleration jumps, and counts from its jump on."""
        return contained(lambda s: _moves(self, self._phases, s), t, self.duration, self.end)

    @property
    def _phases(self) -> _Phases:
        distance = abs(self.distance)
        speed = min(self.velocity, math.sqrt(distance * self.acceleration))
        rise = speed / self.acceleration
        cruise = max(distance / speed - rise, 0.0)
        a = self.acceleration
        return _integrated((rise, cruise, rise), (a, 0.0, -a), (0.0, 0.0, 0.0), distance)


class SCurve(NamedTuple):
    """Moves of limited jerk: the fastest symmetric seven-phase profile, from rest to rest."""

    distance: _Distance
    velocity: _Speed
    acceleration: Annotated[float, Quantity("m/s^2", "[1e-9, 1e9]", "limit, reached where the others allow")]
    jerk: Annotated[float, Quantity("m/s^3", "[1e-9, 1e12]", "jerk of all ramps of the acceleration")]
    dwell: _Stop = 0.0
    cycles: _Cycles = 1
    one_way: _OneWay = False

    @property
    def duration(self) -> float:
        """All moves and dwells (s)."""
        return _legs(self) * (self._phases.time[-1] + self.dwell)

    @property
    def end(self) -> float:
        """Position afterwards (m)."""
        return _end(self)

    def at(self, t: npt.ArrayLike) -> Motion:
        """Motion at the times `t` (n,) s."""
        return contained(lambda s: _moves(self, self._phases, s), t, self.duration, self.end)

    @property
    def _phases(self) -> _Phases:
        """Phases of one move: ramp the acceleration for `turn`, hold it for `push`, cruise.

        With the acceleration reached ``A = J turn`` and the speed reached ``V = A (turn + push)`` a move
        without cruise covers ``V (2 turn + push)``; each phase takes the most that all limits leave it.
        """
        distance, j = abs(self.distance), self.jerk
        turn = min(self.acceleration / j, math.sqrt(self.velocity / j), math.cbrt(0.5 * distance / j))
        a = j * turn
        by_distance = 0.5 * (math.sqrt(turn * turn + 4.0 * distance / a) - 3.0 * turn)
        push = max(min(by_distance, self.velocity / a - turn), 0.0)
        cruise = max(distance / (a * (turn + push)) - (2.0 * turn + push), 0.0)
        durations = (turn, push, turn, cruise, turn, push, turn)
        return _integrated(durations, (0.0, a, a, 0.0, 0.0, -a, -a), (j, 0.0, -j, 0.0, -j, 0.0, j), distance)


class _Phases(NamedTuple):
    """One move in the positive direction: what holds at the start of each phase, lastly of the standstill."""

    time: list[float]
    position: list[float]
    velocity: list[float]
    acceleration: list[float]
    jerk: list[float]


def _integrated(
    durations: tuple[float, ...], acceleration: tuple[float, ...], jerk: tuple[float, ...], distance: float
) -> _Phases:
    """Integrate from rest; standstill is put exactly at `distance` (m), not where rounding led."""
    time, x, v = [0.0], [0.0], [0.0]
    for h, a, j in zip(durations, acceleration, jerk, strict=True):
        time.append(time[-1] + h)
        x.append(x[-1] + h * (v[-1] + h * (0.5 * a + h * j / 6.0)))
        v.append(v[-1] + h * (a + 0.5 * h * j))
    x[-1], v[-1] = distance, 0.0
    return _Phases(time, x, v, [*acceleration, 0.0], [*jerk, 0.0])


def _legs(p: Trapezoid | SCurve) -> int:
    return p.cycles if p.one_way else 2 * p.cycles


def _end(p: Trapezoid | SCurve) -> float:
    return p.cycles * p.distance if p.one_way else 0.0


def _moves(p: Trapezoid | SCurve, phases: _Phases, t: Array) -> Motion:
    """All moves of `p` at the times `t` (n,) s within its duration."""
    lap = phases.time[-1] + p.dwell
    leg = np.minimum(np.floor(t / lap), _legs(p) - 1)
    move = _move(phases, np.maximum(t - leg * lap, 0.0))
    back = np.zeros(t.shape) if p.one_way else leg % 2.0
    start = p.distance * (leg if p.one_way else back)
    way = math.copysign(1.0, p.distance) * (1.0 - 2.0 * back)
    return Motion(start + way * move.position, way * move.velocity, way * move.acceleration)


def _move(phases: _Phases, t: Array) -> Motion:
    """One move from 0, at the times `t` (n,) s >= 0."""
    index = np.searchsorted(phases.time, t, side="right") - 1
    start, x, v, a, j = (np.asarray(column)[index] for column in phases)
    h = t - start
    # Rounding must not lead beyond the end: a limit may lie exactly there.
    place = np.minimum(x + h * (v + h * (0.5 * a + h * j / 6.0)), phases.position[-1])
    return Motion(place, v + h * (a + 0.5 * h * j), a + h * j)


def unreached(motion: object, unit: str) -> list[str]:
    """A note on each move in a trajectory that stays far below its own velocity; `unit` is that of its travel.

    A unit is mistaken there more often than it is meant.
    """
    if not isinstance(motion, Trapezoid | SCurve):
        return list(dict.fromkeys(words for part in getattr(motion, "parts", ()) for words in unreached(part, unit)))
    top = max(motion._phases.velocity)
    if top >= FAR_BELOW * motion.velocity:
        return []
    others = "acceleration" if isinstance(motion, Trapezoid) else "acceleration and jerk"
    return [
        f"velocity = {length(motion.velocity, f'{unit}/s')} is never reached, the top is {length(top, f'{unit}/s')}, "
        f"and all of it takes {motion.duration:.3g} s: check the units of distance, velocity, {others}"
    ]
