"""The two PDOs of the cyclic path as precompiled structs; the EDS gives sizes and places of their fields."""

import math
import struct
from typing import Any, NamedTuple

from stagectl.drives.bus import frames
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.library import canopen
from stagectl.drives.drive import Canopen, DriveError

CODES = {0x2: "b", 0x3: "h", 0x4: "i", 0x5: "B", 0x6: "H", 0x7: "I", 0x15: "q", 0x1B: "Q"}  # by CiA 301 data type
INVALID = 0x8000_0000  # bit of a PDO's COB-ID: the PDO does not exist
COUNT = 4  # PDOs in each direction that a virtual drive has, and that are looked at in another one
EVENT_TIMER = 5  # subindex: the deadline of an RPDO, ms
DUMMIES = 0x20  # indices below are CiA 301's placeholders
_WIDTHS = {8: "B", 16: "H", 32: "I", 64: "Q"}  # of objects that the EDS does not know


class PdoMap(NamedTuple):
    """One PDO as the drive has it."""

    identifier: int  # 11 bits
    entries: tuple[int, ...]  # as in the mapping object: index << 16 | subindex << 8 | bits
    fill: tuple[int, ...] = ()  # of an RPDO: what is sent of objects that are not the cycle's own
    number: int = 0  # of the PDO, less 1
    transmission: int = 1  # type: 1 at every SYNC

    @property
    def objects(self) -> tuple[int, ...]:
        """What is mapped, index << 8 | subindex, in the order of the frame."""
        return tuple(entry >> 8 for entry in self.entries)


class Direction(NamedTuple):
    """Objects of one direction of PDOs."""

    name: str  # as the stage file calls it
    identifier: int  # of the first PDO, less the node (CiA 301, 7.3.5)
    parameter: int
    mapping: int
    received: bool  # by the drive


RPDO = Direction("rpdo", frames.RPDO, cia402.RPDO_PARAMETER, cia402.RPDO_MAPPING, True)
TPDO = Direction("tpdo", frames.TPDO, cia402.TPDO_PARAMETER, cia402.TPDO_MAPPING, False)


def needed(settings: Canopen, direction: Direction) -> dict[int, str]:
    """Objects that the PDO of the cycle must hold, in words."""
    if direction.received:
        return {cia402.CONTROLWORD << 8: "the controlword", settings.command_object: "the current command"}
    answer = {cia402.STATUSWORD << 8: "the statusword", cia402.POSITION << 8: "the position"}
    return {**answer, settings.current_object: "the measured current"} if settings.current_object else answer


def wished(settings: Canopen, od: canopen.ObjectDictionary, direction: Direction) -> PdoMap:
    """What the stage file wants the drive to receive or send.  Raises DriveError where it cannot work."""
    name = direction.name
    objects: tuple[int, ...] = getattr(settings, name)
    entries = tuple(key << 8 | _bits(settings, od, name, key) for key in objects)
    length = sum(entry & 0xFF for entry in entries) // 8
    if not 1 <= length <= 8:
        raise DriveError(
            f"{name}: the mapped objects take {length} bytes; must lie in [1, 8]; map fewer", place=name, value=length
        )
    for key, words in needed(settings, direction).items():
        if key not in objects:
            raise DriveError(f"{name} holds no 0x{key:06X} ({words}); add it to '{name}'", place=name, object_key=key)
    return PdoMap(direction.identifier + settings.node, entries)


class CommandPdo:
    """Controlword and current command, as the drive expects them."""

    def __init__(self, settings: Canopen, od: canopen.ObjectDictionary, pdo: PdoMap | None = None) -> None:
        """Compiled from `pdo` as read back from the drive; without it, as `settings` wish it.  Raises DriveError."""
        pdo = pdo or wished(settings, od, RPDO)
        objects = pdo.objects
        codes, length = layout(od, pdo.entries, "rpdo")
        self._command = 2 + objects.index(settings.command_object)
        self._control = 2 + objects.index(cia402.CONTROLWORD << 8)
        self._struct = struct.Struct(f"<IB3x{codes}{8 - length}x")
        fill = pdo.fill or (0,) * len(objects)
        self._fields = [pdo.identifier, length, *fill]
        self._modes = [place for place, key in enumerate(objects, start=2) if key == cia402.MODE << 8]
        self.order_mode(cia402.CYCLIC_SYNCHRONOUS_TORQUE)
        self._scale = settings.command_scale
        self._low, self._high = _interval(codes[self._command - 2])

    def order_mode(self, mode: int) -> None:
        """The mode of operation that goes out from now on, where it is mapped."""
        for place in self._modes:
            self._fields[place] = mode

    @property
    def current(self) -> float:
        """The last command (A)."""
        return self._fields[self._command] * self._scale

    def encode(self, controlword: int, current: float) -> bytes:
        """The frame; `current` (A) in counts, halves upwards, saturated.  Raises ValueError on NaN."""
        scaled = current / self._scale + 0.5
        if self._low <= scaled <= self._high:
            counts = math.floor(scaled)
        elif scaled != scaled:
            raise ValueError("current command is not a number")
        else:
            counts = self._high if scaled > 0.0 else self._low
        fields = self._fields
        fields[self._control], fields[self._command] = controlword, counts
        return self._struct.pack(*fields)


