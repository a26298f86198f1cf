"""Quantities: unit, admissible range and meaning, declared once, at the field that holds them.

Inside the package every number is SI and a field's name is bare.  A field of a parameter block reads

    inertia: Annotated[float, Quantity("kg m^2 | kg", "(0, inf)", "all that moves, seen at the motor")]

and configuration, error messages, the JSON schema and the manual all read that one declaration.  Where a
rotary and a linear axis differ, the unit names both, rotary first.  The angle is a dimension: 1 Hz is not
1 rad/s, and 1 N m is not 1 N m/rad.
"""

import contextlib
import difflib
import functools
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from decimal import Decimal
from typing import Any, NamedTuple, get_args, get_type_hints

from stagectl.problem import Problem, ProblemKind

ROTARY, LINEAR = "rotary", "linear"


class StageError(Exception):
    """Root of every error that stagectl raises on purpose: `problems` say what happened, where, and what to do next.

    A plain text becomes a problem that has this text as its reason.
    """

    kind = ProblemKind.OTHER  # of a plain text

    def __init__(self, *problems: Problem | str) -> None:
        super().__init__(*problems)
        self.problems = tuple(entry if isinstance(entry, Problem) else Problem(entry, self.kind) for entry in problems)

    def __str__(self) -> str:
        return "\n".join(map(str, self.problems))


class UnitError(StageError):
    """A value whose unit is missing, unknown or of another dimension."""

    kind = ProblemKind.UNIT


class Quantity(NamedTuple):
    """What a number is: its SI unit (``rotary | linear`` where they differ), interval and meaning."""

    unit: str
    interval: str
    meaning: str

    def unit_for(self, axis: str) -> str:
        """SI unit on a rotary or linear axis; an empty string for a pure number."""
        return unit_on(axis, self.unit)

    def admits(self, value: float) -> bool:
        """Whether `value` (SI) lies in the interval; NaN never does."""
        low, high = self.bounds()
        at_end = (value == low and self.interval[0] == "[") or (value == high and self.interval[-1] == "]")
        return low < value < high or at_end

    def interval_in(self, unit: str, scale: float = 0.0) -> str:
        """The interval in `unit`, whose `scale` a lead may decide: ``[0, 1.5]`` rad is ``[0, 85.9] deg``."""
        low, high = (f"{end / (scale or factor(unit, self.unit)):.3g}" for end in self.bounds())
        return f"{self.interval[0]}{low}, {high}{self.interval[-1]} {unit}".rstrip()

    def bounds(self) -> tuple[float, float]:
        """Both ends of the interval (SI)."""
        low, high = self.interval[1:-1].split(",")
        return float(low), float(high)


def unit_on(axis: str, unit: str) -> str:
    """Of a unit that names both, ``rad | m``, that on a rotary or linear axis."""
    parts = [part.strip() for part in unit.split("|")]
    return parts[-1] if axis == LINEAR else parts[0]


def quantity_of(hint: Any) -> Quantity | None:
    """The `Quantity` in an ``Annotated`` type hint, or None."""
    return next((extra for extra in get_args(hint)[1:] if isinstance(extra, Quantity)), None)


def quantities_of(block: Any) -> dict[str, Quantity]:
    """The quantities of a parameter block, a class, by the names of their fields; other fields are left out."""
    return {name: q for name, hint in get_type_hints(block, include_extras=True).items() if (q := quantity_of(hint))}


class Tagged(NamedTuple):
    """A union of blocks that one key distinguishes: ``type: sine`` chooses the block of that name."""

    key: str
    blocks: Mapping[str, Any]
    default: str = ""  # the block where the key is absent; empty: the key is required


