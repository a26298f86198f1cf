"""The drive without its loop: what it reports over SDO while nobody, or a stopped process, controls it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import NamedTuple

from stagectl.drives.bus.frames import Bus, frame
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.library import SdoAbortedError, SdoError, canopen
from stagectl.drives.canopen.network import PumpedNetwork, PumpedNode
from stagectl.drives.drive import Canopen, DriveError
from stagectl.workflows.acceptance.limits import LOOK, PATIENCE, RESET_TIME, STILL_COUNTS, STILL_TIME

_RESET = cia402.DeviceCommand.FAULT_RESET.controlword
_OFF = cia402.DeviceCommand.DISABLE_VOLTAGE.controlword
_FAULTS = (DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE)


class Stop(NamedTuple):
    """How an axis came to rest by itself."""

    stands: bool
    without_power: bool  # not in Operation enabled any more
    distance: float  # rad | m, the farthest from where it was left
    time: float  # s until it stood
    state: DriveState


class DriveReader:
    """Objects of one drive; `step` (rad | m) is one count of its position."""

    def __init__(self, wire: Canopen, bus: Bus, step: float) -> None:
        self._wire, self._bus, self._step = wire, bus, step
        self._node = PumpedNode(wire.node, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        PumpedNetwork(bus)[wire.node] = self._node

    def raw(self, index: int, subindex: int = 0) -> bytes | None:
        """An object; None where the drive does not have it.  Raises DriveError where it does not answer."""
        try:
            return bytes(self._node.sdo.upload(index, subindex))
        except SdoAbortedError:
            return None
        except SdoError as error:
            raise self._failed(index, subindex, error) from error

    def number(self, index: int, subindex: int = 0, signed: bool = False) -> int | None:
        """An object that is a number."""
        raw = self.raw(index, subindex)
        return int.from_bytes(raw[:8], "little", signed=signed) if raw else None

    def position(self) -> float:
        """Position (rad | m), as the drive counts.  Raises DriveError."""
        counts = self.number(cia402.POSITION, signed=True)
        if counts is None:
            raise DriveError(
                f"node {self._wire.node}: object 0x6064 (position) cannot be read: the stop could not be measured",
                node=self._wire.node,
                object_key=cia402.POSITION << 8,
            )
        return counts * self._step

    def state(self) -> DriveState:
        """State of the power drive system."""
        return cia402.state(self.number(cia402.STATUSWORD) or 0)

    def watch_stop(self, start: float, timeout: float, farthest: float) -> Stop:
        """Watch the axis, left at `start` (rad | m), come to rest within `timeout` (s) and PATIENCE.

        One that does not, or goes `farthest` (rad | m) from there, loses its power.
        """
        begun = time.monotonic()
        still, since, distance = self.position(), begun, 0.0
        while True:
            here, state, now = self.position(), self.state(), time.monotonic()
            distance = max(distance, abs(here - start))
            if abs(here - still) > STILL_COUNTS * self._step:
                still, since = here, now
            stands, without = now - since > STILL_TIME, state is not DriveState.OPERATION_ENABLED
            if stands and without:
                return Stop(True, True, distance, max(since - begun, 0.0), state)
            if now - begun > timeout + PATIENCE or distance > farthest:
                self.cut_power()
                return Stop(stands, without, distance, now - begun, state)
            time.sleep(LOOK)

    def cut_power(self) -> None:
        """Disable voltage, by SDO and NMT; never raises."""
        with contextlib.suppress(DriveError, OSError):
            self._bus.send(frame(0, bytes([cia402.NMT_PRE_OPERATIONAL, self._wire.node])))
            self.control(_OFF)

    def reset_fault(self) -> None:
        """Reset the fault that a test has caused on purpose.  Raises DriveError where it stays."""
        if self.state() not in _FAULTS:
            return
        self.control(_OFF)
        self.control(_RESET)
        end = time.monotonic() + RESET_TIME
        while (state := self.state()) in _FAULTS and time.monotonic() < end:
            time.sleep(LOOK)
        self.control(_OFF)
        if state in _FAULTS:
            code = self.number(cia402.ERROR_CODE) or 0
            raise DriveError(
                f"node {self._wire.node} stays in {state.words} (0x603F = 0x{code:04X}, {cia402.emergency(code)}):"
                " remove the cause, then accept the drive again",
                node=self._wire.node,
                object_key=cia402.ERROR_CODE << 8,
                value=code,
            )

    def control(self, word: int) -> None:
        """Write the controlword.  Raises DriveError."""
        try:
            self._node.sdo.download(cia402.CONTROLWORD, 0, word.to_bytes(2, "little"))
        except SdoError as error:
            raise self._failed(cia402.CONTROLWORD, 0, error) from error

    def _failed(self, index: int, subindex: int, error: SdoError) -> DriveError:
        return DriveError(
            f"node {self._wire.node}: object 0x{index:04X}:{subindex:02X}: {error}; see `stagectl drive probe`",
            node=self._wire.node,
            object_key=index << 8 | subindex,
        )


@contextlib.contextmanager
def reading(wire: Canopen, step: float) -> Iterator[DriveReader]:
    """A reader on a bus of its own; nothing is sent but what is asked for."""
    bus = open_bus(wire.interface, wire.channel, wire.bitrate)
    try:
        yield DriveReader(wire, bus, step)
    finally:
        bus.close()
