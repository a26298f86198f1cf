"""The figures of a diagnosis: coordinates, spans of time, shares, a held-out run before and after, signatures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stagectl.gap.effects import library
from stagectl.gap.result.diagnosis import NOISE, UNEXPLAINED, DiagnosisResult, FoundEffect, Spans, Trace
from stagectl.report.figures import STYLE, TARGET, WITH, WITHOUT
from stagectl.report.panels import DPI as DPI

Array = NDArray[np.float64]
WIDTH = 5.4  # inch: two stand side by side
MOST_ROWS = 24  # of the map of spans
MOST_POINTS = 3000  # of a cloud
WINDOW = 1.0  # s of a held-out run that are shown
_GREY, _PALE = "#94a3b8", "#e2e8f0"
_LONGEST = 30  # characters of a row's label
_BINS = 60
_FLAT = 1e-15


class _Scale(NamedTuple):
    """A factor, and the unit that a number has after it."""

    factor: float
    unit: str


def coordinates(found: DiagnosisResult) -> Figure:
    """How much of the gap a smooth function of each coordinate alone explains."""
    rows = sorted(found.coordinates, key=lambda one: one.share)
    with rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(WIDTH, 0.9 + 0.32 * max(len(rows), 3)))
        shares = [100.0 * max(one.share, 0.0) for one in rows]
        axes.barh([library.coordinate_label(one.name) for one in rows], shares, color=TARGET, height=0.6)
        for place, share in enumerate(shares):
            axes.text(share + 1.5, place, f"{share:.0f} %", va="center", fontsize=8, color=TARGET)
        axes.set_xlim(0.0, 112.0)
        axes.set_ylim(len(rows) - 0.5 - max(len(rows), 3), len(rows) - 0.5)
        axes.set_xticks([0, 25, 50, 75, 100])
        _rows(axes)
        axes.set_xlabel("share of the gap that follows it [%]")
        figure.tight_layout()
    return figure


def _rows(axes: Axes) -> None:
    """Lines of the grid across the rows only, and behind the bars."""
    axes.grid(visible=False, axis="y")
    axes.set_axisbelow(True)


def most_open(found: DiagnosisResult) -> list[Spans]:
    """The captures that are drawn, in their order: all, or those whose gap is open longest."""
    if len(found.captures) <= MOST_ROWS:
        return list(found.captures)
    longest = sorted(found.captures, key=_open)[-MOST_ROWS:]
    return [one for one in found.captures if any(one is kept for kept in longest)]


def _open(one: Spans) -> float:
    return sum(end - begin for begin, end in one.spans)


def spans(found: DiagnosisResult) -> Figure:
    """When the gap is open, a row a capture."""
    rows = most_open(found)
    with rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(WIDTH, 0.9 + 0.26 * max(len(rows), 4)))
        for place, one in enumerate(reversed(rows)):
            end = max(one.duration, *(last for _, last in one.spans), 0.0)
            axes.barh(place, end, color=_PALE, height=0.55)
            axes.broken_barh([(a, b - a) for a, b in one.spans], (place - 0.275, 0.55), color=WITHOUT)
        axes.set_ylim(-0.6, max(len(rows), 4) - 0.4)
        axes.set_yticks(range(len(rows)), [_short(one.file) for one in reversed(rows)], fontsize=8)
        _rows(axes)
        axes.set_xlabel("time in the capture [s]")
        figure.tight_layout()
    return figure


def _short(name: str) -> str:
    """A file's name without its ending, its middle left out where it is long."""
    stem = name.rsplit("/", 1)[-1].rsplit(".", 1)[0]
    half = _LONGEST // 2
    return stem if len(stem) <= _LONGEST else f"{stem[: half - 1]}…{stem[-half:]}"


