"""Figures over time or frequency that a reader zooms: a matplotlib figure's curves, for the live page's plots.

The picture stays in the page for print, and where uPlot is not installed.
"""

import base64
import json
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation

from stagectl.report.figures import embedded
from stagectl.report.page import Picture

# What a figure is zoomed over, by the label of its x axis.
_OVER = ("time [", "time after ", "frequency [", "bandwidth [")


def picture(figure: Figure, caption: str, dpi: int = 170, least: int = 0) -> Picture:
    """The figure with its curves over time or frequency, if it has any; closes it."""
    panels = [_panel(axes) for axes in figure.axes if _label(axes).startswith(_OVER)]
    if panels and not panels[0]["title"]:
        panels[0]["title"] = figure.get_suptitle().replace("\n", " ")
    data = json.dumps(panels, allow_nan=False) if panels else ""
    return Picture(embedded(figure, dpi), caption, least, data)


def _label(axes: Axes) -> str:
    """Of the x axis, or of that of a panel below that shares it."""
    together = axes.get_shared_x_axes().get_siblings(axes)
    return next((label for other in together if (label := other.get_xlabel())), "")


def _panel(axes: Axes) -> dict[str, Any]:
    """What the page's script draws of one panel; numbers in the units of its labels."""
    spans = [part.get_bbox() for part in axes.patches if isinstance(part, Rectangle)]
    return {
        "x": _label(axes),
        "over_decades": axes.get_xscale() == "log",
        "y": axes.get_ylabel().replace("\n", " "),
        "title": axes.get_title(loc="left"),
        "logarithmic": axes.get_yscale() == "log",
        "xlim": _ends(axes),  # of the data: those of the axis leave out places without a value
        "ylim": list(axes.get_ylim()),
        "lines": [_line(line) for line in filter(_curve, axes.lines)],
        "marks": [*(_level(line, axes) for line in axes.lines if not _curve(line)), *_segments(axes)],
        "notes": [_note(text) for text in axes.texts if isinstance(text, Annotation)],
        "spans": [[span.x0, span.x1] for span in spans if (span.y0, span.y1) == (0.0, 1.0)],
        "bands": [[span.y0, span.y1] for span in spans if (span.x0, span.x1) == (0.0, 1.0)],
    }


def _curve(line: Line2D) -> bool:
    """Whether it is a curve: lines of two points mark a level or a place."""
    return np.size(line.get_xdata()) > 2


def _level(line: Line2D, axes: Axes) -> dict[str, Any]:
    """A line of two points, or a single one; an end at the edge of the panel is None."""
    way, x, y = line.get_transform(), _numbers(line.get_xdata()), _numbers(line.get_ydata())
    return {
        **_named(line),
        "x": [None, None] if way is axes.get_yaxis_transform(which="grid") else x,
        "y": [None, None] if way is axes.get_xaxis_transform(which="grid") else y,
    }


def _segments(axes: Axes) -> list[dict[str, Any]]:
    return [
        {"label": "", "colour": to_hex(colour), "dashed": False, "x": _numbers(x), "y": _numbers(y)}
        for lines in axes.collections
        if isinstance(lines, LineCollection)
        for colour in cast("Any", lines.get_colors())[:1]
        for x, y in (ends.T for ends in lines.get_segments())
    ]


def _note(text: Annotation) -> dict[str, Any]:
    """Words beside a place of the data; their offset in points."""
    x, y = _numbers(text.xy)
    offset, words = list(text.get_position()), text.get_text()
    return {"x": x, "y": y, "offset": offset, "words": words, "colour": to_hex(text.get_color())}


def _ends(axes: Axes) -> list[float]:
    """First and last x of the curves, with those of the panels that share the axis."""
    together = axes.get_shared_x_axes().get_siblings(axes)
    lines = [line for other in together for line in other.lines if _curve(line)]
    places = [np.asarray(line.get_xdata(), dtype=np.float64) for line in lines]
    every = np.concatenate(places) if places else np.array(axes.get_xlim())
    return [float(np.nanmin(every)), float(np.nanmax(every))]


def _named(line: Line2D) -> dict[str, Any]:
    label = str(line.get_label())
    shown = "" if label.startswith("_") else label
    return {"label": shown, "colour": to_hex(line.get_color()), "dashed": line.get_linestyle() == "--"}


def _line(line: Line2D) -> dict[str, Any]:
    return {
        **_named(line),
        "points": line.get_linestyle() == "None",
        "width": line.get_linewidth(),
        "x": _places(line.get_xdata()),
        "y": _packed(line.get_ydata(), "<f4"),
    }


def _places(values: Any) -> list[float] | str:
    """First, last and number where they are evenly spaced, as times are; else all of them."""
    x = np.asarray(values, dtype=np.float64)
    first, last, count = float(x[0]), float(x[-1]), len(x)
    even = np.allclose(x, np.linspace(first, last, count), rtol=0.0, atol=1e-6 * abs(last - first) / count)
    return [first, last, count] if even else _packed(x, "<f8")


def _packed(values: Any, kind: str) -> str:
    """For the script's `unpacked`: a sample costs a third of what it does in digits."""
    return base64.b64encode(np.asarray(values, dtype=kind).tobytes()).decode()


def _numbers(values: Any) -> list[float | None]:
    """Seven digits each; None where a curve is broken."""
    array = np.asarray(values, dtype=np.float64)
    return [float(f"{value:.7g}") if np.isfinite(value) else None for value in array]
