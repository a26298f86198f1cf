"""Clocks: the machine's monotonic clock, and one that runs at another rate."""

import time
from typing import Protocol


class Clock(Protocol):
    """A monotonic clock that one can wait on."""

    def now(self) -> float:
        """Seconds since any fixed instant."""

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of this clock."""


class WallClock:
    """The machine's own monotonic clock; without a call of ours in between."""

    now = staticmethod(time.monotonic)
    sleep = staticmethod(time.sleep)


WALL = WallClock()


class SkewedClock:
    """A clock that runs `rate` seconds in one second of its base; the rate may change at any time."""

    def __init__(self, base: Clock) -> None:
        self._base, self._rate = base, 1.0
        self._since = self._shown = base.now()

    def now(self) -> float:
        """Time of this clock (s)."""
        return self._shown + self._rate * (self._base.now() - self._since)

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of this clock."""
        self._base.sleep(seconds / self._rate)

    def run_at(self, rate: float) -> None:
        """Go on at another rate from now, without a jump."""
        self._shown, self._since = self.now(), self._base.now()
        self._rate = rate