def shares(found: DiagnosisResult) -> Figure:
    """The gap taken apart, a step a part; the steps end at 100 %."""
    with rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(WIDTH, 0.9 + 0.36 * max(len(found.shares), 3)))
        begin = 0.0
        for place, (name, share) in enumerate(found.shares):
            axes.barh(-place, 100.0 * share, left=100.0 * begin, color=_colour(name), height=0.62)
            right = 100.0 * max(begin, begin + share)
            _beside(axes, (right, -place), f"{100.0 * share:.1f} %")
            begin += share
            if place + 1 < len(found.shares):
                axes.vlines(100.0 * begin, -place - 0.69, -place - 0.31, color=_GREY, linewidth=0.7)
        axes.set_yticks(
            [-place for place in range(len(found.shares))], [_share_label(name) for name, _ in found.shares]
        )
        axes.set_xlim(min(0.0, axes.get_xlim()[0]), 114.0)
        axes.set_xticks([0, 25, 50, 75, 100])
        _rows(axes)
        axes.set_xlabel("share of the squared gap [%]")
        figure.tight_layout()
    return figure


def _beside(axes: Axes, place: tuple[float, float], text: str) -> None:
    axes.annotate(text, place, xytext=(4, 0), textcoords="offset points", va="center", fontsize=8, color=TARGET)


def _share_label(name: str) -> str:
    called = name if name in (UNEXPLAINED, NOISE) else library.label(name)
    return called.replace(" but ", " but\n") if called == UNEXPLAINED else _wrapped(called)


