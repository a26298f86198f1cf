"""Figures of the zero-crossing identification: friction at a reversal and the fitted forms."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stagectl.config.stage_blocks import Axis as StageAxis
from stagectl.config.stage_blocks import StageFile
from stagectl.identification.result import IdentificationResult
from stagectl.report.constants import NEAR_REVERSAL
from stagectl.report.figures import FAINT, TARGET, WITH, WITHOUT, drawing, effort_unit, embedded
from stagectl.report.page import Picture

FORMS = {  # name and colour of those that are drawn
    "exponential": ("proposed (exponential)", WITH),
    "displacement": ("displacement", "#2563eb"),
    "symmetric": ("conventional (symmetric)", WITHOUT),
    "symmetric-free": ("conventional, Cs free", "#ca8a04"),
}
SLIDER = StageAxis("linear")


def pictures(result: IdentificationResult, file: StageFile) -> list[Picture]:
    """The figures of this method on an identification's page."""
    time = (
        "Friction at the first reversal, force minus M a and D v, and the fitted forms. After the crossing it assists "
        "the new motion until the rolling elements have reversed. The conventional curve jumps, or, with Cs free, "
        "dips where the friction is largest."
    )
    velocity = "The same over velocity: not symmetric about zero speed."
    return [
        Picture(embedded(forces_over(over, result.details, file.axis)), caption)
        for over, caption in (("time", time), ("velocity", velocity))
    ]


def forces_over(over: str, details: Mapping[str, Any], axis: StageAxis = SLIDER) -> Figure:
    """Friction at a reversal and the fitted forms over ``time`` (the paper's Fig. 8) or ``velocity`` (Fig. 9)."""
    curves = {name: np.asarray(values) for name, values in details["curves"].items()}
    near = np.abs(curves["time"]) <= NEAR_REVERSAL
    unit = effort_unit(axis.kind)
    x = 1e3 * curves[over][near] * (axis.travel_per_unit if over == "velocity" else 1.0)
    with drawing(figsize=(5.6, 4.4)) as (figure, axes):
        axes.plot(x, curves["friction"][near], color=TARGET, linewidth=2.2, alpha=0.55, label="measured: F - M a - D v")
        for form, (name, colour) in FORMS.items():
            line = "--" if form.endswith("-free") else "-"
            rms = float(np.sqrt(np.mean(np.square(curves["friction"] - curves[form]))))
            axes.plot(x, curves[form][near], line, color=colour, linewidth=1.1, label=f"{name}, rms {rms:.2g} {unit}")
        axes.axhline(0.0, color=FAINT, linewidth=0.6)
        axes.axvline(0.0, color=FAINT, linewidth=0.6)
        axes.set(
            xlabel={"time": "time from the zero crossing [ms]"}.get(over, f"velocity [m{axis.travel_unit}/s]"),
            ylabel=f"friction [{unit}]",
        )
        axes.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=2, fontsize=7.5, columnspacing=1.2)
    return figure