# Only what a motion system needs, and the angle is a dimension.
_PREFIXES = {
    **dict.fromkeys(("micro", "u", "µ", "μ"), 1e-6),
    **dict.fromkeys(("nano", "n"), 1e-9),
    **dict.fromkeys(("milli", "m"), 1e-3),
    **dict.fromkeys(("centi", "c"), 1e-2),  # a motor's data sheet gives its inertia in kg cm^2
    **dict.fromkeys(("kilo", "k"), 1e3),
    **dict.fromkeys(("mega", "M"), 1e6),
}
_BASE = ("metre m", "second s", "kilogram kg", "ampere A", "radian rad", "count counts", "bit")
_DERIVED = {  # names: scale and what it scales
    "gram g": (1e-3, "kg"),
    "minute min": (60.0, "s"),
    "hour h": (3600.0, "s"),
    "revolution rev": (6.283185307179586, "rad"),
    "degree deg °": (0.017453292519943295, "rad"),
    "arcminute arcmin": (2.908882086657216e-4, "rad"),
    "arcsecond arcsec": (4.84813681109536e-6, "rad"),
    "hertz Hz": (1.0, "1/s"),
    "rpm": (1.0, "rev/min"),
    "newton N": (1.0, "kg m/s^2"),
    "volt V": (1.0, "kg m^2/A/s^3"),
    "ohm Ohm Ω": (1.0, "V/A"),
    "percent %": (0.01, ""),
    "permille ‰": (0.001, ""),
}
# Each name: the first of its names, its scale and what it scales; a base unit has scale 0.
_NAMED = {
    name: (names.split()[0], *definition)
    for names, definition in (*((names, (0.0, "")) for names in _BASE), *_DERIVED.items())
    for name in names.split()
}
# ASCII digits only: a look-alike from another script must not move an axis.
_VALUE = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?)(?![0-9.,_])(.*)", re.DOTALL)
_POWER = r"[A-Za-zµμ°Ω%‰]+(?:(?:\^|\*\*)-?[1-9])?"
_UNIT = re.compile(rf"(?:1(?= ?/)|{_POWER})(?:(?: ?[*·/] ?| ){_POWER}){{0,8}}")
_FACTOR = re.compile(r"(/ ?)?([A-Za-zµμ°Ω%‰]+)(?:(?:\^|\*\*)(-?[1-9]))?")
_LIKELY = 8  # known names that a mistyped one is compared with
_LONGEST = 80  # characters of a value; no expression may keep the parsers busy


class _UnknownUnitError(Exception):
    """A name that is in no table."""


@functools.lru_cache(maxsize=1024)
def factor(unit: str, to: str) -> float:
    """Factor that converts `unit` to `to`: ``factor("mm", "m") == 0.001``.

    Raises UnitError where the unit is unknown, of another dimension, or beyond what a float holds.
    """
    ratio = Counter(_powers(unit))
    ratio.subtract(_powers(to))
    try:
        scales, bases = _expanded(ratio)
    except _UnknownUnitError as error:
        raise UnitError(_unknown(unit, str(error), to)) from error
    if any(bases.values()):
        raise UnitError(f"{unit!r} does not measure {to or 'a pure number'}")
    value = _product(scales)
    if not 0.0 < value < math.inf:
        raise UnitError(f"{unit!r} is out of all proportion")
    return value


def in_base_units(unit: str) -> tuple[float, dict[str, int]]:
    """Scale and exponents of the SI base units, by their symbols, the radian among them: N is ``kg m s^-2``.

    Raises UnitError where the unit is unknown.
    """
    try:
        scales, bases = _expanded(_powers(unit))
    except _UnknownUnitError as error:
        raise UnitError(f"unknown unit {unit!r}") from error
    symbols = dict(names.split()[:2] for names in _BASE if " " in names)
    return _product(scales), {symbols.get(name, name): exponent for name, exponent in bases.items() if exponent}


def _powers(unit: str) -> dict[str, int]:
    """Exponent of each name in `unit`, in the order of their appearance."""
    tidy = " ".join(unit.split())
    if len(tidy) > _LONGEST or (tidy and not _UNIT.fullmatch(tidy)):
        raise UnitError(f"{unit[:_LONGEST]!r} is not a unit{_stranger(unit)}")
    powers: dict[str, int] = {}
    for divided, name, exponent in _FACTOR.findall(tidy):
        powers[name] = powers.get(name, 0) + int(exponent or 1) * (-1 if divided else 1)
    return powers


def _expanded(powers: Mapping[str, int]) -> tuple[list[tuple[float, int]], Counter[str]]:
    """Scales with their exponents, and the exponents of the base units."""
    scales: list[tuple[float, int]] = []
    bases: Counter[str] = Counter()
    for name, exponent in powers.items():
        for scale, power in _scales(name)[0] if exponent else ():
            scales.append((scale, power * exponent))
        for base, power in _scales(name)[1].items():
            bases[base] += power * exponent
    return scales, bases


@functools.cache
def _scales(name: str) -> tuple[tuple[tuple[float, int], ...], Mapping[str, int]]:
    """Scales of one unit, outermost first, and its base units."""
    prefix, stem = _split(name)
    canonical, scale, of = _NAMED[stem]
    scales, bases = _expanded(_powers(of)) if scale else ([], Counter({canonical: 1}))
    outer = [(value, 1) for value in (_PREFIXES.get(prefix), scale) if value]
    return (*outer, *scales), bases


