"""Panels: small figures of one pair of axes; a page sets them side by side, on a narrow screen below each other."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stagectl.report import interactive
from stagectl.report.figures import FAINT, STYLE, TARGET, drawing, note
from stagectl.report.page import Picture

CONVENTIONAL, TRUTH = "#2563eb", FAINT  # in addition to WITHOUT (no compensation) and WITH
SHADES = ("#fbbf24", "#f08c00", "#c2570c", "#7c2d12")  # of one quantity, from small to large
SIZE = (4.5, 3.2)  # inch
# Fixed, as a layout engine draws the figure twice.
MARGINS = {"left": 0.145, "right": 0.98, "bottom": 0.145, "top": 0.92}
DPI = 150


Place = Literal["best", "center", "upper center"]


class Line(NamedTuple):
    """A curve."""

    x: Any  # (n,)
    y: Any  # (n,)
    label: str = ""
    colour: str = TARGET
    style: str = "-"  # as matplotlib's format: "--", "o", ".-"
    width: float = 1.2


class Frame(NamedTuple):
    """Labels, limits and legend around the curves."""

    x: str  # label with unit
    y: str
    title: str = ""
    logarithmic: bool = False  # the x axis
    ylim: tuple[float, float] | None = None
    xlim: tuple[float, float] | None = None
    columns: int = 1  # of the legend
    legend: Place = "best"  # its place; "best" is slow with many points
    shaded: tuple[tuple[float, float], ...] = ()  # spans of x
    outside: tuple[str, tuple[float, float]] | None = None  # words on what lies outside, and where it leaves


def panel(lines: Sequence[Line], frame: Frame) -> Figure:
    """One pair of axes with these curves."""
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=SIZE, gridspec_kw=MARGINS)
        _drawn(axes, lines, frame)
    return figure


def stacked(panels: Sequence[tuple[Sequence[Line], Frame]]) -> Figure:
    """Panels below each other that share their x axis."""
    size = (7.0, 2.2 * len(panels))
    with drawing(len(panels), 1, figsize=size, sharex=True, squeeze=False) as (figure, grid):
        for axes, (lines, frame) in zip(grid[:, 0], panels, strict=True):
            _drawn(axes, lines, frame)
            axes.label_outer()
    return figure


def _drawn(axes: Axes, lines: Sequence[Line], frame: Frame) -> None:
    for line in lines:
        (drawn,) = axes.plot(line.x, line.y, line.style, color=line.colour, linewidth=line.width, markersize=3.5)
        if line.label:
            drawn.set_label(line.label)
    _around(axes, frame)
    if any(line.label for line in lines):
        axes.legend(loc=frame.legend, fontsize=7.5, ncols=frame.columns, columnspacing=1.0, handlelength=1.5)


def _around(axes: Axes, frame: Frame) -> None:
    axes.set(xlabel=frame.x, ylabel=frame.y)
    axes.set_title(frame.title, loc="left", fontsize=9, fontweight="bold", color=TARGET)
    if frame.logarithmic:
        axes.set_xscale("log")
    if frame.ylim is not None:
        axes.set_ylim(*frame.ylim)
    if frame.xlim is not None:
        axes.set_xlim(*frame.xlim)
    if frame.outside is not None:
        words, place = frame.outside
        note(axes, words, place, (6, 6 if place[1] < 0.0 else -10), TARGET)
    for span in frame.shaded:
        axes.axvspan(*span, color="#f1f5f9", zorder=-1)


def picture(lines: Sequence[Line], frame: Frame, caption: str) -> Picture:
    """The panel as a page's picture."""
    return interactive.picture(panel(lines, frame), caption, DPI)
