"""Figures of the linear slider's friction paper: stroke end, standstill, release, compensation."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stagectl.compensation.legs import Array
from stagectl.report.figures import STYLE, TARGET, WITH, WITHOUT
from stagectl_studies.reproduction.reversal_error import ReversalError

NAMES = {
    "none": "no compensation",
    "symmetric": "conventional",
    "exponential": "proposed, first power",
    "gaussian": "proposed, second power",
    "displacement": "over displacement (ours)",
}
COLOURS = {
    "none": "#be123c",
    "symmetric": WITHOUT,
    "exponential": WITH,
    "gaussian": "#7c3aed",
    "displacement": "#2563eb",
}
SERIES = ("#0f766e", "#d97706", "#7c3aed", "#be123c")


class ShownRun(NamedTuple):
    """One recording, drawn around an instant."""

    label: str
    rows: NDArray[Any]
    instant: float  # s: the reversal, the stop or the release
    force_constant: float  # N/A


class Compensated(NamedTuple):
    """One recording of the compensation experiment; `form` names its colour."""

    form: str
    rows: NDArray[Any]
    errors: list[ReversalError]


def stroke_end(runs: Sequence[ShownRun], span: tuple[float, float], words: str = "reversal") -> Figure:
    """Velocities and output forces around each run's instant (the paper's Figs. 3 and 4); `span` in s from it."""
    with mpl.rc_context(STYLE):
        figure, (speed, force) = plt.subplots(2, 1, figsize=(7.2, 5.6), sharex=True)
        for colour, run in zip(SERIES, runs, strict=False):
            inside, t = _around(run, span)
            rows = run.rows[inside]
            speed.plot(t, 1e3 * rows["velocity"], color=TARGET, linewidth=0.8, linestyle="--")
            speed.plot(t, 1e3 * _velocity(run.rows)[inside], color=colour, linewidth=1.0, label=run.label)
            force.plot(t, run.force_constant * rows["measured_current"], color=colour, linewidth=1.0)
        speed.plot([], [], color=TARGET, linewidth=0.8, linestyle="--", label="reference")
        speed.set_ylabel("velocity [mm/s]")
        force.set_ylabel("output force [N]")
        force.set_xlabel(f"time from the {words} [ms]")
        force.set_xlim(1e3 * span[0], 1e3 * span[1])
        _legend_above(speed, len(runs) + 1)
        _finished(figure, (speed, force))
    return figure


def release(runs: Sequence[ShownRun], span: tuple[float, float] = (-0.02, 0.25)) -> Figure:
    """Position after the force has been set to zero (the paper's Fig. 5), from where the axis stood."""
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(len(runs), 1, figsize=(7.2, 1.7 * len(runs) + 0.9), sharex=True, squeeze=False)
        for axis, colour, run in zip(axes[:, 0], SERIES, runs, strict=False):
            inside, t = _around(run, span)
            start = run.rows["measured"][np.searchsorted(run.rows["time"], run.instant)]
            axis.plot(t, 1e6 * (run.rows["measured"][inside] - start), color=colour, linewidth=1.0)
            axis.set_title(run.label, loc="left", fontsize=9, color=TARGET)
            axis.axvline(0.0, color=TARGET, linewidth=0.8, linestyle=":")
            axis.set_ylabel("position [µm]")
        axes[-1, 0].set_xlabel("time from the release [ms]")
        axes[-1, 0].set_xlim(1e3 * span[0], 1e3 * span[1])
        _finished(figure, axes[:, 0])
    return figure


def compensation(runs: Sequence[Compensated], instant: float, span: tuple[float, float] = (-0.1, 0.15)) -> Figure:
    """Velocities and tracking errors around compensated reversal (the paper's Fig. 10); positive: excessively cut."""
    with mpl.rc_context(STYLE):
        figure, (speed, lead_axes) = plt.subplots(2, 1, figsize=(7.2, 6.2), sharex=True, height_ratios=(2, 3))
        for compensated in runs:
            run = ShownRun("", compensated.rows, instant, 1.0)
            inside, t = _around(run, span)
            nearest = min(compensated.errors, key=lambda error: abs(error.time - instant))
            rows = compensated.rows[inside]
            colour = COLOURS[compensated.form]
            speed.plot(t, 1e3 * _velocity(compensated.rows)[inside], color=colour, linewidth=0.9)
            lead = 1e6 * nearest.way * (rows["measured"] - rows["reference"])
            label = f"{NAMES[compensated.form]}: {1e6 * nearest.negative:+.1f} / {1e6 * nearest.positive:+.1f} µm"
            lead_axes.plot(t, lead, color=colour, linewidth=1.1, label=label)
        speed.plot(t, 1e3 * rows["velocity"], color=TARGET, linewidth=0.9, linestyle=":", label="reference")
        speed.set_ylabel("velocity [mm/s]")
        speed.legend(loc="upper right", fontsize=8)
        lead_axes.set_ylabel("error, way (measured - reference) [µm]")
        lead_axes.axhline(0.0, color="#94a3b8", linewidth=0.6)
        lead_axes.set_xlabel("time from the reversal [ms]")
        lead_axes.set_xlim(1e3 * span[0], 1e3 * span[1])
        lead_axes.legend(loc="upper right", fontsize=8)
        _finished(figure, (speed, lead_axes))
    return figure


def _around(run: ShownRun, span: tuple[float, float]) -> tuple[NDArray[np.bool_], Array]:
    """Rows within `span` (s) of the run's instant, and their time from it (ms)."""
    t = run.rows["time"] - run.instant
    inside = (t >= span[0]) & (t <= span[1])
    return inside, np.asarray(1e3 * t[inside], dtype=np.float64)


def _velocity(rows: NDArray[Any]) -> Array:
    """Velocity by central differences over a millisecond: less would show the encoder's steps."""
    dt = float(rows["time"][1] - rows["time"][0])
    wide = max(1, round(1e-3 / dt))
    x = np.pad(rows["measured"], wide, mode="edge")
    return np.asarray((x[2 * wide :] - x[: -2 * wide]) / (2 * wide * dt), dtype=np.float64)


def _legend_above(axis: Axes, columns: int) -> None:
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, fontsize=8)


def _finished(figure: Figure, axes: Any) -> None:
    figure.align_ylabels(list(axes))
    figure.tight_layout()
