"""Supervision of the controller by the virtual drive: its heartbeat and the deadline of its cyclic command."""

from __future__ import annotations

from typing import NamedTuple


class LostPartner(NamedTuple):
    """A partner whose messages ceased."""

    code: int  # emergency error code
    what: str  # in plain words
    silence: float  # s
    timeout: float  # s


class Watchdog:
    """Trips once after `timeout` without a message; armed by the first message."""

    def __init__(self, code: int, what: str) -> None:
        """Report `code` (EMCY) and `what` (words) when it trips."""
        self._code, self._what = code, what
        self.timeout = 0.0  # s; 0: off
        self._heard = 0.0
        self.armed = self.tripped = False

    def alive(self, now: float) -> bool:
        """A sign of life at `now` (s); True where the partner had been lost."""
        self._heard, self.armed = now, True
        returned, self.tripped = self.tripped, False
        return returned

    def disarm(self) -> None:
        """Expect nothing until the next sign of life."""
        self.armed = False

    def check(self, now: float) -> LostPartner | None:
        """The loss, in the moment it is noticed; None before and after."""
        silence = now - self._heard
        if not self.armed or self.timeout <= 0.0 or silence <= self.timeout:
            return None
        self.armed, self.tripped = False, True
        return LostPartner(self._code, self._what, silence, self.timeout)
