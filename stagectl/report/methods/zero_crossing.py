"""Figures of the linear slider's friction paper: stroke end, standstill, release, fitted forms, compensation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stagectl.compensation.legs import Array
from stagectl.compensation.reversal_error import ReversalError
from stagectl.config.stage_file import Axis as StageAxis
from stagectl.config.stage_file import StageFile
from stagectl.identification.capture import Capture
from stagectl.identification.result import IdentificationResult
from stagectl.report.figures import STYLE, TARGET, WITH, WITHOUT, embedded
from stagectl.report.page import Picture
from stagectl.units import LINEAR

SERIES = ("#0f766e", "#d97706", "#7c3aed", "#be123c")
NAMES = {
    "exponential": "proposed (exponential)",
    "gaussian": "gaussian",
    "displacement": "displacement",
    "symmetric": "conventional (symmetric)",
    "symmetric-free": "conventional, Cs free",
}
COLOURS = {
    "exponential": WITH,
    "gaussian": "#7c3aed",
    "displacement": "#2563eb",
    "symmetric": WITHOUT,
    "symmetric-free": "#ca8a04",
}
SHOWN = ("exponential", "displacement", "symmetric", "symmetric-free")
NEAR = 0.13  # s either side of a crossing
SLIDER = StageAxis("linear")


class Run(NamedTuple):
    """One recording, seen around an instant."""

    label: str
    rows: NDArray[Any]
    instant: float  # s: the reversal, the stop or the release
    force_constant: float  # N/A


class Compensated(NamedTuple):
    """One recording of the compensation experiment; `form` names its colour, empty without compensation."""

    form: str
    rows: NDArray[Any]
    errors: list[ReversalError]


def pictures(found: IdentificationResult, captures: list[Capture], file: StageFile) -> list[Picture]:
    """What an identification's page shows of this method."""
    time = (
        "Friction at the first reversal, force minus M a and D v, and the fitted forms. Behind the crossing it assists "
        "the new motion until the rolling elements have turned round; the conventional curve jumps, or, with Cs free, "
        "dips where the friction is largest."
    )
    velocity = "The same over velocity: not symmetric about zero speed."
    return [
        Picture(embedded(forces_over(over, found.details, file.axis)), caption)
        for over, caption in (("time", time), ("velocity", velocity))
    ]


def stroke_end(runs: Sequence[Run], span: tuple[float, float], words: str = "reversal") -> Figure:
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


def release(runs: Sequence[Run], span: tuple[float, float] = (-0.02, 0.25)) -> Figure:
    """Position after the force has been set to zero (the paper's Fig. 5), from where the axis stood."""
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(len(runs), 1, figsize=(7.2, 1.7 * len(runs) + 0.9), sharex=True, squeeze=False)
        for axis, colour, run in zip(axes[:, 0], SERIES, runs, strict=False):
            inside, t = _around(run, span)
            held = run.rows["measured"][np.searchsorted(run.rows["time"], run.instant)]
            axis.plot(t, 1e6 * (run.rows["measured"][inside] - held), color=colour, linewidth=1.0)
            axis.set_title(run.label, loc="left", fontsize=9, color=TARGET)
            axis.axvline(0.0, color=TARGET, linewidth=0.8, linestyle=":")
            axis.set_ylabel("position [µm]")
        axes[-1, 0].set_xlabel("time from the release [ms]")
        axes[-1, 0].set_xlim(1e3 * span[0], 1e3 * span[1])
        _finished(figure, axes[:, 0])
    return figure


def forces(details: Mapping[str, Any], axis: StageAxis = SLIDER, shown: Sequence[str] = SHOWN) -> Figure:
    """Friction seen at a reversal and the fitted forms, over time (the paper's Fig. 8) and velocity (Fig. 9)."""
    with mpl.rc_context(STYLE):
        figure, (left, right) = plt.subplots(1, 2, figsize=(10.4, 4.4), sharey=True, width_ratios=(3, 2))
        _forces(left, details, "time", axis, shown)
        _forces(right, details, "velocity", axis, shown)
        right.set_ylabel("")
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="upper center", ncols=3, fontsize=8)
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.9))
    return figure


