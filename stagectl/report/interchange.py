"""The page of a model exported to another simulator: the same commands there and here, and what it does not hold."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stagectl.config.stage_file import Setup
from stagectl.interchange.export import ExportedModel
from stagectl.interchange.round_trip import Array
from stagectl.recording.metadata import versions
from stagectl.report.figures import TARGET, WITH, WITHOUT, drawing, embedded
from stagectl.report.page import Page, Picture, Table

NOTHING = "nothing: all of the plant is in the model"
COLOURS = (WITHOUT, WITH)  # of the variants


def page(setup: Setup, exported: ExportedModel, command: str) -> Page:
    """The page; `command` repeats the export."""
    shown = "Positions under the same commands, and their differences below."
    return Page(
        f"stagectl export: {setup.file.name} in {exported.simulator.rstrip(',')}",
        answer(exported),
        [
            *exported.notes,
            "The commands are currents without feedback, in whole steps of the drive: a loop would hide differences.",
            "A percentage of the motion is the stricter figure: what friction changes of it is much larger.",
        ],
        [Picture(embedded(motions(setup, exported)), shown)] if exported.variants else [],
        [
            _table(setup, exported),
            Table("Not held", ["entry"], [[words] for words in exported.lost or [NOTHING]], (0,)),
        ],
        [command],
        versions(),
    )


def answer(exported: ExportedModel) -> str:
    """In one sentence."""
    if not exported.variants:
        return f"Written, and not run in {exported.simulator}."
    parts = (f"{name}: {_difference(*worst)}" for name, worst in exported.worst().items())
    return f"Positions in {exported.simulator} against ours, the worst of three motions. {'; '.join(parts)}."


def _difference(of_motion: float, of_friction: float) -> str:
    if of_motion == 0.0:
        return "the same to the last bit"
    return f"{_shown(of_motion)} % of the motion, {_shown(of_friction)} % of the friction's effect"


def _shown(share: float) -> str:
    """Two digits of a percentage, and never an exponent for a large one."""
    percent = 100.0 * share
    return f"{percent:.0f}" if percent >= 99.5 else f"{percent:.2g}"


def _table(setup: Setup, exported: ExportedModel) -> Table:
    unit = "µm" if setup.file.axis.travel_unit == "m" else "µrad"
    head = ["run", "motion", f"rms difference, {unit}", "of the friction's effect, %", "of the motion, %"]
    scale = 1e6 * setup.file.axis.travel_per_unit
    rows = [
        [name, motion.name, f"{scale * motion.difference:.3g}", *map(_shown, (motion.of_friction, motion.of_motion))]
        for name, each in exported.variants.items()
        for motion in each
    ]
    return Table("There against here", head, rows, (0, 1))


def motions(setup: Setup, exported: ExportedModel) -> Figure:
    """Each motion with its differences."""
    unit = "µm" if setup.file.axis.travel_unit == "m" else "µrad"
    scale = 1e6 * setup.file.axis.travel_per_unit
    first = next(iter(exported.variants.values()))
    with drawing(2, len(first), top=0.94, figsize=(11.0, 4.8), sharex=True) as (figure, axes):
        for column, motion in enumerate(first):
            upper, lower = axes[0][column], axes[1][column]
            upper.plot(motion.time, scale * motion.ours, color=TARGET, linewidth=2.4, label="stagectl")
            for (name, each), colour in zip(exported.variants.items(), COLOURS, strict=False):
                theirs, ours = scale * each[column].theirs, scale * each[column].ours
                upper.plot(motion.time, theirs, color=colour, linewidth=1.1, linestyle="--", label=name)
                _differences(lower, motion.time, theirs - ours, colour)
            upper.set_title(motion.name, fontsize=9)
            lower.set_xlabel("time in s")
        axes[0][0].set_ylabel(f"position in {unit}")
        axes[1][0].set_ylabel(f"|difference| in {unit}")
        figure.legend(*axes[0][0].get_legend_handles_labels(), fontsize=7, loc="upper right", ncols=3)
    return figure


def _differences(axes: Axes, time: Array, difference: Array, colour: str) -> None:
    """On a logarithmic axis, where there are any."""
    if difference.any():
        axes.semilogy(time, abs(difference), color=colour, linewidth=1.0)
    else:
        axes.plot(time, difference, color=colour, linewidth=1.0)
        axes.annotate("none", (0.5, 0.75), xycoords="axes fraction", ha="center", fontsize=8)
