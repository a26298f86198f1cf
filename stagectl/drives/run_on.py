r"""How far an axis goes on once its controller is lost, and which time-out keeps it within a free distance.

The worst case that the stage file knows: the controller dies at the speed limit, the drive holds the largest current in
the direction of motion until its time-out is over, then stops by its own ramp::

    v |      _/\            a: largest current, against no friction      b: ramp, as far as that current carries it
      | ____/   \_
      |           \_        distance(T) = (v0 + v1)/2 T + v1^2 / (2 b)      with  v1 = v0 + a T
      |_____________\___ t
           T

Compared with a stop that begins at once, v0^2/(2 b), the time-out costs  (1 + a/b) (v0 T + a T^2/2).
"""

import math
from typing import NamedTuple

from stagectl.number_format import Travel


class RunOn(NamedTuple):
    """An axis that its controller has left, in rad or m and s."""

    speed: float  # as it is left
    acceleration: float  # by the largest current; above 0
    deceleration: float  # of the stop that follows; 0: nothing stops it

    def distance(self, timeout: float) -> float:
        """Way (rad | m) until it stands, where the drive notices after `timeout` (s); inf where nothing stops it."""
        fastest = self.speed + self.acceleration * timeout
        braked = fastest * fastest / (2.0 * self.deceleration) if self.deceleration > 0.0 else math.inf
        return 0.5 * (self.speed + fastest) * timeout + braked

    def cost(self, timeout: float) -> float:
        """Way (rad | m) that it goes further than by a stop at once; inf where nothing stops it."""
        if self.deceleration <= 0.0:
            return math.inf
        stretch = 1.0 + self.acceleration / self.deceleration
        return stretch * timeout * (self.speed + 0.5 * self.acceleration * timeout)

    def longest(self, free: float) -> float:
        """The time-out (s) whose `cost` is `free` (rad | m); 0 where nothing stops the axis."""
        if self.deceleration <= 0.0:
            return 0.0
        way = free / (1.0 + self.acceleration / self.deceleration)
        # the root of a T^2/2 + v T - way, in the form that keeps its digits where a or v is small
        return 2.0 * way / (self.speed + math.sqrt(self.speed**2 + 2.0 * self.acceleration * way))


class AxisLimits(NamedTuple):
    """What the stage file says of an axis, as far as the drive's own limits must agree with it."""

    current: float  # A, the largest that is commanded; 0: nothing is known of the axis
    speed: float  # rad/s | m/s
    travel: Travel
    braking: RunOn  # where the drive stops by its ramp
    coasting: RunOn  # where it only cuts the power, and friction stops the axis
    waits_for_sync: bool = False  # a virtual plant, which stands still while no SYNC comes

    def words(self, timeout: float, brakes: bool) -> str:
        """What a controller's death costs where the drive notices after `timeout` (s) and `brakes`, or coasts."""
        run = self.braking if brakes else self.coasting
        if math.isinf(run.distance(timeout)):
            return f"nothing that the stage file knows stops the axis after {timeout * 1e3:.0f} ms"
        still = "; this virtual plant stands still while no SYNC comes" if self.waits_for_sync else ""
        return (
            f"from {self.travel.length(run.speed, '/s')} at the largest current, {self.current:g} A, it stands within"
            f" {self.travel.length(run.distance(timeout))}; the time-out costs"
            f" {self.travel.length(run.cost(timeout))} of it{still}"
        )

    def place(self, position: float) -> str:
        """A position (rad | m) as travel, in mm or deg."""
        travel = position * self.travel.per_unit
        return f"{math.degrees(travel):.6g} deg" if self.travel.unit == "rad" else f"{travel * 1e3:.6g} mm"


UNKNOWN_AXIS = AxisLimits(0.0, 0.0, Travel(1.0, "m", False), RunOn(0.0, 0.0, 0.0), RunOn(0.0, 0.0, 0.0))
