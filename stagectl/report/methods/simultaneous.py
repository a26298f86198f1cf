"""Figures of the simultaneous identification: force over time, the loop that flattens, and the reversal.

The loops are the paper's Fig. 9: ``T_d = Kt i - J a - D w`` over the position, with nothing taken off, with the viscous
friction right, and with both right; what is left then is the rolling friction.
"""

from __future__ import annotations

from typing import NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stagectl.config.stage_file import StageFile
from stagectl.identification.capture import Capture
from stagectl.identification.result import Characteristic, IdentificationResult
from stagectl.report.figures import STYLE, TARGET, WITH, WITHOUT, embedded
from stagectl.report.page import Picture
from stagectl.units import LINEAR

SHOWN = 1.5  # s of force over time


class _Curves(NamedTuple):
    """Rows (n,) of the first capture, with what the figures need to know of the axis."""

    columns: dict[str, NDArray[np.float64]]
    inertia: float
    viscous: float
    scale: float  # µm a unit of position; mrad without a lead
    unit: str
    effort: str


def pictures(found: IdentificationResult, captures: list[Capture], file: StageFile) -> list[Picture]:
    """All figures of what was `found`, ready for a page."""
    curves = _curves(found, file)
    drawn = [
        Picture(embedded(force(curves)), "Measured force and the model's, and what is left, of the first capture."),
        Picture(
            embedded(loops(curves)),
            "The disturbance force over the position: inertia and viscous friction are right where the loop lies flat.",
        ),
    ]
    if found.table is not None:
        drawn.append(Picture(embedded(reversal(found.table, curves)), "The rolling friction after a reversal."))
    return drawn


def _curves(found: IdentificationResult, file: StageFile) -> _Curves:
    columns = {name: np.asarray(values, dtype=np.float64) for name, values in found.details["curves"].items()}
    inertia, viscous = (found.parameters[name].value for name in ("inertia", "viscous"))
    in_metres = file.axis.travel_unit == "m"
    scale = 1e6 * file.axis.travel_per_unit if in_metres else 1e3
    return _Curves(
        columns, inertia, viscous, scale, "µm" if in_metres else "mrad", "N" if file.axis.kind == LINEAR else "N m"
    )


def force(p: _Curves) -> Figure:
    """Measured and model force over time, and the residual below."""
    time = p.columns["time"]
    rows = time < time[0] + SHOWN
    measured, residual = p.columns["force"][rows], p.columns["residual"][rows]
    with mpl.rc_context(STYLE):
        figure, (above, below) = plt.subplots(2, 1, figsize=(7.2, 4.4), sharex=True, height_ratios=(2, 1))
        above.plot(time[rows], measured, color=TARGET, linewidth=2.4, alpha=0.35, label="measured, Kt i")
        above.plot(time[rows], measured - residual, color=WITH, linewidth=1.0, label="model")
        above.plot(time[rows], p.columns["friction"][rows], color=WITHOUT, linewidth=1.0, label="its rolling friction")
        above.set_ylabel(f"force [{p.effort}]" if p.effort == "N" else f"torque [{p.effort}]")
        above.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        below.plot(time[rows], 1e3 * residual, color=TARGET, linewidth=0.7)
        below.set_ylabel(f"residual [m{p.effort}]" if p.effort == "N" else "residual [mN m]")
        below.set_xlabel("time [s]")
        figure.align_ylabels([above, below])
        figure.tight_layout()
    return figure


def loops(p: _Curves) -> Figure:
    """The paper's Fig. 9: the loop at J = D = 0, with D alone, and with both."""
    steps = ((0.0, 0.0, "J = D = 0"), (0.0, p.viscous, f"J = 0, D = {p.viscous:.3g}"), (p.inertia, p.viscous, ""))
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(1, 3, figsize=(9.6, 3.2), sharey=True)
        for axis, (inertia, viscous, title) in zip(axes, steps, strict=True):
            _loop(axis, p, inertia, viscous)
            axis.set_title(title or f"J = {inertia:.4g}, D = {viscous:.3g}", loc="left", color=TARGET)
        axes[0].set_ylabel(f"disturbance force [{p.effort}]" if p.effort == "N" else f"disturbance torque [{p.effort}]")
        figure.tight_layout()
    return figure


def _loop(axis: Axes, p: _Curves, inertia: float, viscous: float) -> None:
    large, unit = (1e-3, "mm") if p.unit == "µm" else (1e-3, "rad")
    left = p.columns["force"] - inertia * p.columns["acceleration"] - viscous * p.columns["velocity"]
    place = large * p.scale * (p.columns["position"] - p.columns["position"][0])
    axis.plot(place, left, color=WITH if inertia else WITHOUT, linewidth=0.6, alpha=0.8)
    axis.set_xlabel(f"position [{unit}]")


def reversal(table: Characteristic, p: _Curves) -> Figure:
    """Friction over the displacement since a reversal, with the motion's own reversals behind it."""
    end = float(table.displacement[-1])
    with mpl.rc_context(STYLE):
        figure, (curve, bars) = plt.subplots(1, 2, figsize=(7.6, 3.4), width_ratios=(3, 2))
        for place, value in reversals(p, end):
            curve.plot(p.scale * place, value, color="#94a3b8", linewidth=0.6, alpha=0.5)
        curve.plot([], [], color="#94a3b8", linewidth=0.8, label="Kt i - J a - D w after each reversal")
        curve.plot(p.scale * table.displacement, table.force, color=WITH, linewidth=1.6, label="stop operators")
        curve.set_xlim(0.0, p.scale * end)
        curve.set_xlabel(f"displacement since the reversal [{p.unit}]")
        curve.set_ylabel(f"friction [{p.effort}]")
        curve.legend(loc="lower right", fontsize=8)
        bars.vlines(p.scale * table.slip, 0.0, table.weight, color=WITH, linewidth=3.0)
        bars.set_xscale("log")
        bars.set_ylim(0.0, 1.1 * float(np.max(table.weight, initial=1e-12)))
        bars.set_xlabel(f"slip of the element [{p.unit}]")
        bars.set_ylabel(f"weight [{p.effort}]")
        figure.tight_layout()
    return figure


def reversals(p: _Curves, end: float) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """(displacement, friction) after each reversal of the motion that comes from, and goes on to, beyond `end`."""
    position = p.columns["position"]
    friction = p.columns["force"] - p.inertia * p.columns["acceleration"] - p.viscous * p.columns["velocity"]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(position))) != 0.0) + 1
    found: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for turn, until in zip(turns, [*turns[1:], len(position)], strict=True):
        moved = position[turn:until] - position[turn]
        heading = float(np.sign(moved[-1]))
        if abs(float(moved[-1])) > end and len(found) < 40:
            near = np.abs(moved) <= 1.3 * end
            found.append((np.abs(moved[near]), heading * friction[turn:until][near]))
    return found