def forces_over(over: str, details: Mapping[str, Any], axis: StageAxis = SLIDER) -> Figure:
    """One half of `forces`, over ``time`` or ``velocity``: the width that a page gives to a figure."""
    with mpl.rc_context(STYLE):
        figure, part = plt.subplots(figsize=(5.6, 4.4))
        _forces(part, details, over, axis, SHOWN)
        part.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=2, fontsize=7.5, columnspacing=1.2)
        figure.tight_layout()
    return figure


def _forces(part: Axes, details: Mapping[str, Any], over: str, axis: StageAxis, shown: Sequence[str]) -> None:
    curves = {name: np.asarray(values) for name, values in details["curves"].items()}
    near = np.abs(curves["time"]) <= NEAR
    unit = "N" if axis.kind == LINEAR else "N m"
    x = 1e3 * curves[over][near] * (axis.travel_per_unit if over == "velocity" else 1.0)
    part.plot(x, curves["friction"][near], color=TARGET, linewidth=2.2, alpha=0.55, label="seen: F - M a - D v")
    for name in shown:
        line = "--" if name.endswith("-free") else "-"
        label = f"{NAMES[name]}, rms {_rms(curves, name):.2g} {unit}"
        part.plot(x, curves[name][near], line, color=COLOURS[name], linewidth=1.1, label=label)
    part.axhline(0.0, color="#94a3b8", linewidth=0.6)
    part.axvline(0.0, color="#94a3b8", linewidth=0.6)
    part.set_xlabel({"time": "time from the zero crossing [ms]"}.get(over, f"velocity [m{axis.travel_unit}/s]"))
    part.set_ylabel(f"friction [{unit}]")


def _rms(curves: Mapping[str, Array], name: str) -> float:
    return float(np.sqrt(np.mean(np.square(curves["friction"] - curves[name]))))


def compensation(runs: Sequence[Compensated], instant: float, span: tuple[float, float] = (-0.1, 0.15)) -> Figure:
    """Velocities and tracking errors around one reversal (the paper's Fig. 10); positive: excessively cut."""
    with mpl.rc_context(STYLE):
        figure, (speed, error) = plt.subplots(2, 1, figsize=(7.2, 6.2), sharex=True, height_ratios=(2, 3))
        for one in runs:
            run = Run("", one.rows, instant, 1.0)
            inside, t = _around(run, span)
            at = min(one.errors, key=lambda found: abs(found.time - instant))
            rows = one.rows[inside]
            colour, line = COLOURS.get(one.form, "#be123c"), "--" if one.form.endswith("-free") else "-"
            speed.plot(t, 1e3 * _velocity(one.rows)[inside], color=colour, linewidth=0.9, linestyle=line)
            lead = 1e6 * at.way * (rows["measured"] - rows["reference"])
            label = f"{NAMES.get(one.form, 'no compensation')}: {1e6 * at.negative:+.1f} / {1e6 * at.positive:+.1f} µm"
            error.plot(t, lead, color=colour, linewidth=1.1, linestyle=line, label=label)
        speed.plot(t, 1e3 * rows["velocity"], color=TARGET, linewidth=0.9, linestyle=":", label="reference")
        speed.set_ylabel("velocity [mm/s]")
        speed.legend(loc="upper right", fontsize=8)
        error.set_ylabel("error, way (measured - reference) [µm]")
        error.axhline(0.0, color="#94a3b8", linewidth=0.6)
        error.set_xlabel("time from the reversal [ms]")
        error.set_xlim(1e3 * span[0], 1e3 * span[1])
        error.legend(loc="lower left", fontsize=8)
        _finished(figure, (speed, error))
    return figure


def _around(run: Run, span: tuple[float, float]) -> tuple[NDArray[np.bool_], Array]:
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