def _wrapped(text: str) -> str:
    if len(text) <= _LONGEST:
        return text
    at = text.rfind(" ", 0, len(text) // 2 + 4)
    return f"{text[:at]}\n{text[at + 1 :]}"


def _colour(name: str) -> str:
    return {"parameters": TARGET, UNEXPLAINED: WITHOUT, NOISE: "#cbd5e1"}.get(name, WITH)


def telling(found: DiagnosisResult) -> Trace | None:
    """The held-out run with the largest gap before."""
    return max(found.traces, key=lambda one: float(np.nanmean(np.square(one.before))), default=None)


def window(one: Trace, length: float = WINDOW) -> slice:
    """The rows of the `length` seconds of a trace in which the gap before is largest, that gap in their middle."""
    rows = int(np.searchsorted(one.time - one.time[0], length))
    if rows >= len(one.time):
        return slice(None)
    before = np.nan_to_num(one.before)  # rows that do not count are not drawn
    energy = np.concatenate([[0.0], np.cumsum(np.square(before))])
    begin = int(np.argmax(energy[rows:] - energy[:-rows]))
    weight = np.square(before[begin : begin + rows])
    middle = begin + int(np.average(np.arange(rows), weights=weight + _FLAT * np.max(weight) + 1e-300))
    begin = min(max(middle - rows // 2, 0), len(one.time) - rows)
    return slice(begin, begin + rows)


def trace(one: Trace, found: DiagnosisResult) -> Figure:
    """Reference, and the model minus the machine before and after, over the telling window."""
    part = window(one)
    per = _Scale(found.travel_per_unit, found.travel_unit)
    where, size = _prefixed(one.reference[part], per), _prefixed(one.before[part], per)
    with rc_context(STYLE):
        figure, (above, below) = plt.subplots(2, 1, figsize=(8.6, 4.2), sharex=True, height_ratios=(1, 2.4))
        above.plot(one.time[part], where.factor * one.reference[part], color=TARGET, linewidth=1.2)
        above.set_ylabel(f"reference [{where.unit}]")
        below.plot(one.time[part], size.factor * one.before[part], color=WITHOUT, linewidth=1.0, label="before")
        below.plot(one.time[part], size.factor * one.after[part], color=WITH, linewidth=1.0, label="after")
        if math.isfinite(one.floor):
            floor = size.factor * one.floor
            below.axhspan(-floor, floor, color="#cbd5e1", alpha=0.7, zorder=-1, linewidth=0, label="noise floor (rms)")
        below.set_ylabel(f"simulated − measured\nposition [{size.unit}]")
        below.set_xlabel("time [s]")
        _legend_above(below)
        figure.align_ylabels([above, below])
        figure.tight_layout()
    return figure


def _legend_above(axes: Axes) -> None:
    """In a row of its own above the curves, where it hides none of them."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, fontsize=8, borderaxespad=0.0)


def signature(one: FoundEffect, found: DiagnosisResult) -> Figure:
    """Residual over the coordinate that the effect lives in, and what the effect makes of it."""
    assert one.curve is not None  # asked by the page
    x, residual, model = one.curve
    across = coordinate_scale(one.coordinate, x, found)
    unit = one.curve_unit or effort(found)
    up = _prefixed(residual, _Scale(1.0, unit) if unit != "rad" else _Scale(found.travel_per_unit, found.travel_unit))
    kept = slice(None, None, max(1, len(x) // MOST_POINTS))
    with rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(WIDTH, 3.3))
        label = "residual before"
        axes.plot(across.factor * x[kept], up.factor * residual[kept], ".", color=_GREY, markersize=2.5, label=label)
        middle, mean = binned(x, model)
        axes.plot(across.factor * middle, up.factor * mean, color=WITH, linewidth=1.8, label=library.label(one.name))
        _frame(axes, one.coordinate, across, f"residual [{up.unit}]")
        _legend_above(axes)
        figure.tight_layout()
    return figure


def shape(found: DiagnosisResult) -> Figure:
    """The unknown as a function of its coordinate."""
    assert found.unknown is not None  # asked by the page
    grid, force, drive = found.unknown.grid, found.unknown.force, found.unknown.block == "drive"
    across = coordinate_scale(found.unknown.coordinate, grid, found)
    up = _prefixed(force, _Scale(1.0, "A" if drive else effort(found)))
    with rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(WIDTH, 3.3))
        axes.axhline(0.0, color=_GREY, linewidth=0.8)
        if found.unknown.coordinate == "frequency":
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter("{x:g}")
        axes.plot(across.factor * grid, up.factor * force, color=WITHOUT, linewidth=1.8)
        _frame(axes, found.unknown.coordinate, across, f"unknown {'current' if drive else 'force'} [{up.unit}]")
        figure.tight_layout()
    return figure


def _frame(axes: Axes, coordinate: str, across: _Scale, label: str) -> None:
    unit = f" [{across.unit}]" if across.unit else ""
    axes.set_xlabel(f"{library.coordinate_label(coordinate)}{unit}")
    axes.set_ylabel(label)


def binned(x: Array, y: Array, bins: int = _BINS) -> tuple[Array, Array]:
    """Means of `x` and `y` (n,) in bins of equally many points, empty ones left out."""
    order = np.argsort(x, kind="stable")
    groups = [part for part in np.array_split(order, min(bins, len(x))) if len(part)]
    return np.array([np.mean(x[part]) for part in groups]), np.array([np.mean(y[part]) for part in groups])


def effort(found: DiagnosisResult) -> str:
    """Unit of an effort on this axis."""
    return "N" if found.kind == "linear" else "N m"


def coordinate_scale(name: str, values: Array, found: DiagnosisResult) -> _Scale:
    """How a coordinate in axis units is drawn: as travel where there is one."""
    unit, per = found.travel_unit, found.travel_per_unit
    if name == "position_mod_pitch" and found.kind == "rotary":
        return _Scale(180.0 / math.pi, "deg of the motor")
    plain = {
        "speed": _Scale(per, f"{unit}/s"),
        "acceleration": _Scale(per, f"{unit}/s²"),
        "displacement_since_reversal": _Scale(per, unit),
        "position": _Scale(per, unit),
        "position_mod_pitch": _Scale(per, unit),
        "current": _Scale(1.0, "A"),
        "time": _Scale(1.0, "s"),
        "frequency": _Scale(1.0, "Hz"),
    }.get(name, _Scale(1.0, ""))
    return plain if name in ("time", "frequency") or not plain.unit else _prefixed(values, plain)


def _prefixed(values: Array | Sequence[float], plain: _Scale) -> _Scale:
    """With the prefix in which the largest of `values` reads well."""
    largest = plain.factor * float(np.nanmax(np.abs(values), initial=0.0))
    for power, prefix in ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n")):
        if largest * power >= 1.0 or largest < _FLAT:
            return _Scale(plain.factor * power, f"{prefix}{plain.unit}")
    return _Scale(plain.factor * 1e9, f"n{plain.unit}")
