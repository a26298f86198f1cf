"""Quantities: unit, admissible range and meaning, declared once, beside the field that holds them.

Inside the package every number is SI and a field's name is bare.  A field of a parameter block reads

    inertia: Annotated[float, Quantity("kg m^2 | kg", "(0, inf)", "all that moves, seen at the motor")]

and configuration, error messages, the JSON schema and the manual all read that one declaration.  Where a
rotary and a linear axis differ, the unit names both, rotary first.  Units are parsed by pint with a registry
of our own in which the angle is a dimension: 1 Hz is not 1 rad/s, and 1 N m is not 1 N m/rad.
"""

from __future__ import annotations

import functools
import math
import re
from decimal import Decimal
from typing import Annotated, Any, NamedTuple, get_args, get_origin

ROTARY, LINEAR = "rotary", "linear"


class StageError(Exception):
    """Root of every error that stagectl raises on purpose: what happened, where, and what to do next."""


class UnitError(StageError):
    """A value whose unit is missing, unknown or of another dimension."""


class Quantity(NamedTuple):
    """What a number is: its SI unit (``rotary | linear`` where they differ), interval and meaning."""

    unit: str
    interval: str
    meaning: str

    def unit_for(self, axis: str) -> str:
        """SI unit on a rotary or linear axis; an empty string for a pure number."""
        parts = [part.strip() for part in self.unit.split("|")]
        return parts[-1] if axis == LINEAR else parts[0]

    def admits(self, value: float) -> bool:
        """Whether `value` (SI) lies in the interval; NaN never does."""
        low, high = self.bounds()
        above = value > low if self.interval[0] == "(" else value >= low
        below = value < high if self.interval[-1] == ")" else value <= high
        return above and below

    def bounds(self) -> tuple[float, float]:
        """Both ends of the interval (SI)."""
        low, high = self.interval[1:-1].split(",")
        return float(low), float(high)


def quantity_of(hint: Any) -> Quantity | None:
    """The `Quantity` in an ``Annotated`` type hint, or None."""
    if get_origin(hint) is not Annotated:
        return None
    return next((extra for extra in get_args(hint)[1:] if isinstance(extra, Quantity)), None)


# A registry of our own: only what a motion system needs, and the angle is a dimension.
_DEFINITIONS = """
micro- = 1e-6 = u- = µ- = μ-
nano- = 1e-9 = n-
milli- = 1e-3 = m-
kilo- = 1e3 = k-
mega- = 1e6 = M-
metre = [length] = m
second = [time] = s
kilogram = [mass] = kg
gram = 1e-3 kg = g
ampere = [current] = A
radian = [angle] = rad
count = [count] = count = counts
bit = [information] = bit
minute = 60 s = min
hour = 3600 s = h
revolution = 6.283185307179586 rad = rev
degree = 0.017453292519943295 rad = deg = °
arcminute = 2.908882086657216e-4 rad = arcmin
arcsecond = 4.84813681109536e-6 rad = arcsec
hertz = 1 / s = Hz
rpm = rev / min
newton = kg * m / s ** 2 = N
volt = kg * m ** 2 / A / s ** 3 = V
ohm = V / A = Ohm = Ω
percent = 0.01 = %
permille = 0.001 = ‰
"""
# ASCII digits only: a look-alike from another script must not move an axis.
_VALUE = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?)(?![0-9.,_])(.*)", re.DOTALL)
_POWER = r"[A-Za-zµμ°Ω%‰]+(?:(?:\^|\*\*)-?[0-9])?"
_UNIT = re.compile(rf"(?:1(?= ?/)|{_POWER})(?:(?: ?[*·/] ?| ){_POWER}){{0,8}}")
_LONGEST = 80  # characters of a value; no expression may keep the parsers busy


@functools.cache
def _registry() -> Any:
    import pint  # a third of a second: only where configuration is read

    registry: Any = pint.UnitRegistry(None)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


@functools.lru_cache(maxsize=1024)
def factor(unit: str, to: str) -> float:
    """Factor that converts `unit` to `to`: ``factor("mm", "m") == 0.001``.

    Raises UnitError where the unit is unknown, of another dimension, or beyond what a float holds.
    """
    import pint

    registry = _registry()
    try:
        found = float(registry.Quantity(1.0, _spelled(unit)).to(_spelled(to)).magnitude)
    except UnitError:
        raise
    except pint.errors.UndefinedUnitError as error:
        raise UnitError(f"unknown unit {unit!r}") from error
    except pint.errors.DimensionalityError as error:
        raise UnitError(f"{unit!r} does not measure {to or 'a pure number'}") from error
    except Exception as error:  # pint raises many kinds on text that is no unit at all
        raise UnitError(f"{unit!r} is not a unit") from error
    if not 0.0 < found < math.inf:
        raise UnitError(f"{unit!r} is out of all proportion")
    return found


def _spelled(unit: str) -> str:
    tidy = " ".join(unit.split())
    if len(tidy) > _LONGEST or (tidy and not _UNIT.fullmatch(tidy)):
        raise UnitError(f"{unit[:_LONGEST]!r} is not a unit")
    return tidy.replace("·", "*") or "dimensionless"


def parse(text: str, to: str) -> float:
    """``parse("12 mm", "m") == 0.012``; the unit must be there unless `to` is a pure number.

    Raises UnitError saying what is wrong with the text.
    """
    match = _VALUE.fullmatch(text.strip()) if len(text) <= _LONGEST else None
    if match is None:
        raise UnitError(f"not a number{' with a unit' if to else ''}")
    number, unit = match[1], match[2].strip()
    if unit == "" and to != "":
        raise UnitError("the unit is missing")
    # In decimal, so that 12 mm is the double nearest to 0.012, as a person would write it.
    value = float(Decimal(number) * Decimal(repr(factor(unit, to))))
    if math.isinf(value):
        raise UnitError("too large for a number")
    return value
