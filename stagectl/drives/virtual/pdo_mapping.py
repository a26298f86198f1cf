"""PDO mapping of the virtual drive: CiA 301's rules for changing it, and the PDOs compiled."""

import struct
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.library import SdoAbortedError, canopen
from stagectl.drives.canopen.pdo import (
    CODES,
    COUNT,
    DUMMIES,
    EVENT_TIMER,
    INVALID,
    RPDO,
    TPDO,
    Direction,
    PdoMap,
    layout,
)

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


def check(od: canopen.ObjectDictionary, number: Number, index: int, subindex: int, value: int) -> None:
    """Check that CiA 301 admits writing `value` to an object, if it is a PDO's, now.  Raises SdoAbortedError."""
    for way in (RPDO, TPDO):
        if way.parameter <= index < way.parameter + COUNT and subindex == 1:
            _check_identifier(number(index, 1), value)
        if way.mapping <= index < way.mapping + COUNT:
            if not number(index - way.mapping + way.parameter, 1) & INVALID:
                raise SdoAbortedError(cia402.WRONG_STATE)  # only a PDO that is switched off can be mapped anew
            if subindex == 0:
                _check_count(od, number, index, value, way.received)
            else:
                _check_entry(od, number, index, value, way.received)


def received(number: Number, od: canopen.ObjectDictionary) -> list[Rpdo]:
    """The RPDOs that exist, compiled from the object dictionary."""
    pdos = []
    for pdo, codes, length in _existing(number, od, RPDO):
        deadline = number(RPDO.parameter + pdo.number, EVENT_TIMER) * 1e-3
        head, fields = struct.pack("<I", pdo.identifier), struct.Struct("<8x" + codes)
        pdos.append(Rpdo(head, length, fields, pdo.objects, pdo.transmission <= 240, deadline))
    return pdos


def sent(number: Number, od: canopen.ObjectDictionary) -> list[Tpdo]:
    """The TPDOs that exist, compiled from the object dictionary."""
    return [
        Tpdo((pdo.identifier, length), struct.Struct(f"<IB3x{codes}{8 - length}x"), pdo.objects, pdo.transmission)
        for pdo, codes, length in _existing(number, od, TPDO)
    ]


def _existing(number: Number, od: canopen.ObjectDictionary, way: Direction) -> Iterator[tuple[PdoMap, str, int]]:
    """Each PDO of a direction that exists, with its struct codes and its length (bytes)."""
    for n in range(COUNT):
        identifier, at = number(way.parameter + n, 1), way.mapping + n
        entries = tuple(number(at, subindex) for subindex in range(1, number(at, 0) + 1))
        if not identifier & INVALID and entries:
            pdo = PdoMap(identifier & 0x7FF, entries, number=n, transmission=number(way.parameter + n, 2))
            yield pdo, *layout(od, entries, way.name)


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
    dummy = index < DUMMIES and received
    if not dummy and not (variable.pdo_mappable and (variable.writable if received else variable.readable)):
        raise SdoAbortedError(cia402.NOT_MAPPABLE)
    if len(variable) != bits:
        raise SdoAbortedError(cia402.WRONG_LENGTH)
