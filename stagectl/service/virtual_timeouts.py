"""How long a loop waits where nothing but processes is held up: a virtual plant stands still meanwhile."""

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Canopen

HELD_UP = 5.0  # s for which a busy computer may take the processor away; 0.5 s were seen to be short
_UNHURRIED, _HEARTBEAT = 0.5, 0.1  # s, chosen: what is judged by its time still has one; a person sees it end
_ANY_NUMBER = 1_000_000  # of late cycles in a row


def waits_for_sync(setup: Setup) -> bool:
    """Whether the plant moves with our cycles, not with the clock: in process, or virtual with the clock `sync`."""
    return setup.file.in_memory and setup.file.simulation.clock == "sync"


def patient(setup: Setup) -> Setup:
    """The stage as a loop takes it: as its file says; where the plant waits for SYNC, with time for all involved.

    There a time-out tells nothing about the machine and much about its computer: silence counts from `HELD_UP` on, and
    cycles may be late.
    """
    if not waits_for_sync(setup):
        return setup
    wire = setup.file.drive.wire
    if isinstance(wire, Canopen):
        names = ("heartbeat_timeout", "rpdo_timeout", "feedback_timeout")
        times = {name: getattr(wire, name) for name in names}
        setup = setup.with_wire(**{name: max(time, HELD_UP) for name, time in times.items() if time})  # 0: off
    return _unpunctual(setup)


def unhurried(setup: Setup) -> Setup:
    """The stage as tests judge it that time its stops: where the plant waits for SYNC, with half a second to notice."""
    if not waits_for_sync(setup) or not isinstance(setup.file.drive.wire, Canopen):
        return setup
    half = _UNHURRIED
    return _unpunctual(
        setup.with_wire(heartbeat=_HEARTBEAT, heartbeat_timeout=half, rpdo_timeout=half, feedback_timeout=half)
    )


def _unpunctual(setup: Setup) -> Setup:
    """With cycles that may be late."""
    return setup.having(realtime=setup.file.realtime._replace(late_limit=_ANY_NUMBER))
