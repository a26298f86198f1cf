"""The homing mode of a foreign drive (CiA 402-2, clause 9): to a switch below it, or what may go wrong."""

from __future__ import annotations

from collections.abc import Callable

from tests.zoo.plant import COUNTS, LEAD, METRES_PER_RAD

HM = 6  # mode of operation
SWITCH = -1e-3  # m: closed below
_REACHED, _ATTAINED, _ERROR = 1 << 10, 1 << 12, 1 << 13
_GAIN = 0.3  # A s/rad of its velocity loop
_STILL = 0.02  # rad/s
_COUNTS = COUNTS / LEAD  # per m


class Homing:
    """One homing; `kind` says how it goes."""

    def __init__(self, kind: str, number: Callable[[int], int]) -> None:
        """`number` gives the value of an object by its key."""
        self.kind, self._number = kind, number
        self.origin = 0  # counts
        self._bits, self._begun, self._edge, self._wanted = _REACHED, False, 0, 0.0
        self._back = False

    @property
    def bits(self) -> int:
        """Of the statusword, in this mode."""
        return self._bits

    def order(self, start: bool) -> None:
        """An edge of bit 4."""
        self._begun, self._back, self._wanted = start, False, 0.0
        self._bits = 0 if start else self._bits & _ATTAINED | _REACHED
        if start and self.kind == "here":
            self._bits, self.origin, self._begun = _ATTAINED | _REACHED, self._edge, False
        elif start:
            self._wanted = -self._speed(1)

    def _speed(self, sub: int) -> float:
        return self._number(0x609900 | sub) / _COUNTS / METRES_PER_RAD  # rad/s

    def current(self, angle: float, speed: float) -> float:
        """A, of its own velocity loop; looks where it is, too."""
        table = angle * METRES_PER_RAD
        if not self._begun:
            self._edge = round(table * _COUNTS)
        elif self.kind == "error" and table < 0.3 * SWITCH:
            self._begun, self._wanted, self._bits = False, 0.0, _ERROR
        elif self.kind == "switch" and not self._back and table < SWITCH:
            self._back, self._wanted = True, self._speed(2)
        elif self._back and table > SWITCH and self._wanted:
            self._edge, self._wanted = round(table * _COUNTS), 0.0
        elif self._back and not self._wanted and abs(speed) < _STILL:
            self._begun, self.origin, self._bits = False, self._edge, _ATTAINED | _REACHED
        return _GAIN * (self._wanted - speed) + (0.5 if self._wanted > 0.0 else -0.5 if self._wanted else 0.0)
