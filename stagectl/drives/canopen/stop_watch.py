"""Whether an axis that is being stopped by its drive is being braked at all."""

from __future__ import annotations

import collections
import enum
import itertools

_WINDOW = 9  # samples over which a speed is taken: the median outlives a jump and a bent frame
_FASTER, _SLACK = 1.5, 5e-3  # times the first speed, plus so many s of the ramp: then it is not being braked
_LONGER, _SETTLES = 1.5, 0.06  # times the ramp, plus so many s: then half of the speed must be gone,
_CREEP = 5e-4  # or so many s of the ramp be left: what noise looks like
_CERTAIN = 3  # cycles for which something must be seen
_DEAF = 2  # answers missing in a row after which the bus is taken for out


class Pace:
    """Speed (rad/s | m/s) of the last samples, whatever one of them says."""

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self._positions: collections.deque[float] = collections.deque(maxlen=_WINDOW + 1)
        self.add = self._positions.append

    @property
    def speed(self) -> float:
        """Median over the window; 0 where there is none yet."""
        seen = list(self._positions)
        steps = sorted(abs(after - before) for before, after in itertools.pairwise(seen))
        half = len(steps) // 2  # by hand: `statistics` brings fractions and decimals into the real-time process
        return (steps[half] + steps[~half]) / 2.0 / self.dt if steps else 0.0


class Repeated:
    """Whether something was so for some cycles in a row: one bent frame says nothing."""

    def __init__(self, cycles: int = _CERTAIN) -> None:
        self._wanted, self._cycles = cycles, 0

    def certain(self, now: bool) -> bool:
        """With what the latest cycle says."""
        self._cycles = self._cycles + 1 if now else 0
        return self._cycles >= self._wanted


class Failure(enum.Enum):
    """Why a stop by the drive's own ramp does not go as it should."""

    NONE = 0
    DEAF = 1  # the drive answers no more
    FASTER = 2  # the axis gets faster: what should brake it is what has failed
    UNBRAKED = 3  # it goes on as before


FAILED = {  # that end in a cut of the power
    Failure.FASTER: "the axis became faster under its quick stop: the power was cut",
    Failure.UNBRAKED: "the axis was not braked by its quick stop: the power was cut",
}


class Braking:
    """One stop by the drive's own ramp, cycle by cycle."""

    def __init__(self, pace: Pace, deceleration: float) -> None:
        """From the `pace` at which it begins, on a ramp of `deceleration` (rad/s^2 | m/s^2)."""
        self._pace, self._faster, self._deaf, self._unbraked = pace, Repeated(), Repeated(_DEAF), Repeated()
        self._limit = _FASTER * pace.speed + _SLACK * deceleration
        self._half = 0.5 * pace.speed + _CREEP * deceleration
        self._cycles, self._long = 0, (_LONGER * pace.speed / deceleration + _SETTLES) / pace.dt

    def step(self, silent: bool) -> Failure:
        """What this cycle shows, in which the drive was `silent` or not."""
        self._cycles += 1
        if self._deaf.certain(silent):
            return Failure.DEAF
        speed = 0.0 if silent else self._pace.speed
        if self._faster.certain(speed > self._limit):
            return Failure.FASTER
        late = self._unbraked.certain(self._cycles > self._long and speed > self._half)
        return Failure.UNBRAKED if late else Failure.NONE
