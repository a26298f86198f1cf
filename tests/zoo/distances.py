"""How far the zoo's axis may go on after its controller has died, from its mechanics and the time-outs it was given."""

from __future__ import annotations

from tests.zoo.diary import Diary
from tests.zoo.plant import COULOMB, FORCE_CONSTANT, INERTIA, METRES_PER_RAD
from tests.zoo.stage import CURRENT_LIMIT

_SPEED = 2.0 * 3.1416 * 2e-3  # m/s, the fastest of the long motion: 2 mm at 1 Hz
_MARGIN = 0.25  # s that a busy machine may add to a time-out


def longest_stop(diary: Diary) -> float:
    """Distance (m): the largest torque until the latest monitor has run out, then the drive's ramp or friction."""
    time = max(_timeouts(diary), default=0.0) + _MARGIN
    surplus = METRES_PER_RAD * (CURRENT_LIMIT * FORCE_CONSTANT - COULOMB) / INERTIA  # m/s^2
    friction = METRES_PER_RAD * COULOMB / INERTIA
    speed = _SPEED + surplus * time
    return _SPEED * time + surplus * time**2 / 2.0 + speed**2 / (2.0 * friction)


def _timeouts(diary: Diary) -> list[float]:
    """What the controller has written, in s."""
    held = {key: int.from_bytes(bytes.fromhex(data), "little") for key, data in diary.held().items()}
    beats = [(held.get(key, 0) & 0xFFFF) / 1e3 for key in (0x101601, 0x101602)]
    guard = held.get(0x100C00, 0) * held.get(0x100D00, 0) / 1e3
    return [time for time in (*beats, guard, held.get(0x140005, 0) / 1e3) if time]
