"""The figures of a diagnosis: coordinates, spans of time, shares, and a held-out run before and after."""

import math
from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stagectl.gap.effects.library import coordinate_label, label
from stagectl.gap.result.diagnosis import FORM, NOISE, UNEXPLAINED, DiagnosisResult, Spans, Trace
from stagectl.report.constants import FLAT, LABEL_CHARACTERS, LEAST_SHARE, MOST_ROWS, SHOWN_SHARE, WINDOW
from stagectl.report.figures import (
    TARGET,
    WITH,
    WITHOUT,
    Scale,
    across_rows,
    drawing,
    effort_unit,
    note,
    plain_decades,
    prefixed,
)
from stagectl.report.panels import DPI as DPI

Array = NDArray[np.float64]
WIDTH = 5.4  # inch: two fit side by side
_GREY, _PALE = "#94a3b8", "#e2e8f0"
_COLOURS = {"parameters": TARGET, FORM: TARGET, UNEXPLAINED: WITHOUT, NOISE: "#cbd5e1"}  # of shares; of an effect: WITH


def drawings(result: DiagnosisResult) -> dict[str, Callable[[], Figure]]:
    """What draws each figure that the diagnosis has something for, by its name."""
    run = largest_trace(result)
    known: dict[str, Callable[[], Figure] | None] = {
        "shares": (lambda: shares(result)) if result.shares else None,
        "coordinates": (lambda: coordinates(result)) if result.coordinates else None,
        "spans": (lambda: spans(result)) if result.captures else None,
        "run": None if run is None else lambda: trace(run, result),
    }
    return {name: draw for name, draw in known.items() if draw is not None}


def coordinates(result: DiagnosisResult) -> Figure:
    """How much of the gap a smooth function of each coordinate alone explains."""
    ranked = sorted(result.coordinates, key=lambda coordinate: coordinate.share)
    rows = [row for row in ranked if row.share >= LEAST_SHARE] or ranked[-1:]
    with drawing(figsize=(WIDTH, 0.9 + 0.32 * max(len(rows), 3))) as (figure, axes):
        shares = [100.0 * max(row.share, 0.0) for row in rows]
        axes.barh([coordinate_label(row.name) for row in rows], shares, color=TARGET, height=0.6)
        for place, share in enumerate(shares):
            axes.text(share + 1.5, place, f"{share:.0f} %", va="center", fontsize=8, color=TARGET)
        axes.set(
            xlim=(0.0, 112.0), ylim=(len(rows) - 0.5 - max(len(rows), 3), len(rows) - 0.5), xticks=[0, 25, 50, 75, 100]
        )
        across_rows(axes)
        axes.set_xlabel("share of the gap that follows it [%]")
    return figure


def most_open(result: DiagnosisResult) -> list[Spans]:
    """The captures that are drawn, in their order: all, or those whose gap is open longest."""
    if len(result.captures) <= MOST_ROWS:
        return list(result.captures)
    longest = sorted(result.captures, key=lambda capture: sum(b - a for a, b in capture.spans))[-MOST_ROWS:]
    return [capture for capture in result.captures if any(capture is kept for kept in longest)]


def spans(result: DiagnosisResult) -> Figure:
    """When the gap is open, a row a capture."""
    rows = most_open(result)
    with drawing(figsize=(WIDTH, 0.9 + 0.26 * max(len(rows), 4))) as (figure, axes):
        for place, capture in enumerate(reversed(rows)):
            end = max(capture.duration, *(last for _, last in capture.spans), 0.0)
            axes.barh(place, end, color=_PALE, height=0.55)
            axes.broken_barh([(a, b - a) for a, b in capture.spans], (place - 0.275, 0.55), color=WITHOUT)
        axes.set_ylim(-0.6, max(len(rows), 4) - 0.4)
        axes.set_yticks(range(len(rows)), [_short(capture.file) for capture in reversed(rows)], fontsize=8)
        across_rows(axes)
        axes.set_xlabel("time in the capture [s]")
    return figure


def _short(name: str) -> str:
    """A file's name without its ending, its middle left out where it is long."""
    stem = name.rsplit("/", 1)[-1].rsplit(".", 1)[0]
    half = LABEL_CHARACTERS // 2
    return stem if len(stem) <= LABEL_CHARACTERS else f"{stem[: half - 1]}…{stem[-half:]}"


def shares(result: DiagnosisResult) -> Figure:
    """The gap split into its parts, a step each; the steps end at 100 %."""
    parts = [(name, share) for name, share in result.shares if abs(share) >= SHOWN_SHARE]
    with drawing(figsize=(WIDTH, 0.9 + 0.36 * max(len(parts), 3))) as (figure, axes):
        begin = 0.0
        for place, (name, share) in enumerate(parts):
            axes.barh(-place, 100.0 * share, left=100.0 * begin, color=_COLOURS.get(name, WITH), height=0.62)
            right = 100.0 * max(begin, begin + share)
            note(axes, f"{100.0 * share:z.1f} %", (right, -place), (4, 0), TARGET, "center")
            begin += share
            if place + 1 < len(parts):
                axes.vlines(100.0 * begin, -place - 0.69, -place - 0.31, color=_GREY, linewidth=0.7)
        axes.set_yticks([-place for place in range(len(parts))], [_share_label(name) for name, _ in parts])
        lowest = 0.5 - max(len(parts), 3)
        axes.set(xlim=(min(0.0, axes.get_xlim()[0]), 114.0), ylim=(lowest, 0.5), xticks=[0, 25, 50, 75, 100])
        across_rows(axes)
        axes.set_xlabel("share of the squared gap [%]")
    return figure


