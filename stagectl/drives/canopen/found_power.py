"""A drive that is found under power is stopped before it is set up: nothing watches over it yet.

Somebody left it so: a controller that died while nothing supervised it, its panel, its own program.  Set up under
power, the first change of mode could act on a torque that is still in it.
"""

from __future__ import annotations

from stagectl.drives.canopen import cia402, fault_texts
from stagectl.drives.canopen.cia402 import POWERED, DeviceCommand
from stagectl.drives.canopen.object_access import ObjectAccess
from stagectl.drives.clock import Clock
from stagectl.drives.limits import FOUND_POWER_TIME


def take_power(objects: ObjectAccess, clock: Clock, description: dict[str, str]) -> None:
    """Stop the drive by its own ramp, then cut its power.  Raises DriveError where it keeps it."""
    found = now = objects.known(cia402.STATUSWORD)
    for command in (DeviceCommand.QUICK_STOP, DeviceCommand.DISABLE_VOLTAGE):
        if not _powered(now):
            break
        objects.write(command.controlword, cia402.CONTROLWORD)
        deadline = clock.now() + FOUND_POWER_TIME
        while _powered(now) and clock.now() < deadline:
            now = objects.known(cia402.STATUSWORD)
    if found is not None and now is not None and _powered(now):
        raise objects.error(
            f" was found in {fault_texts.state_words(found)} and keeps its power: {fault_texts.state_words(now)}."
            " Probable cause: its panel, its own program or another controller holds it. Take its power there, then"
            " start again",
            cia402.STATUSWORD << 8,
            now,
        )
    if found is not None and _powered(found):
        description["found under power"] = f"in {fault_texts.state_words(found)}; stopped, and its power cut"


def _powered(statusword: int | None) -> bool:
    return statusword is not None and cia402.state(statusword) in POWERED
