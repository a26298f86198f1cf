"""Objects of one drive over SDO: compared first, written where they differ, read back, and kept to be verified.

A boot-up message in between makes all that was written worthless: the access that notices it raises
`SetupInterruptedError`.
"""

import math
import struct
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

from stagectl.drives.bus.frames import HEARTBEAT, Bus
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.library import SdoAbortedError, SdoCommunicationError, SdoError, canopen
from stagectl.drives.canopen.network import PumpedNetwork, PumpedNode
from stagectl.drives.drive import Canopen, DriveError
from stagectl.drives.limits import PROBE_ANSWER_TIME

_ABSENT = (cia402.NO_OBJECT, cia402.NO_SUBINDEX)
Result = TypeVar("Result")
Fits = Callable[[int], bool]


class SetupInterruptedError(DriveError):
    """The drive booted, or fell silent, in mid set-up: the set-up begins again."""


class Held(NamedTuple):
    """An object after it was compared and, where it differed, written."""

    value: int | None  # as read back; None: the drive does not have it, or does not let it be read
    fits: bool
    refusal: DriveError | None = None  # of the write


class ObjectAccess:
    """SDO access to one node; `held` is what a finished set-up must still find in the drive.

    `description` collects what the drive reported, in words.
    """

    def __init__(self, settings: Canopen, node: PumpedNode) -> None:
        """`node` is in a network already; its boot-up messages are counted from here on."""
        self.settings, self.node = settings, node
        self.network = cast(PumpedNetwork, node.network)
        self.description: dict[str, str] = {}
        self.held: dict[int, int] = {}
        self.boots = 0  # boot-up messages heard
        self.nmt_state: int | None = None  # as the last heartbeat or guarding answer said
        self._expected: int | None = None  # boots that are in order; None: any
        self.network.subscribe(HEARTBEAT + settings.node, self._heard)

    def close(self) -> None:
        """Listen to boot-up messages no more."""
        self.network.unsubscribe(HEARTBEAT + self.settings.node, self._heard)

    def begin(self) -> None:
        """Forget what was held; from now on a boot-up message interrupts."""
        self.held.clear()
        self._expected = self.boots

    def expect_boot(self) -> None:
        """From now on a boot-up message is in order."""
        self._expected = None

    def read(self, index: int, subindex: int = 0) -> Any:
        """Value of an object, by the type that the EDS gives it.  Raises DriveError."""
        return self._transfer("read", index, subindex, lambda: self.upload(index, subindex))

    def offered(self, index: int, subindex: int = 0) -> Any:
        """Value of an optional object; None where the drive does not have it.  Raises DriveError."""
        try:
            return self.read(index, subindex)
        except DriveError as error:
            if error.abort_code in _ABSENT:
                return None
            raise

    def known(self, index: int) -> int | None:
        """An integer object; None where the drive does not give it, for whatever reason."""
        try:
            return int(self.read(index))
        except DriveError:
            return None

    def position(self, step: float) -> float:
        """Where the axis stands (rad | m), one count being a `step`; NaN where the drive does not say."""
        counts = self.known(cia402.POSITION)
        return math.nan if counts is None else counts * step

    def write(self, value: int, index: int, subindex: int = 0) -> None:
        """Write an integer.  Raises DriveError, with the drive's abort code where it refuses."""
        action = f"write of {value} (0x{value & 0xFFFFFFFF:X})"
        self._transfer(action, index, subindex, lambda: self._download(value, index, subindex))

    def attempt(self, value: int, index: int, subindex: int = 0) -> DriveError | None:
        """Write an integer; the drive's refusal, if it refuses.  Raises SetupInterruptedError."""
        try:
            self.write(value, index, subindex)
        except SetupInterruptedError:
            raise
        except DriveError as error:
            return error
        return None

    def hold(self, wanted: int, index: int, subindex: int = 0, fits: Fits | None = None) -> Held:
        """Compare the object, write `wanted` where it holds another value, and read it back.

        `fits` says which values are right after that; without it only `wanted` is.  Raises SetupInterruptedError.
        """
        fits, refusal = fits or (lambda value: value == wanted), None
        value = self._readable(index, subindex)
        if value != wanted and self.node.object_dictionary.get_variable(index, subindex) is not None:
            refusal = self.attempt(wanted, index, subindex)
            value = value if refusal else self._readable(index, subindex)
        held = Held(value, value is not None and fits(value), refusal)
        return self.keep(held, index, subindex)

    def keep(self, held: Held, index: int, subindex: int = 0) -> Held:
        """Note the value of an object that fits, for `verify`."""
        if held.fits and held.value is not None:
            self.held[index << 8 | subindex] = held.value
        return held

    def verify(self) -> None:
        """Read all again that was held.  Raises SetupInterruptedError where the drive has lost a value."""
        for key, value in self.held.items():
            now = self.read(key >> 8, key & 0xFF)
            if now != value:
                raise SetupInterruptedError(
                    f"node {self.settings.node}: object {cia402.shown(key)} held {value} and is {now}"
                    " after NMT start; probable causes: the drive booted, or another master writes to it",
                    node=self.settings.node,
                    object_key=key,
                    value=now,
                )

    def upload(self, index: int, subindex: int) -> Any:
        """Value of an object.  Raises SdoError."""
        variable, data = self._variable(index, subindex), self.node.sdo.upload(index, subindex)
        try:
            return variable.decode_raw(data)
        except canopen.ObjectDictionaryError as error:  # shorter than the type of the EDS
            raise SdoAbortedError(cia402.WRONG_LENGTH) from error

    def bits(self, key: int) -> int:
        """Length of an object as the EDS gives it.  Raises SdoAbortedError where it has none."""
        return len(self._variable(key >> 8, key & 0xFF))

    def refused(self, action: str, index: int, subindex: int, error: SdoError) -> DriveError:
        """The error of an access."""
        known = self.node.object_dictionary.get_variable(index, subindex)
        name = known.name if known is not None else "not in the EDS"
        key = index << 8 | subindex
        return (DriveError if isinstance(error, SdoAbortedError) else SetupInterruptedError)(
            f"node {self.settings.node}: {action} of object {cia402.shown(key)} ({name}) failed: {error};"
            f" compare {self.settings.eds} with the drive's manual and firmware",
            node=self.settings.node,
            object_key=key,
            abort_code=error.code if isinstance(error, SdoAbortedError) else None,
        )

    def error(self, words: str, key: int, value: float | str | None = None, place: str = "") -> DriveError:
        """The error about an object (index << 8 | subindex) of this node; `words` follow the id of the node."""
        node = self.settings.node
        return DriveError(f"node {node}{words}", place=place, node=node, object_key=key, value=value)

    def _readable(self, index: int, subindex: int) -> int | None:
        """Value of an object; None where the drive does not have it, or does not let it be read."""
        try:
            return int(self.read(index, subindex))
        except SetupInterruptedError:
            raise
        except DriveError:
            return None

    def _transfer(self, action: str, index: int, subindex: int, transfer: Callable[[], Result]) -> Result:
        try:
            return transfer()
        except SdoError as error:
            raise self.refused(action, index, subindex, error) from error
        finally:
            self._check_boot()

    def _check_boot(self) -> None:
        if self._expected is not None and self.boots != self._expected:
            raise SetupInterruptedError(
                f"node {self.settings.node} sent its boot-up message in mid set-up: what was written is lost. Probable"
                " causes: its supply fails, its firmware restarts, or another master resets it",
                node=self.settings.node,
            )

    def _download(self, value: int, index: int, subindex: int) -> None:
        try:
            data = self._variable(index, subindex).encode_raw(value)
        except struct.error as error:  # beyond the type of the EDS
            raise SdoAbortedError(cia402.OUT_OF_RANGE) from error
        self.node.sdo.download(index, subindex, data)

    def _variable(self, index: int, subindex: int) -> Any:
        variable = self.node.object_dictionary.get_variable(index, subindex)
        if variable is None:
            raise SdoAbortedError(cia402.NO_OBJECT)  # not in the EDS: for us the drive does not have it
        return variable

    def _heard(self, identifier: int, data: bytearray, timestamp: float) -> None:
        if data:
            self.nmt_state = data[0] & 0x7F
            self.boots += data[0] == cia402.INITIALISING


class SilentDriveError(DriveError):
    """It does not answer."""


class PlainSdo:
    """Objects of the node of `wire` as bytes, without an EDS; nothing is sent but what is asked for."""

    def __init__(self, wire: Canopen, bus: Bus) -> None:
        self.node = wire.node
        self._sdo = PumpedNode(wire.node, canopen.ObjectDictionary(), bus).sdo  # type: ignore[no-untyped-call]
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
        key = index << 8 | subindex
        return kind(
            f"node {self.node}: object {cia402.shown(key)} cannot be {done}: {error}; see `stagectl drive probe`",
            node=self.node,
            object_key=key,
        )


def number(raw: bytes | None, signed: bool = False) -> int | None:
    """The bytes of an object as a number; None without any."""
    return int.from_bytes(raw[:8], "little", signed=signed) if raw else None