def _share_label(name: str) -> str:
    if name == UNEXPLAINED:
        return name.replace(" but ", " but\n")
    text = name if name == NOISE else label(name)
    if len(text) <= LABEL_CHARACTERS:
        return text
    at = text.rfind(" ", 0, len(text) // 2 + 4)
    return f"{text[:at]}\n{text[at + 1 :]}"


def largest_trace(result: DiagnosisResult) -> Trace | None:
    """The held-out run with the largest gap before."""
    return max(result.traces, key=lambda run: float(np.nanmean(np.square(run.before))), default=None)


def window(run: Trace, length: float = WINDOW) -> slice:
    """The rows of the `length` seconds of a run with the largest gap before, that gap in their middle."""
    rows = int(np.searchsorted(run.time - run.time[0], length))
    if rows >= len(run.time):
        return slice(None)
    before = np.nan_to_num(run.before)  # rows that do not count are NaN
    energy = np.concatenate([[0.0], np.cumsum(np.square(before))])
    begin = int(np.argmax(energy[rows:] - energy[:-rows]))
    weight = np.square(before[begin : begin + rows])
    middle = begin + int(np.average(np.arange(rows), weights=weight + FLAT * np.max(weight) + 1e-300))
    begin = min(max(middle - rows // 2, 0), len(run.time) - rows)
    return slice(begin, begin + rows)


def trace(run: Trace, result: DiagnosisResult) -> Figure:
    """Reference, and the model minus the machine before and after, over the window of the largest gap."""
    part = window(run)
    travel = (result.travel_unit, result.travel_per_unit)
    where, size = prefixed(run.reference[part], *travel), prefixed(run.before[part], *travel)
    with drawing(2, 1, figsize=(8.6, 4.2), sharex=True, height_ratios=(1, 2.4)) as (figure, (above, below)):
        above.plot(run.time[part], where.factor * run.reference[part], color=TARGET, linewidth=1.2)
        above.set_ylabel(f"reference [{where.unit}]")
        below.plot(run.time[part], size.factor * run.before[part], color=WITHOUT, linewidth=1.0, label="before")
        below.plot(run.time[part], size.factor * run.after[part], color=WITH, linewidth=1.0, label="after")
        if math.isfinite(run.floor):
            floor = size.factor * run.floor
            below.axhspan(-floor, floor, color="#cbd5e1", alpha=0.7, zorder=-1, linewidth=0, label="noise floor (rms)")
        below.set(ylabel=f"model − machine [{size.unit}]", xlabel="time [s]")
        # In a row of its own above the curves, where it hides none of them.
        below.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, fontsize=8, borderaxespad=0.0)
    return figure


def unknown(result: DiagnosisResult) -> Figure:
    """The unexplained effort or current over its coordinate."""
    assert result.unknown is not None  # the page checks
    grid, force, drive = result.unknown.grid, result.unknown.force, result.unknown.block == "drive"
    across = coordinate_scale(result.unknown.coordinate, grid, result)
    up = prefixed(force, "A" if drive else effort_unit(result.kind))
    with drawing(figsize=(WIDTH, 3.3)) as (figure, axes):
        axes.axhline(0.0, color=_GREY, linewidth=0.8)
        if result.unknown.coordinate == "frequency":
            axes.set_xscale("log")
            plain_decades(axes.xaxis)
        axes.plot(across.factor * grid, up.factor * force, color=WITHOUT, linewidth=1.8)
        unit = f" [{across.unit}]" if across.unit else ""
        axes.set_xlabel(f"{coordinate_label(result.unknown.coordinate)}{unit}")
        axes.set_ylabel(f"unexplained {'current' if drive else 'effort'} [{up.unit}]")
    return figure


def coordinate_scale(name: str, values: Array, result: DiagnosisResult) -> Scale:
    """How a coordinate in axis units is drawn: as travel where there is one."""
    unit, per = result.travel_unit, result.travel_per_unit
    if name == "position_mod_pitch" and result.kind == "rotary":
        return Scale(180.0 / math.pi, "deg of the motor")
    if name == "current":
        return prefixed(values, "A")
    travel = {"speed": f"{unit}/s", "acceleration": f"{unit}/s²"}
    travel |= dict.fromkeys(("displacement_since_reversal", "position", "position_mod_pitch"), unit)
    if name in travel:
        return prefixed(values, travel[name], per)
    return Scale(1.0, {"time": "s", "frequency": "Hz"}.get(name, ""))
