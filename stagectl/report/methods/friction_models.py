"""Figures of the friction family: residual, errors in closed loop, and curve after a reversal of each model."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array
from stagectl.identification.friction.members import FAMILY, Path
from stagectl.identification.result import IdentificationResult
from stagectl.report.constants import REVERSAL_BEYOND, REVERSAL_POINTS
from stagectl.report.figures import (
    TARGET,
    WITH,
    WITHOUT,
    across_rows,
    displacement_unit,
    drawing,
    effort_unit,
    embedded,
)
from stagectl.report.page import Picture

BARS = (
    ("force_residual_percent", "all rows", TARGET),
    ("later_half", "later half, fitted to the earlier", WITH),
    ("fastest", "fastest rows, fitted to the slower", WITHOUT),
)
COLOURS = ("#334155", "#94a3b8", "#2563eb", "#7c3aed", "#0f766e", "#d97706", "#be123c")


def pictures(result: IdentificationResult, file: StageFile) -> list[Picture]:
    """The figures of this method on an identification's page."""
    rows = result.details["models"]
    drawn = [Picture(embedded(residuals(rows)), "Residual of each model, of rows it was fitted to and rows held out.")]
    if all("closed_loop" in row for row in rows):
        words = "The record's reference simulated in closed loop on each model."
        drawn.append(Picture(embedded(closed_loop(rows, result.details.get("published"))), words))
    return [*drawn, Picture(embedded(reversal(rows, file)), "Each model's friction after a full, slow reversal.")]


def residuals(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Residual (%) of the force: of all rows, and of those held out."""
    values = [{"force_residual_percent": row["force_residual_percent"], **row["held_out"]} for row in rows]
    with drawing(figsize=(5.6, 4.0), top=0.86) as (figure, axes):
        for number, (name, label, colour) in enumerate(BARS):
            places = np.arange(len(rows)) + 0.26 * (number - 1)
            axes.barh(places, [value[name] for value in values], 0.24, color=colour, label=label)
        _models(axes, rows)
        axes.set_xlabel("residual of the force [%]")
        figure.legend(*axes.get_legend_handles_labels(), loc="upper left", fontsize=7.5)
    return figure


def closed_loop(rows: Sequence[Mapping[str, Any]], published: Mapping[str, float] | None) -> Figure:
    """The four errors (%), with the published ones where there are any."""
    with drawing(2, 2, figsize=(5.6, 5.0), sharey=True, top=0.95 if published else 1.0) as (figure, grid):
        for axes, name in zip(grid.flat, ("position", "velocity", "acceleration", "force"), strict=True):
            axes.barh(np.arange(len(rows)), [row["closed_loop"][name] for row in rows], 0.6, color=WITH)
            axes.set_xlabel(f"{name} error [%]")
            axes.locator_params(axis="x", nbins=4)
            if published:
                axes.axvline(published[name], color=WITHOUT, linestyle="--", linewidth=1.2, label="published")
            across_rows(axes)
        _models(grid[0, 0], rows)
        grid[1, 0].tick_params(axis="y", labelsize=8)
        if published:
            figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="upper left", fontsize=7.5)
    return figure


def reversal(rows: Sequence[Mapping[str, Any]], file: StageFile) -> Figure:
    """Friction over the displacement since a full reversal."""
    scale, unit = displacement_unit(file.axis)
    longest = max([row["values"].get("range", 0.0) for row in rows if row["name"] in ("gms", "table")])
    s = REVERSAL_BEYOND * 2.0 * longest * np.linspace(0.0, 1.0, REVERSAL_POINTS)
    with drawing(figsize=(5.6, 4.0)) as (figure, axes):
        for row, colour in zip(rows, COLOURS, strict=True):
            axes.plot(scale * s, curve(row, s), color=colour, linewidth=1.3, label=row["words"])
        axes.set(xlabel=f"displacement since the reversal [{unit}]", ylabel=f"friction [{effort_unit(file.axis.kind)}]")
        axes.legend(loc="lower right", fontsize=7.5)
    return figure


def curve(row: Mapping[str, Any], displacement: Array) -> Array:
    """Force (n,) of a model at these displacements since a full reversal, at a speed that takes 10 s for them all."""
    member, values = FAMILY[row["name"]], list(row["values"].values())
    count, dt = len(member.linear), 10.0 / len(displacement)
    weights, theta = np.array(values[2 : 2 + count]), values[3 + count :]
    approach = -np.linspace(0.0, 20.0 * float(displacement[-1]), 20 * len(displacement))
    path = Path(np.concatenate([approach, approach[-1] + displacement[1:]]), dt)
    force = member.columns(path, theta) @ weights
    return np.asarray(force[len(approach) - 1 :])


def _models(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    axes.set_yticks(np.arange(len(rows)), [f"{row['words']} ({row['count']})" for row in rows], fontsize=8)
    axes.invert_yaxis()
    across_rows(axes)
