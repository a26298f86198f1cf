"""Figures of the simultaneous identification: force over time, the loop that flattens, and the reversal.

The loops are the paper's Fig. 9: ``T_d = Kt i - J a - D w`` over the position, with nothing subtracted, with the
viscous friction right, and with both right; then only the rolling friction remains.
"""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.result import Characteristic, IdentificationResult
from stagectl.report import interactive
from stagectl.report.constants import FORCE_SHOWN, MOST_REVERSALS
from stagectl.report.figures import (
    FAINT,
    TARGET,
    WITH,
    WITHOUT,
    displacement_unit,
    drawing,
    effort_unit,
    embedded,
    weights,
)
from stagectl.report.page import Picture


class _Curves(NamedTuple):
    """Rows (n,) of the first capture, with units of the axis for the figures."""

    columns: dict[str, NDArray[np.float64]]
    inertia: float
    viscous: float
    scale: float  # µm a unit of position; mrad without a lead
    unit: str
    effort: str

    @property
    def kind(self) -> str:
        """What the effort is called."""
        return "force" if self.effort == "N" else "torque"


def pictures(result: IdentificationResult, file: StageFile) -> list[Picture]:
    """The figures of this method on an identification's page."""
    curves = _curves(result, file)
    drawn = [interactive.picture(force(curves), "Measured force, model force and residual of the first capture.")]
    flat = "Disturbance force over the position. Inertia and viscous friction are right where the loop lies flat."
    drawn.append(Picture(embedded(loops(curves)), flat))
    if result.table is not None:
        bent = "Rolling friction after a reversal, and its stop operators."
        drawn.append(Picture(embedded(reversal(result.table, curves)), bent))
    return drawn


def _curves(result: IdentificationResult, file: StageFile) -> _Curves:
    columns = {name: np.asarray(values, dtype=np.float64) for name, values in result.details["curves"].items()}
    inertia, viscous = (result.parameters[name].value for name in ("inertia", "viscous"))
    return _Curves(columns, inertia, viscous, *displacement_unit(file.axis), effort_unit(file.axis.kind))


def force(p: _Curves) -> Figure:
    """Measured and model force over time, and the residual below."""
    time = p.columns["time"]
    rows = time < time[0] + FORCE_SHOWN
    measured, residual = p.columns["force"][rows], p.columns["residual"][rows]
    with drawing(2, 1, figsize=(7.2, 4.4), sharex=True, height_ratios=(2, 1)) as (figure, (above, below)):
        above.plot(time[rows], measured, color=TARGET, linewidth=2.4, alpha=0.35, label="measured, Kt i")
        above.plot(time[rows], measured - residual, color=WITH, linewidth=1.0, label="model")
        above.plot(time[rows], p.columns["friction"][rows], color=WITHOUT, linewidth=1.0, label="its rolling friction")
        above.set_ylabel(f"{p.kind} [{p.effort}]")
        above.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        below.plot(time[rows], 1e3 * residual, color=TARGET, linewidth=0.7)
        below.set(ylabel=f"residual [m{p.effort}]", xlabel="time [s]")
    return figure


def loops(p: _Curves) -> Figure:
    """The paper's Fig. 9: the loop at J = D = 0, with D alone, and with both."""
    steps = ((0.0, 0.0, "J = D = 0"), (0.0, p.viscous, f"J = 0, D = {p.viscous:.3g}"), (p.inertia, p.viscous, ""))
    with drawing(1, 3, figsize=(9.6, 3.2), sharey=True) as (figure, axes):
        for axis, (inertia, viscous, title) in zip(axes, steps, strict=True):
            _loop(axis, p, inertia, viscous)
            axis.set_title(title or f"J = {inertia:.4g}, D = {viscous:.3g}", loc="left", color=TARGET)
        axes[0].set_ylabel(f"disturbance {p.kind} [{p.effort}]")
    return figure


def _loop(axis: Axes, p: _Curves, inertia: float, viscous: float) -> None:
    unit = {"µm": "mm", "mrad": "rad"}[p.unit]
    disturbance = p.columns["force"] - inertia * p.columns["acceleration"] - viscous * p.columns["velocity"]
    place = 1e-3 * p.scale * (p.columns["position"] - p.columns["position"][0])
    axis.plot(place, disturbance, color=WITH if inertia else WITHOUT, linewidth=0.6, alpha=0.8)
    axis.set_xlabel(f"position [{unit}]")


def reversal(table: Characteristic, p: _Curves) -> Figure:
    """Friction over the displacement since a reversal, with the motion's own reversals behind it."""
    end = float(table.displacement[-1])
    with drawing(1, 2, figsize=(7.6, 3.4), width_ratios=(3, 2)) as (figure, (curve, bars)):
        for place, value in reversals(p, end):
            curve.plot(p.scale * place, value, color=FAINT, linewidth=0.6, alpha=0.5)
        curve.plot([], [], color=FAINT, linewidth=0.8, label="Kt i - J a - D w after each reversal")
        curve.plot(p.scale * table.displacement, table.force, color=WITH, linewidth=1.6, label="stop operators")
        curve.set(xlabel=f"displacement since the reversal [{p.unit}]", ylabel=f"friction [{p.effort}]")
        curve.set_xlim(0.0, p.scale * end)
        curve.legend(loc="lower right", fontsize=8)
        weights(bars, table.weight, table.slip, (p.scale, p.unit, p.effort))
    return figure


def reversals(p: _Curves, end: float) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """(displacement, friction) after each reversal of the motion that comes from, and goes on to, beyond `end`."""
    position = p.columns["position"]
    friction = p.columns["force"] - p.inertia * p.columns["acceleration"] - p.viscous * p.columns["velocity"]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(position))) != 0.0) + 1
    strokes: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for turn, until in zip(turns, [*turns[1:], len(position)], strict=True):
        moved = position[turn:until] - position[turn]
        heading = float(np.sign(moved[-1]))
        if abs(float(moved[-1])) > end and len(strokes) < MOST_REVERSALS:
            near = np.abs(moved) <= 1.3 * end
            strokes.append((np.abs(moved[near]), heading * friction[turn:until][near]))
    return strokes
