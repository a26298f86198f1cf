"""A capture as lines of text: a lane for each channel, with its range and its unit."""

from __future__ import annotations

from typing import Any

from stagectl.number_format import duration, length
from stagectl.report.braille import bounds_of, curve

_MARGIN = 12  # characters left of the curve
_LANE = 6  # lines


def lines(capture: Any, names: list[str], about: dict[str, Any], width: int) -> list[str]:
    """The lanes, then the axis of time with the trigger at 0."""
    size = (max(width - _MARGIN - 1, 10), _LANE if len(names) <= 4 else 3)
    text = []
    for name, low, high in zip(names, capture.low, capture.high, strict=True):
        unit, bounds = about[name]["unit"], bounds_of(low.tolist(), high.tolist())
        text.append(f"{name} {_value(float(low.min()), unit)} to {_value(float(high.max()), unit)}")
        lane = curve(low.tolist(), high.tolist(), bounds, size)
        marks = [_value(bounds[1], unit), *[""] * (len(lane) - 2), _value(bounds[0], unit)]
        text += [f"{mark:>{_MARGIN - 1}} {line}" for mark, line in zip(marks, lane, strict=True)]
    return [*text, _times(capture, size[0])]


def _times(capture: Any, width: int) -> str:
    start, end = float(capture.time[0]), float(capture.time[-1]) + capture.step
    first, last = duration(start), duration(end)
    place = round(-start / (end - start) * width) if end > start else 0
    text = list(first + " " * (width - len(first) - len(last)) + last)
    mark = "^ trigger" if capture.triggered else ""
    if mark and len(first) < place < width - len(last) - len(mark):
        text[place : place + len(mark)] = list(mark)
    return " " * _MARGIN + "".join(text)


def _value(value: float, unit: str) -> str:
    if unit in ("m", "rad"):
        return length(value, unit) if value else f"0 {unit}"
    if unit in ("m/s", "rad/s"):
        return f"{length(value, unit[:-2])}/s" if value else f"0 {unit}"
    if unit == "s":
        return duration(value)
    return f"{value:.3g} {unit}".strip()
