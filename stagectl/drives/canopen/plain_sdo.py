"""Objects of a drive by index, as bytes: for those who read it without an EDS and without configuring it."""

from __future__ import annotations

from stagectl.drives.bus.frames import Bus
from stagectl.drives.canopen.library import SdoAbortedError, SdoCommunicationError, SdoError, canopen
from stagectl.drives.canopen.network import PumpedNetwork, PumpedNode
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, DriveError
from stagectl.drives.limits import PROBE_ANSWER_TIME


class SilentDriveError(DriveError):
    """It does not answer."""


class PlainSdo:
    """SDO access to the node of `wire`; nothing is sent but what is asked for."""

    def __init__(self, wire: Canopen, bus: Bus, clock: Clock = WALL) -> None:
        self.node = wire.node
        remote = PumpedNode(wire.node, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        PumpedNetwork(bus, clock)[wire.node] = remote
        self._sdo = remote.sdo
        self._sdo.RESPONSE_TIMEOUT = PROBE_ANSWER_TIME

    def read(self, index: int, subindex: int = 0) -> bytes | None:
        """An object; None where the drive does not have it.  Raises DriveError, SilentDriveError without an answer."""
        try:
            return bytes(self._sdo.upload(index, subindex))
        except SdoAbortedError:
            return None
        except SdoError as error:
            raise self._failed("read", index, subindex, error) from error

    def number(self, index: int, subindex: int = 0, signed: bool = False) -> int | None:
        """An object that is a number.  Raises as `read`."""
        return number(self.read(index, subindex), signed)

    def write(self, data: bytes, index: int, subindex: int = 0) -> None:
        """Write an object.  Raises DriveError, too where the drive refuses; SilentDriveError without an answer."""
        try:
            self._sdo.download(index, subindex, data)
        except SdoError as error:
            raise self._failed("written", index, subindex, error) from error

    def _failed(self, done: str, index: int, subindex: int, error: SdoError) -> DriveError:
        kind = SilentDriveError if isinstance(error, SdoCommunicationError) else DriveError
        return kind(
            f"node {self.node}: object 0x{index:04X}:{subindex:02X} cannot be {done}: {error};"
            " see `stagectl drive probe`",
            node=self.node,
            object_key=index << 8 | subindex,
        )


def number(raw: bytes | None, signed: bool = False) -> int | None:
    """The bytes of an object as a number; None without any."""
    return int.from_bytes(raw[:8], "little", signed=signed) if raw else None
