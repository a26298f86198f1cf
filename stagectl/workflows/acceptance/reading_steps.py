"""Steps without power: who the drive is, and what protects the axis when its controller is lost."""

from __future__ import annotations

from typing import Any

from stagectl.drives.bus.frames import MASTER
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.network import check_profile
from stagectl.drives.canopen.presets import for_vendor
from stagectl.drives.canopen.probe import against_eds
from stagectl.workflows.acceptance.drive_reader import DriveReader
from stagectl.workflows.acceptance.stop_bounds import read_protection
from stagectl.workflows.acceptance.trial import connected
from stagectl.workflows.acceptance.workbench import Found, StepError, Workbench, passed

_IDENTITY = ("vendor", "product", "revision", "serial number")
_TEXTS = {
    cia402.DEVICE_NAME: "device name",
    cia402.HARDWARE_VERSION: "hardware version",
    cia402.SOFTWARE_VERSION: "software version",
}
_STOPPING = (1, 2, 3)  # options of 0x6007: fault, power off, quick stop
_MILLI = 1e-3


def identity(bench: Workbench) -> Found:
    """The drive is the one that EDS and stage file are for.  Nothing is written."""
    with bench.reading_alone() as drive:
        check_profile(drive.number(cia402.DEVICE_TYPE) or 0, bench.wire.node)
        bench.drive = _identified(drive)
        preset = for_vendor(drive.number(cia402.IDENTITY, 1))
        doubts = against_eds(bench.wire, drive.read, preset)
        rated = drive.number(cia402.RATED_CURRENT)
        bench.start = drive.position()
    stated = bench.wire.rated_current
    if rated is not None and round(stated / _MILLI) != rated:
        doubts.append(f"rated_current = {stated:g} A, but the drive reports {rated * _MILLI:g} A (0x6075)")
    if doubts:
        raise StepError("; ".join(doubts), bench.drive)
    known = ", ".join(f"{name} {value}" for name, value in bench.drive.items())
    return passed(known or "the drive reports no identity", **bench.drive)


def protection(bench: Workbench) -> Found:
    """Set up as for a run, without power; then supervisors and reaction are read back on another connection."""
    description = connected(bench.setup)
    with bench.reading_alone() as drive:
        held = bench.protection = read_protection(drive, MASTER)
    facts: dict[str, Any] = {
        **{name: f"{time:g} s" for name, time in held.supervisors.items()},
        "0x6007": held.reaction,
    }
    facts |= {"set-up": description}
    if not held.supervisors:
        raise StepError(
            "no supervisor is on in the drive (0x1016, 0x1400:05, 0x100C): it does not notice a dead controller",
            facts,
        )
    if held.reaction not in _STOPPING:
        reported = "absent" if held.reaction is None else held.reaction
        raise StepError(f"0x6007 (abort connection) is {reported}; must be 1, 2 or 3: nothing stops the axis", facts)
    watching = ", ".join(f"{name} {time * 1e3:.0f} ms" for name, time in held.supervisors.items())
    return passed(f"{watching}; then: {cia402.option(cia402.ABORT_CONNECTION, held.reaction)}", **facts)


def _identified(drive: DriveReader) -> dict[str, str]:
    known = {}
    for subindex, name in enumerate(_IDENTITY, start=1):
        value = drive.number(cia402.IDENTITY, subindex)
        if value is not None:
            known[name] = f"0x{value:08X}"
    for index, name in _TEXTS.items():
        text = (drive.read(index) or b"").decode("latin-1").strip("\0 ")
        if text:
            known[name] = "".join(letter if letter.isprintable() else "?" for letter in text)
    return known
