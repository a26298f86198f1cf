"""The watchdog: armed by a sign of life, trips once, and says when its partner is back."""

from __future__ import annotations

from stagectl.drives.virtual.supervision import Watchdog


def watching(timeout: float = 0.5) -> Watchdog:
    result = Watchdog(0x8130, "no heartbeat")
    result.timeout = timeout
    return result


def test_it_trips_once_after_its_timeout_and_not_at_it() -> None:
    dog = watching()
    assert dog.check(100.0) is None  # nothing was ever heard: nothing is missed
    assert not dog.alive(10.0)
    assert dog.check(10.5) is None
    assert dog.check(10.75) == 0.75
    assert dog.tripped
    assert dog.check(11.0) is dog.check(99.0) is None


def test_its_partner_returns_once() -> None:
    dog = watching()
    dog.alive(0.0)
    dog.check(1.0)
    assert dog.alive(2.0)
    assert not dog.tripped
    assert not dog.alive(2.25)
    assert dog.check(3.0) is not None  # and may be lost again


def test_zero_is_off_and_disarmed_is_silent() -> None:
    off, disarmed = watching(0.0), watching()
    for dog in (off, disarmed):
        dog.alive(0.0)
    disarmed.disarm()
    assert off.check(100.0) is disarmed.check(100.0) is None
    assert not disarmed.alive(200.0)  # it had not been lost