class FeedbackPdo:
    """Statusword, position and current, as the drive sends them."""

    def __init__(self, settings: Canopen, od: canopen.ObjectDictionary, pdo: PdoMap | None = None) -> None:
        """Compiled from `pdo` as read back from the drive; without it, as `settings` wish it.  Raises DriveError."""
        pdo = pdo or wished(settings, od, TPDO)
        objects = pdo.objects
        codes, length = layout(od, pdo.entries, "tpdo")
        self._status = objects.index(cia402.STATUSWORD << 8)
        self._position = objects.index(cia402.POSITION << 8)
        self._current = objects.index(settings.current_object) if settings.current_object else -1
        self._scale = settings.current_scale
        self._struct = struct.Struct("<8x" + codes)
        self.identifier = pdo.identifier
        self.head = struct.pack("<IB", self.identifier, length)
        low, high = _interval(codes[self._position])
        self._half, self._mask = (high - low + 1) // 2, high - low
        self._counts: int | None = None

    def decode(self, raw: bytes) -> tuple[int, int, float]:
        """Statusword, unwrapped position (counts) and current (A, NaN where there is none) of a frame with `head`."""
        fields = self._struct.unpack_from(raw)
        position = fields[self._position]
        if self._counts is None:
            self._counts = position
        # The drive's counter wraps around; between two samples it never moves by half of its range.
        self._counts += (position - self._counts + self._half & self._mask) - self._half
        current = fields[self._current] * self._scale if self._current >= 0 else math.nan
        return fields[self._status], self._counts, current


def _bits(settings: Canopen, od: canopen.ObjectDictionary, name: str, key: int) -> int:
    """Length of an object that can be mapped."""
    variable = od.get_variable(key >> 8, key & 0xFF)
    if variable is None:
        raise _unfit(name, key, f"is not in {settings.eds}; name one that is")
    if variable.data_type not in CODES:
        words = f"has data type 0x{variable.data_type or 0:X}; must be an integer of 8, 16, 32 or 64 bits"
        raise _unfit(name, key, f"{words}; map another object", variable.data_type)
    if not variable.pdo_mappable and key >> 8 >= DUMMIES:
        raise _unfit(name, key, f"cannot be mapped according to {settings.eds}; map another object")
    return len(variable)


def _unfit(name: str, key: int, words: str, value: int | None = None) -> DriveError:
    """The error about an object that the PDO `name` of the stage file cannot hold."""
    return DriveError(f"{name}: object 0x{key:06X} {words}", place=name, object_key=key, value=value)


def layout(od: canopen.ObjectDictionary, entries: tuple[int, ...], name: str) -> tuple[str, int]:
    """Struct codes and length (bytes) of a map; signs as the EDS gives them.  Raises DriveError."""
    codes = ""
    for entry in entries:
        variable: Any = od.get_variable(entry >> 16, entry >> 8 & 0xFF)
        code = CODES.get(variable.data_type) if variable is not None else None
        if code is None or 8 * struct.calcsize("<" + code) != entry & 0xFF:
            code = _WIDTHS.get(entry & 0xFF)
        if code is None:
            raise DriveError(
                f"{name}: the drive maps 0x{entry:08X}, an object of {entry & 0xFF} bits; must be 8, 16, 32 or 64;"
                " map another one with the drive's own tool",
                place=name,
                object_key=entry >> 8,
                value=entry & 0xFF,
            )
        codes += code
    return codes, struct.calcsize("<" + codes)


def _interval(code: str) -> tuple[int, int]:
    """Smallest and largest integer of a struct code."""
    bits = 8 * struct.calcsize("<" + code)
    return (0, 2**bits - 1) if code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
