"""Supervision of a stop by the drive's own ramp: whether the axis slows down."""

import collections
import enum
import itertools

from stagectl.drives import limits


class SpeedEstimate:
    """Speed (rad/s | m/s) of the last samples, robust against outliers."""

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self._positions: collections.deque[float] = collections.deque(maxlen=limits.SPEED_WINDOW + 1)
        self.add = self._positions.append

    @property
    def speed(self) -> float:
        """Median over the window; 0 where there is none yet."""
        positions = list(self._positions)
        steps = sorted(abs(after - before) for before, after in itertools.pairwise(positions))
        half = len(steps) // 2  # by hand: `statistics` loads fractions and decimals into the real-time process
        return (steps[half] + steps[~half]) / 2.0 / self.dt if steps else 0.0


class ConsecutiveCycles:
    """A condition that must hold for several cycles in a row: one corrupted frame proves nothing."""

    def __init__(self, cycles: int = limits.CERTAIN_CYCLES) -> None:
        self._wanted, self._cycles = cycles, 0

    def certain(self, now: bool) -> bool:
        """Whether it has held long enough, with `now` for the latest cycle."""
        self._cycles = self._cycles + 1 if now else 0
        return self._cycles >= self._wanted


class BrakingFailure(enum.Enum):
    """Why a stop by the drive's own ramp does not go as it should."""

    NONE = 0
    SILENT = 1  # the drive no longer answers
    FASTER = 2  # the axis accelerates: what should brake it has failed
    UNBRAKED = 3  # it goes on as before


FAILURE_TEXTS = {  # the failures after which the power is cut
    BrakingFailure.FASTER: "the axis became faster under its quick stop: the power was cut",
    BrakingFailure.UNBRAKED: "the axis was not braked by its quick stop: the power was cut",
}


class BrakingMonitor:
    """One stop by the drive's own ramp, cycle by cycle."""

    def __init__(self, pace: SpeedEstimate, deceleration: float) -> None:
        """From the `pace` at which it begins, on a ramp of `deceleration` (rad/s^2 | m/s^2)."""
        self._pace, self._silent = pace, ConsecutiveCycles(limits.SILENT_CYCLES)
        self._faster, self._unbraked = ConsecutiveCycles(), ConsecutiveCycles()
        self._limit = limits.FASTER_FACTOR * pace.speed + limits.FASTER_SLACK * deceleration
        self._half = 0.5 * pace.speed + limits.CREEP * deceleration
        self._cycles = 0
        self._long = (limits.LONGER_FACTOR * pace.speed / deceleration + limits.SETTLING_TIME) / pace.dt

    def step(self, silent: bool) -> BrakingFailure:
        """The failure seen in this cycle, in which the drive was `silent` or not."""
        self._cycles += 1
        if self._silent.certain(silent):
            return BrakingFailure.SILENT
        speed = 0.0 if silent else self._pace.speed
        if self._faster.certain(speed > self._limit):
            return BrakingFailure.FASTER
        late = self._unbraked.certain(self._cycles > self._long and speed > self._half)
        return BrakingFailure.UNBRAKED if late else BrakingFailure.NONE
