"""Style of all figures, units of their axes, and the figure of a motion with and without friction compensation."""

import base64
import contextlib
import io
from collections.abc import Iterator
from typing import Any, NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stagectl.config.stage_blocks import Axis as StageAxis
from stagectl.number_format import prefix
from stagectl.units import unit_on

TARGET, WITHOUT, WITH = "#334155", "#d97706", "#0f766e"  # reference, without and with compensation
FAINT = "#94a3b8"  # zero lines, measured points in the background
STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e2e8f0",
    "axes.edgecolor": FAINT,
    "axes.labelcolor": "#334155",
    "xtick.color": "#475569",
    "ytick.color": "#475569",
    "legend.frameon": False,
    "legend.labelcolor": "#334155",
}


@contextlib.contextmanager
def drawing(rows: int = 1, columns: int = 1, top: float = 1.0, **options: Any) -> Iterator[tuple[Figure, Any]]:
    """A figure in the style of the house, and its axes; laid out below `top` of its height once they are drawn."""
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(rows, columns, **options)
        yield figure, axes
        figure.align_ylabels()
        figure.tight_layout(rect=(0.0, 0.0, 1.0, top))


Point = tuple[float, float]


def note(axes: Axes, words: str, place: Point, offset: Point, colour: str = WITHOUT, align: str = "baseline") -> None:
    """`words` next to a `place` of the data, by an `offset` in points."""
    axes.annotate(words, place, xytext=offset, textcoords="offset points", va=align, fontsize=8, color=colour)


def across_rows(axes: Axes) -> None:
    """Lines of the grid along x only, and behind the bars, of which each is a row."""
    axes.grid(visible=False, axis="y")
    axes.set_axisbelow(True)


def effort_unit(kind: str) -> str:
    """N on a linear axis, N m on a rotary one."""
    return unit_on(kind, "N m | N")


def displacement_unit(axis: StageAxis) -> tuple[float, str]:
    """Factor from rad | m, and unit, in which a displacement after a reversal is drawn."""
    return (1e6 * axis.travel_per_unit, "µm") if axis.travel_unit == "m" else (1e3, "mrad")


class Scale(NamedTuple):
    """A factor, and the unit that a number has after it."""

    factor: float
    unit: str


def prefixed(values: Any, unit: str, per: float = 1.0) -> Scale:
    """The prefix in which the largest of `values` reads well; one of them is `per` of that `unit`."""
    letter, factor = prefix(per * float(np.nanmax(np.abs(values), initial=0.0)))
    return Scale(per * factor, f"{letter}{unit}")


def legend_of_each(axes: Axes, **options: Any) -> None:
    """A legend with each name once."""
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    axes.legend(list(once.values()), list(once), **options)


def plain_decades(axis: Axis) -> None:
    """A logarithmic axis with plain numbers, three a decade at most."""
    axis.set_major_locator(mpl.ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(mpl.ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(mpl.ticker.NullFormatter())


def weights(axes: Axes, weight: NDArray[np.float64], slip: NDArray[np.float64], units: tuple[float, str, str]) -> None:
    """Stop operators as bars: `weight` (j,) over `slip` (j,); `units` are a slip's factor and unit, and the force's."""
    scale, unit, force = units
    axes.vlines(scale * slip, 0.0, weight, color=WITH, linewidth=3.0)
    axes.set_xscale("log")
    plain_decades(axes.xaxis)
    axes.set(
        ylim=(0.0, 1.1 * float(np.max(weight, initial=1e-12))),
        xlabel=f"slip of the element [{unit}]",
        ylabel=f"weight [{force}]",
    )


class Pair(NamedTuple):
    """The same motion twice: structured rows without and with friction compensation, and what they share."""

    title: str
    without: NDArray[Any]
    compensated: NDArray[Any]
    travel_per_unit: float  # m per rad, or 1
    steady: tuple[float, float]  # s


def motion(pairs: list[Pair]) -> Figure:
    """One column a motion; rows: target, error without compensation, error with it, control input."""
    with drawing(4, len(pairs), figsize=(3.6 * len(pairs) + 0.4, 8.2), squeeze=False, sharex="col") as (figure, grid):
        for column, pair in zip(grid.T, pairs, strict=True):
            _column(column, pair)
        for row in grid[:, 1:].flat:
            row.set_ylabel("")
    return figure


def _column(axes: NDArray[Any], pair: Pair) -> None:
    target, bare, compensated, current = axes
    target.set_title(pair.title, loc="left", fontweight="bold", color=TARGET)
    _line(target, pair.without, pair.without["reference"] * pair.travel_per_unit * 1e3, TARGET)
    target.set_ylabel("target [mm]")
    _line(bare, pair.without, _error(pair.without, pair) * 1e6, WITHOUT, "without compensation")
    _line(bare, pair.compensated, _error(pair.compensated, pair) * 1e6, WITH, "with compensation")
    bare.set_ylabel("tracking error [µm]")
    bare.legend(loc="upper center", fontsize=8, ncols=2, columnspacing=1.0, handlelength=1.2)
    _room(bare, _error(pair.without, pair) * 1e6, 1.5)
    _line(compensated, pair.compensated, _error(pair.compensated, pair) * 1e9, WITH)
    inside = (pair.compensated["time"] >= pair.steady[0]) & (pair.compensated["time"] < pair.steady[1])
    _room(compensated, _error(pair.compensated, pair)[inside] * 1e9, 2.5)
    compensated.set_ylabel("error with\ncompensation [nm]")
    _line(current, pair.without, pair.without["current"], WITHOUT, "without compensation")
    _line(current, pair.compensated, pair.compensated["current"], WITH, "with compensation")
    current.set(ylabel="current [A]", xlabel="time [s]")
    for axis in axes:
        axis.axvspan(*pair.steady, color="#f1f5f9", zorder=-1)


def _line(axes: Axes, samples: NDArray[Any], values: NDArray[np.float64], colour: str, label: str = "") -> None:
    axes.plot(samples["time"], values, color=colour, linewidth=0.9, label=label)


def _room(axes: Axes, values: NDArray[np.float64], factor: float) -> None:
    """Limits symmetric about zero, with `factor` times the room that `values` need."""
    largest = factor * float(np.max(np.abs(values), initial=1e-3))
    axes.set_ylim(-largest, largest)


def _error(samples: NDArray[Any], pair: Pair) -> NDArray[np.float64]:
    error: NDArray[np.float64] = (samples["reference"] - samples["measured"]) * pair.travel_per_unit
    return error


def detached(figure: Figure) -> Figure:
    """The figure by itself: pyplot neither shows it a second time in a notebook nor keeps it in memory."""
    plt.close(figure)
    return figure


def embedded(figure: Figure, dpi: int = 170) -> str:
    """The figure as the ``src`` of an image in a page; closes it."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    plt.close(figure)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
