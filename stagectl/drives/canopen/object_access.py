"""Objects of one drive over SDO: compared first, written where they differ, read back, and kept to be verified.

A boot-up message in between makes all that was written worthless: the access that notices it raises
`SetupInterruptedError`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.library import SdoAbortedError, SdoError
from stagectl.drives.canopen.network import PumpedNode
from stagectl.drives.drive import Canopen, DriveError

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
    """SDO access to one node; `held` is what a finished set-up must still find in the drive."""

    def __init__(self, settings: Canopen, node: PumpedNode) -> None:
        """`node` is in a network already; its boot-up messages are counted from here on."""
        self.settings, self.node = settings, node
        self.held: dict[int, int] = {}
        self.boots = 0  # boot-up messages heard
        self.nmt_state: int | None = None  # as the last heartbeat or guarding answer said
        self._expected: int | None = None  # boots that are in order; None: any
        node.network.subscribe(0x700 + settings.node, self._heard)

    def close(self) -> None:
        """Listen to boot-up messages no more."""
        self.node.network.unsubscribe(0x700 + self.settings.node, self._heard)

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

    def write(self, value: int, index: int, subindex: int = 0) -> None:
        """Write an integer.  Raises DriveError, with the drive's abort code where it refuses."""
        action = f"write of {value} (0x{value & 0xFFFFFFFF:X})"
        self._transfer(action, index, subindex, lambda: self._download(value, index, subindex))

    def hold(self, wanted: int, index: int, subindex: int = 0, fits: Fits | None = None) -> Held:
        """Compare the object, write `wanted` where it holds another value, and read it back.

        `fits` says which values are right after that; without it only `wanted` is.  Raises SetupInterruptedError.
        """
        fits, refusal = fits or (lambda value: value == wanted), None
        value = self._readable(index, subindex)
        if value != wanted and self._exists(index, subindex):
            try:
                self.write(wanted, index, subindex)
            except SetupInterruptedError:
                raise
            except DriveError as error:
                refusal = error
            else:
                value = self._readable(index, subindex)
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
                    f"node {self.settings.node}: object 0x{key >> 8:04X}:{key & 0xFF:02X} held {value} and is {now}"
                    " after NMT start; probable causes: the drive booted, or another master writes to it",
                    node=self.settings.node,
                    object_key=key,
                    value=now,
                )

    def upload(self, index: int, subindex: int) -> Any:
        """Value of an object.  Raises SdoError."""
        return self._variable(index, subindex).decode_raw(self.node.sdo.upload(index, subindex))

    def bits(self, key: int) -> int:
        """Length of an object as the EDS gives it.  Raises SdoAbortedError where it has none."""
        return len(self._variable(key >> 8, key & 0xFF))

    def refused(self, action: str, index: int, subindex: int, error: SdoError) -> DriveError:
        """The error of an access."""
        known = self.node.object_dictionary.get_variable(index, subindex)
        name = known.name if known is not None else "not in the EDS"
        aborted = isinstance(error, SdoAbortedError)
        return (DriveError if aborted else SetupInterruptedError)(
            f"node {self.settings.node}: {action} of object 0x{index:04X}:{subindex:02X} ({name}) failed: {error};"
            f" compare {self.settings.eds} with the drive's manual and firmware",
            node=self.settings.node,
            object_key=index << 8 | subindex,
            abort_code=error.code if isinstance(error, SdoAbortedError) else None,
        )

    def _exists(self, index: int, subindex: int) -> bool:
        return self.node.object_dictionary.get_variable(index, subindex) is not None

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
