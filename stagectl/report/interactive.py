"""Figures over time that a reader zooms: the curves of a matplotlib figure, for the live page's plots.

The picture stays in the page for print, and where uPlot is not installed.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from stagectl.report.figures import embedded
from stagectl.report.page import Picture


def picture(figure: Figure, caption: str, dpi: int = 170, least: int = 0) -> Picture:
    """The figure with its curves over time, if it has any; closes it."""
    panels = [_panel(axes) for axes in figure.axes if _over_time(axes)]
    data = json.dumps(panels, allow_nan=False) if panels else ""
    return Picture(embedded(figure, dpi), caption, least, data)


def _over_time(axes: Axes) -> bool:
    """Whether the x axis, or that of a panel below that shares it, is a linear one of time."""
    together = axes.get_shared_x_axes().get_siblings(axes)
    return axes.get_xscale() == "linear" and any(other.get_xlabel().startswith("time [") for other in together)


def _panel(axes: Axes) -> dict[str, Any]:
    """What the page's script draws of one panel; numbers in the units of its labels."""
    x = next(label for other in axes.get_shared_x_axes().get_siblings(axes) if (label := other.get_xlabel()))
    spans = [part.get_bbox() for part in axes.patches if isinstance(part, Rectangle)]
    return {
        "x": x,
        "y": axes.get_ylabel().replace("\n", " "),
        "title": axes.get_title(loc="left"),
        "logarithmic": axes.get_yscale() == "log",
        "xlim": _ends(axes),  # of the data: those of the axis leave out times without a value
        "ylim": list(axes.get_ylim()),
        "lines": [_line(line) for line in _curves(axes)],
        "spans": [[span.x0, span.x1] for span in spans if (span.y0, span.y1) == (0.0, 1.0)],
        "bands": [[span.y0, span.y1] for span in spans if (span.x0, span.x1) == (0.0, 1.0)],
    }


def _curves(axes: Axes) -> list[Line2D]:
    """The lines of a panel that are curves: those of two points mark a level or a time."""
    return [line for line in axes.lines if np.size(line.get_xdata()) > 2]


def _ends(axes: Axes) -> list[float]:
    """First and last time of the curves."""
    times = [np.asarray(line.get_xdata(), dtype=np.float64) for line in _curves(axes)]
    every = np.concatenate(times) if times else np.array(axes.get_xlim())
    return [float(np.nanmin(every)), float(np.nanmax(every))]


def _line(line: Line2D) -> dict[str, Any]:
    label = str(line.get_label())
    return {
        "label": "" if label.startswith("_") else label,
        "colour": to_hex(line.get_color()),
        "dashed": line.get_linestyle() == "--",
        "points": line.get_linestyle() == "None",
        "width": line.get_linewidth(),
        "x": _numbers(line.get_xdata()),
        "y": _numbers(line.get_ydata()),
    }


def _numbers(values: Any) -> list[float | None]:
    """Seven digits each; None where a curve is broken."""
    array = np.asarray(values, dtype=np.float64)
    return [float(f"{value:.7g}") if np.isfinite(value) else None for value in array]
