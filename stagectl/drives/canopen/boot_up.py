"""A drive brought to pre-operational: reset where the stage file says so, its boot-up message awaited (CiA 301).

A drive that is found under power is stopped before it is reset or set up.  Somebody left it so: a controller that died
while nothing supervised it, its panel, its own program; or it holds an axis whose brake its controller worked, which
then is set before power goes.  Set up under power, the first change of mode could act on a torque that is still in it.
"""

import contextlib
from collections.abc import Callable

from stagectl.drives import limits
from stagectl.drives.brake import Brake
from stagectl.drives.bus.frames import HEARTBEAT, REMOTE, frame
from stagectl.drives.canopen import cia402, fault_texts
from stagectl.drives.canopen.cia402 import POWERED, DeviceCommand
from stagectl.drives.canopen.library import SdoCommunicationError, SdoError
from stagectl.drives.canopen.object_access import ObjectAccess
from stagectl.drives.drive import DriveError


class BootUp:
    """The way to a drive that answers; afterwards any boot-up message interrupts the set-up."""

    def __init__(self, objects: ObjectAccess) -> None:
        self._objects, self._network, self._now = objects, objects.network, objects.network.clock.now
        self._settings, self._node = objects.settings, objects.node

    def run(self, take: Callable[[], None]) -> tuple[int, str]:
        """Device type (0x1000), and the boot in words; `take` takes its power before a reset.  Raises DriveError."""
        began, seen = self._now(), "not awaited: no reset was asked for"
        for _ in range(limits.BACKLOG):  # a boot-up message of before is none of the drive's later on
            if not self._network.pump(0.0):
                break
        self._objects.expect_boot()
        if self._settings.reset != "none":
            if self._answers():
                take()
            seen = self._reset(began)
        kind = self._answer(began + self._settings.boot_time)
        if self._settings.reset != "none" and not seen:
            seen = f"NOT SENT; it answers SDO in NMT state {self._nmt_state()}: a boot in mid operation goes unnoticed"
        self._objects.begin()
        return kind, seen

    def _answers(self) -> bool:
        """Whether it answers before its reset: one that is booting, or without supply, has no power to take."""
        with contextlib.suppress(DriveError):
            return self._answer(self._now()) >= 0
        return False

    def _reset(self, began: float) -> str:
        """Reset the drive and wait for its boot-up message; empty where none came in time."""
        before = self._objects.boots
        self._node.nmt.send_command(cia402.NMT_RESETS[self._settings.reset])
        if not self._until(began + limits.BOOT_UP_TIME, lambda: self._objects.boots != before):
            return ""
        return f"received {(self._now() - began) * 1e3:.0f} ms after the reset"

    def _answer(self, deadline: float) -> int:
        """Device type, asked for until it answers in pre-operational."""
        sdo = self._node.sdo
        sdo.RESPONSE_TIMEOUT, sdo.MAX_RETRIES = limits.BOOT_ANSWER_TIME, 1
        try:
            while True:
                self._node.nmt.send_command(cia402.NMT_PRE_OPERATIONAL)
                boots = self._objects.boots
                try:
                    kind = int(self._objects.upload(cia402.DEVICE_TYPE, 0))
                except SdoCommunicationError as error:
                    if self._now() > deadline:
                        raise self._silent() from error
                    continue
                if boots == self._objects.boots:  # else it answered before its boot: it must hear the command again
                    return kind
        except SdoError as error:
            raise self._objects.refused("read", cia402.DEVICE_TYPE, 0, error) from error
        finally:
            sdo.RESPONSE_TIMEOUT, sdo.MAX_RETRIES = limits.SDO_ANSWER_TIME, limits.SDO_TRIES

    def _nmt_state(self) -> str:
        """By heartbeat, or by node guarding, which is asked once."""
        if self._objects.nmt_state is None:
            self._network.wire.send(frame(REMOTE | HEARTBEAT + self._settings.node))
            self._until(self._now() + limits.STATE_TIME, lambda: self._objects.nmt_state is not None)
        state = self._objects.nmt_state
        return "unknown" if state is None else cia402.NMT_WORDS.get(state, f"{state}")

    def _until(self, deadline: float, over: Callable[[], bool]) -> bool:
        """Take frames until `over` or the deadline; whether it was over in time."""
        while not over() and (left := deadline - self._now()) > 0.0:
            self._network.pump(left)
        return over()

    def _silent(self) -> DriveError:
        s = self._settings
        return DriveError(
            f"node {s.node} does not answer on {s.interface} {s.channel} within {s.boot_time:g} s. Probable"
            " causes: no power, a wrong node id or bit rate, no bus termination, a drive that boots longer"
            " (drive.wire.boot_time); for a virtual drive: 'stagectl virtual-drive' does not run on this channel. Next:"
            " `stagectl drive probe STAGE.yaml`",
            place=s.channel,
            node=s.node,
        )


def set_brake(objects: ObjectAccess) -> None:
    """Set the brake at the drive's digital outputs, then their mask.  Raises DriveError."""
    for subindex in (1, 2):
        objects.write(cia402.BRAKE_BIT, cia402.DIGITAL_OUTPUTS, subindex)


def take_power(objects: ObjectAccess, brake: Brake) -> None:
    """Stop the drive by its own ramp, let a `brake` that we work hold, then cut its power.

    Raises DriveError where it keeps it.
    """
    found = now = objects.known(cia402.STATUSWORD)
    clock = objects.network.clock
    for command in (DeviceCommand.QUICK_STOP, DeviceCommand.DISABLE_VOLTAGE):
        if not _powered(now):
            break
        if command is DeviceCommand.DISABLE_VOLTAGE and brake.control == "output":
            set_brake(objects)
            clock.sleep(brake.engage)
        objects.write(command.controlword, cia402.CONTROLWORD)
        deadline = clock.now() + limits.FOUND_POWER_TIME
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
        objects.description["found under power"] = f"in {fault_texts.state_words(found)}; stopped, and its power cut"


def _powered(statusword: int | None) -> bool:
    return statusword is not None and cia402.state(statusword) in POWERED
