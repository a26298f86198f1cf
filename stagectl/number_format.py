"""Numbers on screens and pages: a prefix that fits, and as many digits as carry information."""

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

UNKNOWN = "not known"
NORMAL = 1.96  # standard deviations on either side of a mean that hold 95 % of a normal distribution
_ROUNDS_UP = 0.9995  # of a prefix's unit, from which three digits round to one
_SMALL = 1e-12  # below it a number has no prefix
_MOST_PLACES = 6  # decimal places
_FREE = 7  # decimal places from which a number may have an exponent
_PREFIXES = (("", 1.0), ("m", 1e3), ("µ", 1e6), ("n", 1e9))  # and how many of its units are one
_ANGLE = "phase"  # word in the name of a parameter in rad that is no position of the axis
_PREFIXED = ("m", "s", "A", "m/s", "rad")  # units that take a prefix


class Travel(NamedTuple):
    """How positions of an axis are shown."""

    per_unit: float  # m per rad, or 1
    unit: str  # m, or rad where no lead is known
    rotary: bool

    def length(self, way: float, per: str = "") -> str:
        """A way (rad | m) of the axis, or its speed with ``/s`` as `per`, as travel: ``12.3 nm``, ``0.2 mm/s``."""
        return length(way * self.per_unit, f"{self.unit}{per}")


class Estimate(Protocol):
    """A value (SI) with its 95 % interval."""

    @property
    def value(self) -> float: ...  # noqa: D102
    @property
    def low(self) -> float: ...  # noqa: D102
    @property
    def high(self) -> float: ...  # noqa: D102
    @property
    def unit(self) -> str: ...  # noqa: D102


def length(value: float | None, unit: str) -> str:
    """A small length in the prefix that fits: ``12.3 nm``, ``4.97 µm``, ``0.2 mm``."""
    if value is None:
        return "not reached"
    letter, scale = _fitting(abs(value))
    return f"{_three_digits(value * scale)} {letter}{unit}"


def _three_digits(value: float) -> str:
    """``0.20``, ``4.97``, ``230``: with trailing zeros."""
    return f"{value:#.3g}".rstrip(".")


def duration(value: float) -> str:
    """A time in the prefix that fits: ``0.5 ms``, ``24.8 s``."""
    letter, scale = _of_time(abs(value))
    return f"{value * scale:.3g} {letter}s"


def _of_time(size: float) -> tuple[str, float]:
    """As `prefix`, for a time; down to tenths."""
    fitting = (each for each in _PREFIXES[:2] if size * each[1] >= 0.1 * _ROUNDS_UP or size == 0.0)
    return next(fitting, _PREFIXES[2])


_NOTHING, _MORE_THAN_ALL = 0.0005, 1.005  # shares from which 0 % and 100 % would be written otherwise


def percent(share: float) -> str:
    """``82 %``; below one per cent with a digit, and never ``-0 %``."""
    if not math.isfinite(share):
        return UNKNOWN
    value = 100.0 * share
    if abs(share) < _NOTHING:
        return "0 %"
    return f"{value:.1f} %" if abs(value) < 1.0 else f"{value:.0f} %"


def portion(share: float) -> str:
    """``82 %`` of a whole; below zero and above one, where parts cancel, in words: ``none``, ``all``."""
    if share <= -_NOTHING:
        return "none"
    return "all" if share >= _MORE_THAN_ALL else percent(share)


def prefix(largest: float) -> tuple[str, float]:
    """The prefix in which a number of this size reads well, and how many of its units are one."""
    return _PREFIXES[0] if largest < _SMALL else _fitting(largest)


def _fitting(size: float) -> tuple[str, float]:
    return next((each for each in _PREFIXES if size * each[1] >= _ROUNDS_UP), _PREFIXES[-1])


def together(values: Sequence[float], unit: str, travel: Travel) -> tuple[list[str], str]:
    """Numbers of one kind to two digits, all in the prefix that fits the largest, and their unit."""
    per, name = (travel.per_unit, travel.unit) if unit == "rad" else (1.0, unit)
    letter, scale = prefix(max((abs(value) * per for value in values if math.isfinite(value)), default=0.0))
    return [_two_digits(value * per * scale) for value in values], f"{letter}{name}"


def _two_digits(value: float) -> str:
    """``2.9``, ``0.34``, ``230``."""
    if not math.isfinite(value):
        return UNKNOWN
    places = 1 - math.floor(math.log10(abs(value))) if abs(value) > 1e-9 else 0
    return f"{value:.{min(max(places, 0), _MOST_PLACES)}f}"


def interval(name: str, estimate: Estimate, travel: Travel) -> str:
    """The parameter `name` with its interval: ``0.182 (0.171 to 0.193)``, ``14 µm (12 to 16)``."""
    scale, unit = _unit(name, estimate, travel)
    places = _decimals(estimate, scale)
    value, low, high = (_rounded(x / scale, places) for x in (estimate.value, estimate.low, estimate.high))
    shown = f"{value} {unit}".rstrip()
    return shown if places is None else f"{shown} ({low} to {high})"


def three_digits(name: str, estimate: Estimate, travel: Travel) -> str:
    """The parameter `name` without its interval: ``0.182``, ``14 µm``."""
    scale, unit = _unit(name, estimate, travel)
    return f"{estimate.value / scale:.3g} {unit}".rstrip()


def _rounded(value: float, places: int | None) -> str:
    if places is None or not math.isfinite(value) or not value:
        return f"{value:.4g}"
    digits = max(places + 1 + math.floor(math.log10(abs(value))), 1)  # as many, where the number has an exponent
    return f"{value:.{places}f}" if places < _FREE else f"{value:.{digits}g}"


def _decimals(estimate: Estimate, scale: float) -> int | None:
    """Decimal places: two digits of the half width of the interval; None where there is no interval, or of no width."""
    half = 0.5 * (estimate.high - estimate.low) / scale
    return max(0, 1 - math.floor(math.log10(half))) if math.isfinite(half) and half > 0.0 else None


def _unit(name: str, estimate: Estimate, travel: Travel) -> tuple[float, str]:
    """SI size of the unit that a parameter is shown in, and its name."""
    unit, per, angle = estimate.unit, 1.0, _ANGLE in name.split("_")
    if unit.split("/")[0] == "rad" and travel.unit == "m" and travel.rotary and not angle:
        unit, per = unit.replace("rad", "m", 1), travel.per_unit
    if unit not in _PREFIXED or angle or estimate.value == 0.0:
        return 1.0 / per, unit
    letter, scale = _of_time(abs(estimate.value)) if unit == "s" else _fitting(abs(estimate.value) * per)
    return 1.0 / (scale * per), f"{letter}{unit}"
