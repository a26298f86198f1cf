"""The object dictionary of a foreign drive at work: a stock `canopen.LocalNode` that refuses what drives refuse."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import canopen
from canopen.sdo.exceptions import SdoAbortedError

from tests.zoo.objects import WIDTHS, objects
from tests.zoo.variants import ABSENT, NOT_NOW, PDO_LOST, READ_ONLY, Variant

_NO_SUBINDEX, _NOT_MAPPABLE, _TOO_LONG, _INVALID = 0x0609_0011, 0x0604_0041, 0x0604_0042, 0x0609_0030
_GENERAL = 0x0800_0000
_PDO_PARAMETERS, _PDO_MAPPINGS = (0x1400, 0x1401, 0x1800, 0x1801), (0x1600, 0x1601, 0x1A00, 0x1A01)


class Memory(canopen.LocalNode):
    """A node whose dictionary follows its variant; `written` hears each confirmed write, `live` gives moving values."""

    def __init__(self, node: int, dictionary: str, variant: Variant, note: Callable[..., None]) -> None:
        """With the dictionary of this EDS file."""
        super().__init__(node, dictionary)
        self._write_callbacks.clear()  # the drive produces its heartbeat itself: one thread is enough
        self.variant, self._note, self.number_of_node = variant, note, node
        self.live: dict[int, int] = {}
        self.written: Callable[[int, bytes], None] = lambda key, data: None
        self.add_read_callback(lambda index, subindex, od: self.live.get(index << 8 | subindex))
        self.forget()

    def forget(self) -> None:
        """What a boot makes of it: all values as they were delivered."""
        self.data_store.clear()
        for row in objects(self.variant, self.number_of_node):
            variable = self._find_object(row.key >> 8, row.key & 0xFF)
            self.data_store.setdefault(row.key >> 8, {})[row.key & 0xFF] = variable.encode_raw(row.value)

    def __contains__(self, key: int) -> bool:
        """Whether its dictionary has this object."""
        return key >> 8 in self.data_store and key & 0xFF in self.data_store[key >> 8]

    def raw(self, key: int) -> bytes:
        """Data of an object, as it is inside the drive."""
        return bytes(super().get_data(key >> 8, key & 0xFF))

    def number(self, key: int) -> int:
        """Value of an object inside the drive."""
        return int(self._find_object(key >> 8, key & 0xFF).decode_raw(self.raw(key)))

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """As the library wants it; `check_readable` is set where an SDO asks."""
        if check_readable:
            self._must_exist(index << 8 | subindex)
        return bytes(super().get_data(index, subindex, check_readable))

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        """As the library wants it: an SDO's write, which the diary shows with its outcome."""
        key = index << 8 | subindex
        fields: dict[str, Any] = {"key": key, "name": f"0x{index:04X}:{subindex:02X}", "value": bytes(data).hex()}
        try:
            self._write(key, bytes(data))
        except SdoAbortedError as error:
            self._note("sdo", **fields, abort=error.code)
            raise
        self._note("sdo", **fields, abort=0)

    def _write(self, key: int, data: bytes) -> None:
        self._must_exist(key)
        if key in self.variant.read_only:
            raise SdoAbortedError(READ_ONLY)
        if key in self.variant.forgets:
            return
        self._obey_pdo_rules(key >> 8, key & 0xFF, int.from_bytes(data, "little"))
        super().set_data(key >> 8, key & 0xFF, data, check_writable=True)
        self.written(key, data)

    def _must_exist(self, key: int) -> None:
        if key not in self.variant.absent:
            return
        if self.variant.vague_aborts:
            raise SdoAbortedError(_GENERAL)
        known = {row.key for row in objects(self.variant, self.number_of_node) if row.key >> 8 == key >> 8}
        raise SdoAbortedError(ABSENT if known <= set(self.variant.absent) or len(known) <= 2 else _NO_SUBINDEX)

    def _obey_pdo_rules(self, index: int, subindex: int, value: int) -> None:
        """CiA 301, 7.5.2.35 and 36: a PDO that exists keeps its COB-ID and its map."""
        if index in _PDO_PARAMETERS and subindex == 1:
            held = self.number(index << 8 | 1)
            if not (held | value) & PDO_LOST and (held ^ value) & 0x7FF:
                raise SdoAbortedError(_INVALID)
        if index in _PDO_MAPPINGS:
            self._obey_map_rules(index, subindex, value)

    def _obey_map_rules(self, index: int, subindex: int, value: int) -> None:
        exists = not self.number((index - 0x200) << 8 | 1) & PDO_LOST
        if exists or (subindex and self.number(index << 8)):
            raise SdoAbortedError(NOT_NOW)
        if subindex and value and (value >> 8 not in WIDTHS or WIDTHS[value >> 8] != value & 0xFF):
            raise SdoAbortedError(_NOT_MAPPABLE)
        if not subindex and sum(self.number(index << 8 | n + 1) & 0xFF for n in range(value)) > 64:
            raise SdoAbortedError(_TOO_LONG)
