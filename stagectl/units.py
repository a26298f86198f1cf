"""Quantities: unit, admissible range and meaning, declared once, beside the field that holds them.

Inside the package every number is SI and a field's name is bare.  A field of a parameter block reads

    inertia: Annotated[float, Quantity("kg m^2 | kg", "(0, inf)", "all that moves, seen at the motor")]

and configuration, error messages, the JSON schema and the manual all read that one declaration.  Where a
rotary and a linear axis differ, the unit names both, rotary first.  The units are those of the table below, in which
the angle is a dimension: 1 Hz is not 1 rad/s, and 1 N m is not 1 N m/rad.
"""

from __future__ import annotations

import functools
import math
import re
from collections import Counter
from decimal import Decimal
from fractions import Fraction
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


# Only what a motion system needs, and the angle is a dimension: name = what it is = other names.
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
count = [count]
bit = [information]
minute = 60 s = min
hour = 3600 s = h
revolution = 6.283185307179586 rad = rev
degree = 0.017453292519943295 rad = deg = °
arcminute = 2.908882086657216e-4 rad = arcmin
arcsecond = 4.84813681109536e-6 rad = arcsec
hertz = 1 1/s = Hz
rpm = 1 rev/min
newton = 1 kg m/s^2 = N
volt = 1 kg m^2/A/s^3 = V
ohm = 1 V/A = Ohm = Ω
percent = 0.01 = %
permille = 0.001 = ‰
"""
# ASCII digits only: a look-alike from another script must not move an axis.
_VALUE = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?)(?![0-9.,_])(.*)", re.DOTALL)
_POWER = r"[A-Za-zµμ°Ω%‰]+(?:(?:\^|\*\*)-?[0-9])?"
_UNIT = re.compile(rf"(?:1(?= ?/)|{_POWER})(?:(?: ?[*·/] ?| ){_POWER}){{0,8}}")
_FACTOR = re.compile(r"(/?) ?([^ /^]+)(?:\^(-?[0-9]))?")
_PLURAL = 4  # letters of a name that may end in s: "counts"; "Ns" may have been meant as N s
_LONGEST = 80  # characters of a value; no expression may keep the parsers busy


class _Size(NamedTuple):
    """What a unit is: so many times a product of powers of the dimensions; exact, rounded once at the end."""

    times: Fraction
    powers: Counter[str]


@functools.cache
def _known() -> tuple[dict[str, Fraction], dict[str, _Size]]:
    """Prefixes and units by all their names."""
    prefixes: dict[str, Fraction] = {}
    units: dict[str, _Size] = {"1": _Size(Fraction(1), Counter())}
    for line in _DEFINITIONS.strip().splitlines():
        name, meaning, *others = line.split(" = ")
        if name.endswith("-"):
            prefixes |= dict.fromkeys((one[:-1] for one in (name, *others)), Fraction(meaning))
        else:
            units |= dict.fromkeys((name, *others), _defined(meaning, prefixes, units))
    return prefixes, units


def _defined(meaning: str, prefixes: dict[str, Fraction], units: dict[str, _Size]) -> _Size:
    if meaning.startswith("["):
        return _Size(Fraction(1), Counter({meaning: 1}))
    number, _, unit = meaning.partition(" ")
    size = _product(unit, prefixes, units)
    return size._replace(times=size.times * Fraction(number))


def _product(unit: str, prefixes: dict[str, Fraction], units: dict[str, _Size]) -> _Size:
    """Of all factors, from left to right.  Raises UnitError."""
    times, powers = Fraction(1), Counter[str]()
    for over, name, power in _FACTOR.findall(unit):
        one, exponent = _named(name, prefixes, units), int(power or 1) * (-1 if over else 1)
        times *= one.times**exponent
        for dimension, count in one.powers.items():
            powers[dimension] += count * exponent
    return _Size(times, powers)


def _named(name: str, prefixes: dict[str, Fraction], units: dict[str, _Size]) -> _Size:
    for each in (name, name[:-1]) if name.endswith("s") and len(name) >= _PLURAL else (name,):
        if each in units:
            return units[each]
        for prefix, times in prefixes.items():
            base = units.get(each.removeprefix(prefix)) if each.startswith(prefix) else None
            if base is not None:
                return base._replace(times=base.times * times)
    raise UnitError(f"unknown unit {name!r}")


@functools.lru_cache(maxsize=1024)
def factor(unit: str, to: str) -> float:
    """Factor that converts `unit` to `to`: ``factor("mm", "m") == 0.001``.

    Raises UnitError where the unit is unknown, of another dimension, or beyond what a float holds.
    """
    given, wanted = (_product(_spelled(one), *_known()) for one in (unit, to))
    if given.powers != wanted.powers:
        raise UnitError(f"{unit!r} does not measure {to or 'a pure number'}")
    try:
        found = float(given.times / wanted.times)
    except OverflowError:
        found = math.inf
    if not 0.0 < found < math.inf:
        raise UnitError(f"{unit!r} is out of all proportion")
    return found


def _spelled(unit: str) -> str:
    """With ``^`` for powers and a space between factors.  Raises UnitError where it is no unit at all."""
    tidy = " ".join(unit.split())
    if len(tidy) > _LONGEST or (tidy and not _UNIT.fullmatch(tidy)):
        raise UnitError(f"{unit[:_LONGEST]!r} is not a unit")
    return " ".join(re.sub(r"[*·]", " ", tidy.replace("**", "^")).split()).replace(" /", "/")


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
