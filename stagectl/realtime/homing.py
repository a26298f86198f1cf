"""Finding the home: move slowly to the switch, index or end stop, come to rest, count from that place.

The host does it itself, in the same loop as every motion, so that no other controller's target fights the following
error; or the drive does (mode of operation 6), and the host watches.  The place of the host's search is that of the
period in which the signal came: at 1 mm/s and 2 kHz within 0.5 um.
"""

from stagectl.drives.drive import Fault, Feedback
from stagectl.drives.homing import Homing
from stagectl.realtime import safety


class Search:
    """One search: `look` runs every period and reports when the home was passed."""

    FELT = 0.005  # s for which the current must stay above its limit

    def __init__(self, p: Homing, start: float, dt: float) -> None:
        self._p, self._start, self._dt = p, start, dt
        self._before: bool | None = None
        self._felt = 0.0
        self.found: float | None = None

    def look(self, position: float, current: float, statusword: int) -> bool:
        """Whether the home is passed in this period."""
        if self.found is None and self._signal(current, statusword):
            self.found = position
            return True
        return False

    def too_far(self, position: float) -> bool:
        """Whether the search has gone further than homing.distance."""
        return self.found is None and abs(position - self._start) > self._p.distance

    def _signal(self, current: float, statusword: int) -> bool:
        if self._p.method == "current":
            self._felt = self._felt + self._dt if abs(current) > self._p.current else 0.0
            return self._felt > self.FELT
        on, before = bool(statusword >> self._p.bit & 1), self._before
        self._before = on
        if self._p.method == "limit":
            return on
        return on and before is False  # an edge: a start on the index does not show where it begins


class DriveSearch:
    """The drive's own search, watched: how far, how long, with how much current."""

    def __init__(self, p: Homing, start: float) -> None:
        """From the position `start` (rad | m)."""
        self._p, self._start, self._before = p, start, start
        self._counted = False  # from its home: the origin has jumped

    def judge(self, limits: safety.Envelope, seen: Feedback, heat: float, dt: float, elapsed: float) -> Fault:
        """What is wrong in this period of `dt` (s), `elapsed` (s) after its beginning; `heat` (A^2) of the motor."""
        moved, self._before = seen.position - self._before, seen.position
        leapt = safety.leap(limits, moved, dt) is not Fault.NONE
        if seen.fault is not Fault.NONE:
            return seen.fault
        if leapt and self._counted:
            return Fault.SPEED  # an origin jumps once: the axis moves
        if leapt:
            self._counted = True
            self._start += moved  # the drive counts from its home now; the axis has not moved so far
        if abs(seen.current) > limits.current:
            return Fault.CURRENT
        too_far = self._p.moves and abs(seen.position - self._start) > self._p.distance
        return Fault.HOMING if too_far or elapsed > self._p.longest else safety.overloaded(limits, heat)
