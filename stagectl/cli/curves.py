"""A capture as lines of text: a lane for each channel, with its range and its unit.

A character of a curve has two columns and four rows of dots, which show the range of each column.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from stagectl.number_format import duration, length

_MARGIN = 12  # characters left of the curve
_LANE = 6  # lines
_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))  # Unicode braille: left and right column, from above
_BLANK = 0x2800


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


def curve(low: Sequence[float], high: Sequence[float], bounds: tuple[float, float], size: tuple[int, int]) -> list[str]:
    """Lines of characters, ``size`` = (characters, lines), with what lies between `low` and `high` (n,).

    Neighbours are joined, so that a steep flank is a line and not single dots.  NaN leaves its column empty.
    """
    width, height = size
    cells = [[_BLANK] * width for _ in range(height)]
    before: tuple[int, int] | None = None
    for column, (bottom, top) in enumerate(_columns(low, high, 2 * width)):
        if math.isnan(bottom) or math.isnan(top):
            before = None
            continue
        first, last = (_row(value, bounds, 4 * height) for value in (top, bottom))
        if before is not None:
            first, last = min(first, before[1]), max(last, before[0])
        before = _row(top, bounds, 4 * height), _row(bottom, bounds, 4 * height)
        for row in range(first, last + 1):
            cells[row // 4][column // 2] |= _DOTS[column % 2][row % 4]
    return ["".join(map(chr, line)) for line in cells]


def bounds_of(low: Sequence[float], high: Sequence[float]) -> tuple[float, float]:
    """Lowest and highest of all, never the same."""
    known = [value for value in (*low, *high) if not math.isnan(value)]
    bottom, top = (min(known), max(known)) if known else (0.0, 0.0)
    gap = 0.05 * (top - bottom) or max(abs(top) * 1e-3, 1e-12)
    return bottom - gap, top + gap


def _columns(low: Sequence[float], high: Sequence[float], count: int) -> list[tuple[float, float]]:
    """As many (lowest, highest) as there are columns; of each all that falls into it."""
    extremes = []
    for column in range(count):
        start = column * len(low) // count
        end = max((column + 1) * len(low) // count, start + 1)
        bottoms = [value for value in low[start:end] if not math.isnan(value)]
        tops = [value for value in high[start:end] if not math.isnan(value)]
        extremes.append((min(bottoms), max(tops)) if bottoms and tops else (math.nan, math.nan))
    return extremes


def _row(value: float, bounds: tuple[float, float], rows: int) -> int:
    """Row of dots from above."""
    share = (bounds[1] - value) / (bounds[1] - bounds[0])
    return min(max(int(share * rows), 0), rows - 1)