def _split(name: str) -> tuple[str, str]:
    """Prefix and unit; a unit of more than one letter may have a plural s.  Raises _UnknownUnitError."""
    for plural in ("", "s"):
        for prefix in ("", *_PREFIXES):
            stem = name.removeprefix(prefix).removesuffix(plural)
            if f"{prefix}{stem}{plural}" == name and stem in _NAMED and (len(stem) > 1 or not plural):
                return prefix, stem
    raise _UnknownUnitError(name)


def _unknown(unit: str, name: str, to: str) -> str:
    """What to say of a `unit` in which `name` is unknown: ``Nm`` is two units, ``sec`` is like one."""
    known = dict.fromkeys(f"{prefix}{stem}" for stem in _NAMED for prefix in ("", *_PREFIXES) if len(prefix) < 2)
    parts = [f"{name[:at]} {name[at:]}" for at in range(1, len(name)) if {name[:at], name[at:]} <= known.keys()]
    lower = dict.fromkeys(word.lower() for word in known)
    likely = difflib.get_close_matches(name.lower().removesuffix("s"), lower, _LIKELY)
    spelt = sorted((word for word in known if word.lower() in likely), key=lambda word: _distance(word, name, likely))
    within = "" if name == unit else f", {name!r} in it"
    meant = (unit.replace(name, near) for near in parts[:1] or spelt)
    near = next((f", perhaps {whole}" for whole in meant if _measures(whole, to)), "")
    return f"unknown unit {unit!r}{within}{near or ('' if to else ': a plain number belongs here')}"


def _measures(unit: str, to: str) -> bool:
    with contextlib.suppress(UnitError):
        return in_base_units(unit)[1] == in_base_units(to)[1]
    return False


def _distance(word: str, name: str, likely: list[str]) -> tuple[int, bool, bool]:
    """How a known word sorts beside the `name` that was typed: by likeness; MM is mm, MBit and MB are Mbit."""
    shouted = name.isupper() and len(name) == 2 and word.upper() == name
    return likely.index(word.lower()), shouted and not word.islower(), word[0] != name[0]


def _stranger(text: str) -> str:
    """The first character that only looks like one of ours, by its code."""
    odd = next((letter for letter in text[:_LONGEST] if ord(letter) > 127 and letter not in "µμ°Ω‰·"), "")
    power = ", a power as in m^2" if odd and odd in "²³" else ""
    return f": U+{ord(odd):04X} in it, type it in ASCII{power}" if odd else ""


def _product(scales: Iterable[tuple[float, int]]) -> float:
    """Powers of equal scales are added first: ``mm/mm`` is 1 exactly."""
    above, below = Counter[float](), Counter[float]()
    for scale, exponent in scales:
        (above if exponent > 0 else below)[scale] += exponent
    powers = [(scale, max(above[scale] + below[scale], 0)) for scale in above]
    powers += [(scale, min(above[scale] + below[scale], 0)) for scale in below]
    try:
        return math.prod((scale**power for scale, power in powers), start=1.0)
    except OverflowError:
        return math.inf


def unit_in(text: str) -> str:
    """The unit of a quantity that was typed, ``mm`` of ``12 mm``; empty where there is none."""
    match = _VALUE.fullmatch(text.strip())
    return match[2].strip() if match else ""


def parse(text: str, to: str) -> float:
    """``parse("12 mm", "m") == 0.012``; the unit must be there unless `to` is a pure number.

    Raises UnitError with the reason.
    """
    match = _VALUE.fullmatch(text.strip()) if len(text) <= _LONGEST else None
    if match is None:
        comma = "; its decimals need a point" if re.match(r"\s*[+-]?[0-9]*,[0-9]", text) else _stranger(text)
        raise UnitError(Problem(f"not a number{' with a unit' if to else ''}{comma}", ProblemKind.VALUE))
    number, unit = match[1], match[2].strip()
    if unit == "" and to != "":
        raise UnitError("the unit is missing")
    # In decimal, so that 12 mm is the double nearest to 0.012, as a person would write it.
    value = float(Decimal(number) * Decimal(repr(factor(unit, to))))
    if math.isinf(value):
        raise UnitError(Problem("too large for a number", ProblemKind.VALUE))
    return value
