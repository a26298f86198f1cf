"""PDO mapping of the virtual drive: CiA 301's rules for changing it, and the PDOs compiled."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.library import SdoAbortedError, canopen

CODES = {
    0x2: "b",
    0x3: "h",
    0x4: "i",
    0x5: "B",
    0x6: "H",
    0x7: "I",
    0x15: "q",
    0x1B: "Q",
}  # by CiA 301 data type
INVALID = 0x8000_0000  # bit of a PDO's COB-ID: the PDO does not exist
_RANGES = (
    (cia402.RPDO_PARAMETER, cia402.RPDO_MAPPING, True),
    (cia402.TPDO_PARAMETER, cia402.TPDO_MAPPING, False),
)
COUNT = 4  # PDOs in each direction that a virtual drive has, and that are looked at in another one
EVENT_TIMER = 5  # subindex: the deadline of an RPDO, ms

Number = Callable[[int, int], int]  # (index, subindex) -> value in the object dictionary


class Rpdo(NamedTuple):
    """A received PDO, compiled."""

    head: bytes  # identifier, as the frame begins
    length: int  # bytes; longer frames are taken, shorter ones are not
    layout: struct.Struct
    objects: tuple[int, ...]  # index << 8 | subindex
    synchronous: bool  # acts at the next SYNC, not at once
    deadline: float  # s; 0: not watched


class Tpdo(NamedTuple):
    """A sent PDO, compiled."""

    head: tuple[int, int]  # identifier and length
    layout: struct.Struct  # of the whole frame
    objects: tuple[int, ...]
    every: int  # SYNCs between two


def is_pdo_parameter(index: int) -> bool:
    """Whether `index` is one of the PDO parameters that `check` guards."""
    return any(base <= index < base + COUNT for pair in _RANGES for base in pair[:2])


def check(od: canopen.ObjectDictionary, number: Number, index: int, subindex: int, value: int) -> None:
    """Check that CiA 301 admits writing `value` to a PDO parameter now.  Raises SdoAbortedError."""
    for parameter, mapping, received in _RANGES:
        if parameter <= index < parameter + COUNT and subindex == 1:
            _check_identifier(number(index, 1), value)
        if mapping <= index < mapping + COUNT:
            if not number(index - mapping + parameter, 1) & INVALID:
                raise SdoAbortedError(cia402.WRONG_STATE)  # only a PDO that is switched off can be mapped anew
            if subindex == 0:
                _check_count(od, number, index, value, received)
            else:
                _check_entry(od, number, index, value, received)


def received(number: Number, od: canopen.ObjectDictionary) -> list[Rpdo]:
    """The RPDOs that exist, compiled from the object dictionary."""
    pdos = []
    for n, identifier, kind, objects, codes, length in _existing(
        number, od, cia402.RPDO_PARAMETER, cia402.RPDO_MAPPING
    ):
        deadline = number(cia402.RPDO_PARAMETER + n, EVENT_TIMER) * 1e-3
        layout = struct.Struct("<8x" + codes)
        pdos.append(Rpdo(struct.pack("<I", identifier), length, layout, objects, kind <= 240, deadline))
    return pdos


def sent(number: Number, od: canopen.ObjectDictionary) -> list[Tpdo]:
    """The TPDOs that exist, compiled from the object dictionary."""
    existing = _existing(number, od, cia402.TPDO_PARAMETER, cia402.TPDO_MAPPING)
    return [
        Tpdo((identifier, length), struct.Struct(f"<IB3x{codes}{8 - length}x"), objects, every)
        for _, identifier, every, objects, codes, length in existing
    ]


def _existing(
    number: Number, od: canopen.ObjectDictionary, parameter: int, mapping: int
) -> Iterator[tuple[int, int, int, tuple[int, ...], str, int]]:
    """Place, identifier, transmission type, objects, struct codes and length of each PDO of a direction that exists."""
    for n in range(COUNT):
        identifier, at = number(parameter + n, 1), mapping + n
        entries = [number(at, subindex) for subindex in range(1, number(at, 0) + 1)]
        if not identifier & INVALID and entries:
            variables: list[Any] = [od.get_variable(entry >> 16, entry >> 8 & 0xFF) for entry in entries]
            codes = "".join(CODES[variable.data_type] for variable in variables)
            objects, length = tuple(entry >> 8 for entry in entries), sum(entry & 0xFF for entry in entries) // 8
            yield n, identifier & 0x7FF, number(parameter + n, 2), objects, codes, length


def _check_identifier(present: int, value: int) -> None:
    changed = (present ^ value) & 0x1FFF_FFFF
    if changed and not present & INVALID and not value & INVALID:
        raise SdoAbortedError(cia402.OUT_OF_RANGE)  # an existing PDO cannot change its identifier
    if value & 0x1FFF_F800:
        raise SdoAbortedError(cia402.OUT_OF_RANGE)  # standard frames only


def _check_count(od: canopen.ObjectDictionary, number: Number, index: int, count: int, received: bool) -> None:
    bits = 0
    for subindex in range(1, count + 1):
        entry = number(index, subindex)
        _mappable(od, entry, received)
        bits += entry & 0xFF
    if bits > 64:
        raise SdoAbortedError(cia402.PDO_TOO_LONG)


def _check_entry(od: canopen.ObjectDictionary, number: Number, index: int, entry: int, received: bool) -> None:
    if number(index, 0) != 0:
        raise SdoAbortedError(cia402.WRONG_STATE)  # entries change only while their number is zero
    if entry != 0:
        _mappable(od, entry, received)


def _mappable(od: canopen.ObjectDictionary, entry: int, received: bool) -> None:
    """Whether the mapping entry names an object of this direction with its true length."""
    index, subindex, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
    variable: Any = od.get_variable(index, subindex)
    if variable is None:
        raise SdoAbortedError(cia402.NO_OBJECT)
    if variable.data_type not in CODES:
        raise SdoAbortedError(cia402.NOT_MAPPABLE)
    dummy = index < 0x20 and received
    if not dummy and not (variable.pdo_mappable and (variable.writable if received else variable.readable)):
        raise SdoAbortedError(cia402.NOT_MAPPABLE)
    if len(variable) != bits:
        raise SdoAbortedError(cia402.WRONG_LENGTH)
