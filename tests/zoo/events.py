"""What happens to a foreign drive in mid-motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from tests.zoo.power import State

if TYPE_CHECKING:
    from tests.zoo.drive import Drive


def _remote(drive: Drive) -> None:
    """Bit 9 falls and commands are no longer taken: the last torque stays."""
    drive.missing_bits |= 1 << 9
    drive.rpdos[0].valid = False


def _follow(drive: Drive) -> None:
    """Bit 12 falls and the commands have no effect."""
    drive.missing_bits |= 1 << 12
    drive.deaf = True


def _mode(drive: Drive) -> None:
    drive.mode = 0


def _frozen(drive: Drive) -> None:
    drive.answers.frozen = True


def _silent(drive: Drive) -> None:
    drive.answers.silent = True


def _disabled(drive: Drive) -> None:
    drive.power.to(State.SWITCH_ON_DISABLED, "STO")


def _boot(drive: Drive) -> None:
    drive.wants_boot = True


def _storm(drive: Drive) -> None:
    drive.storms = True


def _untold(drive: Drive) -> None:
    """The fault is in 0x603F alone."""
    drive.memory.live |= {0x603F00: 0x2310, 0x100100: 1}
    drive.power.trip(0, "fault 0x2310")


def _switched_on(drive: Drive) -> None:
    drive.power.to(State.SWITCHED_ON, "the drive's own")


def _voltage(drive: Drive) -> None:
    """No power reaches the motor; the state stays."""
    drive.missing_bits |= 1 << 4
    drive.deaf = True


EVENTS: dict[str, Callable[[Drive], None]] = {
    "remote-lost": _remote,
    "follow-lost": _follow,
    "mode-lost": _mode,
    "tpdo-frozen": _frozen,
    "tpdo-silent": _silent,
    "reboot": _boot,
    "emergency": lambda drive: drive.emergency(0x4210),
    "fault": lambda drive: drive.trip(0x2310),
    "disabled": _disabled,
    "emergency-storm": _storm,
    "fault-untold": _untold,
    "switched-on": _switched_on,
    "voltage-lost": _voltage,
}


def happen(drive: Drive, event: str) -> None:
    """Let it happen now."""
    EVENTS[event](drive)
