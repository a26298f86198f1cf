"""Numbers of a diagnosis as a person reads them: travel where the axis has one, a prefix that fits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from stagectl.gap.result.diagnosis import DiagnosisResult, Value
from stagectl.number_format import duration, length

_SMALL = 1e-12
_FREE = 7  # decimal places from which a number is written as it comes
_PREFIXES = (("", 1.0), ("m", 1e3), ("µ", 1e6), ("n", 1e9))  # and numbers of a unit in one
_ANGLES = ("phase",)  # parameters in rad that are no position of the axis


def quantity(value: float, unit: str, found: DiagnosisResult) -> str:
    """A gap, a length or a current: ``2.94 µm``, ``31.0 mA``; angles of an axis with a lead as its travel."""
    if not math.isfinite(value):
        return "not known"
    if unit == "rad":
        value, unit = value * found.travel_per_unit, found.travel_unit
    if abs(value) < _SMALL:
        return f"0 {unit}"
    return length(value, unit)


def together(values: Sequence[float], unit: str, found: DiagnosisResult) -> tuple[list[str], str]:
    """Numbers of one kind to two digits, all in the prefix that fits the largest, and their unit."""
    per, name = (found.travel_per_unit, found.travel_unit) if unit == "rad" else (1.0, unit)
    largest = max((abs(one) * per for one in values if math.isfinite(one)), default=0.0)
    prefix, scale = next(((p, k) for p, k in _PREFIXES if largest * k >= 0.9995), _PREFIXES[-1])
    if largest < _SMALL:
        prefix, scale = _PREFIXES[0]
    return [_two_digits(one * per * scale) for one in values], f"{prefix}{name}"


def _two_digits(value: float) -> str:
    """``2.9``, ``0.34``, ``230``."""
    if not math.isfinite(value):
        return "not known"
    places = 1 - math.floor(math.log10(abs(value))) if abs(value) > 1e-9 else 0
    return f"{value:.{min(max(places, 0), 6)}f}"


def percent(share: float) -> str:
    """``82 %``; below one per cent with a digit, and never ``-0 %``."""
    if not math.isfinite(share):
        return "not known"
    value = 100.0 * share
    if abs(value) < 0.05:
        return "0 %"
    return f"{value:.1f} %" if abs(value) < 1.0 else f"{value:.0f} %"


def parameter(name: str, one: Value, found: DiagnosisResult) -> str:
    """``0.182 (0.171 to 0.193)`` with its unit; times and lengths in the prefix that fits."""
    number, unit = _scaled(name, one, found)
    low, high = number(one.low), number(one.high)
    if not (math.isfinite(one.low) and math.isfinite(one.high)):
        return f"{number(one.value)} {unit}".rstrip()
    return f"{number(one.value)} {unit}".rstrip() + f" ({low} to {high})"


def value(name: str, one: Value, found: DiagnosisResult) -> str:
    """The value alone to three digits, with its unit: ``0.182``, ``14 µm``."""
    scale, unit = _unit(name, one, found)
    return f"{one.value / scale:.3g} {unit}".rstrip()


class _Number(NamedTuple):
    """How the numbers of one parameter are written: all in one unit, to one decimal place."""

    scale: float  # SI size of the unit
    places: int

    def __call__(self, value: float) -> str:
        scaled = value / self.scale
        return f"{scaled:.{self.places}f}" if math.isfinite(scaled) and self.places < _FREE else f"{scaled:.4g}"


def _scaled(name: str, one: Value, found: DiagnosisResult) -> tuple[_Number, str]:
    """How numbers of this parameter are written, and in which unit."""
    scale, unit = _unit(name, one, found)
    return _Number(scale, _decimals(one, scale)), unit


def _decimals(one: Value, scale: float) -> int:
    """Decimal places: two digits of the half width of the interval; as many as needed where there is none."""
    half = 0.5 * (one.high - one.low) / scale
    return max(0, 1 - math.floor(math.log10(half))) if math.isfinite(half) and half > 0.0 else _FREE


def _unit(name: str, one: Value, found: DiagnosisResult) -> tuple[float, str]:
    """SI size of the unit that a parameter is shown in, and its name."""
    unit, per = one.unit, 1.0
    if unit.split("/")[0] == "rad" and found.travel_unit == "m" and found.kind == "rotary" and name not in _ANGLES:
        unit, per = unit.replace("rad", "m", 1), found.travel_per_unit
    if unit not in ("m", "s", "A", "m/s", "rad") or name in _ANGLES or one.value == 0.0:
        return 1.0 / per, unit
    text = duration(abs(one.value)) if unit == "s" else length(abs(one.value) * per, unit)
    shown = text.partition(" ")[2]
    return {"m": 1e-3, "µ": 1e-6, "n": 1e-9}.get(shown.removesuffix(unit), 1.0) / per, shown
