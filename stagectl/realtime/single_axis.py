"""An axis under `run`: it gets power, makes one motion and is left; its ring has the rows of the motion alone."""

import math

from stagectl.drives.drive import Fault
from stagectl.realtime.axis import Axis
from stagectl.realtime.setpoint_sources import Rows
from stagectl.realtime.states import State

_NAN = math.nan
_MOVING = State.MOVING  # looked up once, see `axis`
_OVER = (State.STANDING, State.DISABLED, State.FAULT, State.OFFLINE)


class SingleAxis(Axis):
    """One axis, one motion: what differs from an axis that is served is what is written down of it."""

    late_rows = 0

    @property
    def over(self) -> bool:
        """Whether the motion has ended, was refused, or cannot begin."""
        return self.state in _OVER

    def write(self, lateness: float, late: bool, fault: Fault) -> None:
        """A row of each period of the motion, at the time of its setpoint."""
        source, seen = self.source, self.seen
        if self.state is _MOVING and isinstance(source, Rows):
            self.late_rows += late
            self.ring.write((
                source.row * self.dt, *self.asked, *self.output,
                seen.position, _NAN, seen.current, lateness, late, seen.statusword, fault,
            ))  # fmt: skip

    def rest(self) -> None:
        """Zero, but for the period in which power has come: the motion begins with the next one, as in `simulate`."""
        if self.state is not State.ENABLING or self.seen.fault is not Fault.NONE:
            super().rest()

    def refusal(self, here: str, goes: str, travel: str) -> str:
        """Why the motion is not begun, and what to do."""
        return f"the axis is at {here} and the motion would go to {goes}; {travel}: move the axis back, then run again"
