"""Supervision of the controller by the virtual drive: its heartbeat and the deadline of its cyclic command."""


class Watchdog:
    """Trips once after `timeout` without a message; armed by the first message."""

    def __init__(self, code: int, what: str) -> None:
        """What its trip is: an emergency of this `code`, and `what` in plain words."""
        self.code, self.what = code, what
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

    def check(self, now: float) -> float | None:
        """The silence (s), in the moment in which it is noticed; None before and after."""
        silence = now - self._heard
        if not self.armed or self.timeout <= 0.0 or silence <= self.timeout:
            return None
        self.armed, self.tripped = False, True
        return silence
