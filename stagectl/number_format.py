"""Numbers as a person reads them."""

from __future__ import annotations


def length(value: float | None, unit: str) -> str:
    """A small travel in the prefix that fits: ``12.3 nm``, ``4.97 µm``, ``0.2 mm``."""
    if value is None:
        return "not reached"
    for scale, prefix in ((1.0, ""), (1e-3, "m"), (1e-6, "µ")):
        if abs(value) >= 0.9995 * scale:
            return f"{_digits(value / scale)} {prefix}{unit}"
    return f"{_digits(value / 1e-9)} n{unit}"


def _digits(value: float) -> str:
    """Three digits, zeros and all."""
    return f"{value:#.3g}".rstrip(".")


def duration(value: float) -> str:
    """A time in the prefix that fits: ``0.5 ms``, ``24.8 s``."""
    for scale, unit in ((1.0, "s"), (1e-3, "ms")):
        if abs(value) >= 0.09995 * scale or value == 0.0:
            return f"{value / scale:.3g} {unit}"
    return f"{value / 1e-6:.3g} µs"
