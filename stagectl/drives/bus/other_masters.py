"""Listening before speaking: whether another master is at work on a bus.

A CAN frame does not name its sender.  But on a bus where we have not sent anything yet, these come from a master::

    0x080                  SYNC (CiA 301, 7.2.5)
    0x200 ... 0x500 + n    RPDO of our node n, by the predefined connection set (CiA 301, 7.3.5)
    0x700 + 127            heartbeat of another stagectl

A master that sends none of them for LISTENING_TIME drives nothing by cycles.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import NamedTuple

from stagectl.drives.bus.channel_lock import ChannelLock, OtherMasterError
from stagectl.drives.bus.frames import Bus, parse
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen
from stagectl.drives.limits import LISTENING_FRAMES, LISTENING_TIME
from stagectl.number_format import duration

_SYNC, _HEARTBEAT = 0x080, 0x700 + 127
_RPDOS = (0x200, 0x300, 0x400, 0x500)


class Heard(NamedTuple):
    """Frames of another master of one kind."""

    kind: str  # in words
    frames: int
    period: float | None  # s, mean; None: a single frame


def listen(wire: Canopen, bus: Bus, clock: Clock = WALL) -> None:
    """Hear the bus for LISTENING_TIME; `bus` must be one on which we have not sent anything.

    Raises OtherMasterError where another master is heard, and OSError where the bus fails.
    """
    kinds = {_SYNC: "SYNC", _HEARTBEAT: "the heartbeat of node 127"}
    kinds |= {base + wire.node: f"RPDOs to node {wire.node}" for base in _RPDOS}
    times: dict[int, list[float]] = {}
    end = clock.now() + LISTENING_TIME
    for _ in range(LISTENING_FRAMES):
        left = end - clock.now()
        raw = bus.receive(left) if left > 0.0 else None
        if raw is None:
            break
        identifier = parse(raw)[0]
        if identifier in kinds:
            times.setdefault(identifier, []).append(clock.now())
    if times:
        raise _refusal(
            wire, [_heard(kinds[identifier], times[identifier]) for identifier in kinds if identifier in times]
        )


@contextlib.contextmanager
def alone(wire: Canopen, bus: Bus, stage: str) -> Iterator[None]:
    """Have the channel for a while, in which a drive is read: no other master is disturbed, and none begins.

    Raises OtherMasterError where there is one.
    """
    lock = ChannelLock(wire, stage)
    try:
        listen(wire, bus)
        yield
    finally:
        lock.release()


def _heard(kind: str, times: list[float]) -> Heard:
    """By the mean period: a busy computer hands frames over in bursts."""
    return Heard(kind, len(times), (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else None)


def _refusal(wire: Canopen, heard: list[Heard]) -> OtherMasterError:
    """The error that says what was heard; SYNC first, as it is what drives a bus."""
    first = heard[0]
    every = "" if first.period is None else f" every {duration(first.period)}"
    error = OtherMasterError(
        f"another master sends {first.kind}{every} on this bus, {wire.interface} {wire.channel} (seen {first.frames}"
        f" frames in {LISTENING_TIME:g} s); it does not run on this computer, or is no stagectl. Nothing was sent."
        " Next: stop that master; `candump` or `python -m can.logger` shows its frames",
        place=wire.channel,
        node=wire.node,
        value=first.kind,
    )
    error.frames, error.period = first.frames, first.period
    return error
