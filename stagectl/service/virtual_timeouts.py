"""How long a loop waits where nothing but processes is held up: a virtual plant stands still meanwhile."""

from __future__ import annotations

from stagectl.config.stage_blocks import InProcess
from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Canopen

HELD_UP = 5.0  # s for which a busy computer may take the processor away; 0.5 s were seen to be short
_UNHURRIED, _HEARTBEAT = 0.5, 0.1  # s, chosen: what is judged by its time still has one; a person sees it end
_ANY_NUMBER = 1_000_000  # of late cycles in a row


def waits_for_sync(setup: Setup) -> bool:
    """Whether the plant moves with our cycles, not with the clock: in process, or virtual with the clock `sync`."""
    wire = setup.file.drive.wire
    virtual = isinstance(wire, InProcess) or (isinstance(wire, Canopen) and wire.interface == "embedded")
    return virtual and setup.file.simulation.clock == "sync"


def patient(setup: Setup) -> Setup:
    """The stage as a loop takes it: as its file says; where the plant waits for SYNC, with time for all involved.

    There a time-out tells nothing about the machine and much about its computer: silence counts from `HELD_UP` on, and
    cycles may be late.
    """
    if not waits_for_sync(setup):
        return setup
    file, wire = setup.file, setup.file.drive.wire
    file = file._replace(realtime=file.realtime._replace(late_limit=_ANY_NUMBER))
    if isinstance(wire, Canopen):
        file = file._replace(drive=file.drive._replace(wire=_relaxed(wire)))
    return setup._replace(file=file)


def unhurried(setup: Setup) -> Setup:
    """The stage as tests judge it that time its stops: where the plant waits for SYNC, with half a second to notice."""
    wire = setup.file.drive.wire
    if not waits_for_sync(setup) or not isinstance(wire, Canopen):
        return setup
    half = _UNHURRIED
    wire = wire._replace(heartbeat=_HEARTBEAT, heartbeat_timeout=half, rpdo_timeout=half, feedback_timeout=half)
    file = setup.file._replace(
        drive=setup.file.drive._replace(wire=wire),
        realtime=setup.file.realtime._replace(late_limit=_ANY_NUMBER),
    )
    return setup._replace(file=file)


def _relaxed(wire: Canopen) -> Canopen:
    """A time-out that is off stays off."""
    return wire._replace(
        heartbeat_timeout=max(wire.heartbeat_timeout, HELD_UP),
        rpdo_timeout=max(wire.rpdo_timeout, HELD_UP) if wire.rpdo_timeout else 0.0,
        feedback_timeout=max(wire.feedback_timeout, HELD_UP),
    )
