"""The two PDOs of the cyclic path as precompiled structs; the EDS gives sizes and places of their fields."""

from __future__ import annotations

import math
import struct

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.library import canopen
from stagectl.drives.canopen.pdo_mapping import CODES
from stagectl.drives.drive import Canopen, DriveError

_FIXED = {cia402.MODE << 8: cia402.CYCLIC_SYNCHRONOUS_TORQUE}  # fields of the RPDO that never change
_DUMMIES = 0x20  # indices below are CiA 301's placeholders


class CommandPdo:
    """Controlword and current command, as the drive expects them."""

    def __init__(self, settings: Canopen, od: canopen.ObjectDictionary) -> None:
        """Raises DriveError where `settings.rpdo` does not hold what the cycle needs."""
        objects = settings.rpdo
        codes, length = _layout(od, objects, "rpdo", settings)
        control = _place(objects, cia402.CONTROLWORD << 8, "rpdo", "the controlword")
        self._command = 2 + _place(objects, settings.command_object, "rpdo", "the current command")
        self._control = 2 + control
        self._struct = struct.Struct(f"<IB3x{codes}{8 - length}x")
        self._fields = [0x200 + settings.node, length, *(_FIXED.get(key, 0) for key in objects)]
        self._scale = settings.command_scale
        self._low, self._high = _interval(codes[self._command - 2])

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

    def __init__(self, settings: Canopen, od: canopen.ObjectDictionary) -> None:
        """Raises DriveError where `settings.tpdo` does not hold what the cycle needs."""
        objects = settings.tpdo
        codes, length = _layout(od, objects, "tpdo", settings)
        self._status = _place(objects, cia402.STATUSWORD << 8, "tpdo", "the statusword")
        self._position = _place(objects, cia402.POSITION << 8, "tpdo", "the position")
        wanted = settings.current_object
        self._current = _place(objects, wanted, "tpdo", "the measured current") if wanted else -1
        self._scale = settings.current_scale
        self._struct = struct.Struct("<8x" + codes)
        self.identifier = 0x180 + settings.node
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


def _layout(od: canopen.ObjectDictionary, objects: tuple[int, ...], name: str, settings: Canopen) -> tuple[str, int]:
    """Struct codes and length (bytes) of the mapped objects."""
    codes = ""
    for key in objects:
        variable = od.get_variable(key >> 8, key & 0xFF)
        if variable is None:
            raise DriveError(
                f"{name}: object 0x{key:06X} is not in {settings.eds}; name one that is", place=name, object_key=key
            )
        if variable.data_type not in CODES:
            raise DriveError(
                f"{name}: object 0x{key:06X} has data type 0x{variable.data_type or 0:X}; must be an integer of"
                " 8, 16, 32 or 64 bits; map another object",
                place=name,
                object_key=key,
                value=variable.data_type,
            )
        if not variable.pdo_mappable and key >> 8 >= _DUMMIES:
            raise DriveError(
                f"{name}: object 0x{key:06X} cannot be mapped according to {settings.eds}; map another object",
                place=name,
                object_key=key,
            )
        codes += CODES[variable.data_type]
    length = struct.calcsize("<" + codes)
    if not 1 <= length <= 8:
        raise DriveError(
            f"{name}: the mapped objects take {length} bytes; must lie in [1, 8]; map fewer", place=name, value=length
        )
    return codes, length


def _place(objects: tuple[int, ...], key: int, name: str, what: str) -> int:
    if key not in objects:
        raise DriveError(f"{name} holds no 0x{key:06X} ({what}); add it to '{name}'", place=name, object_key=key)
    return objects.index(key)


def _interval(code: str) -> tuple[int, int]:
    """Smallest and largest integer of a struct code."""
    bits = 8 * struct.calcsize("<" + code)
    return (0, 2**bits - 1) if code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
