"""The page of a model exported to another simulator: the same commands there and here, and what it does not hold."""

import numpy as np
from matplotlib.figure import Figure

from stagectl.config.stage_file import Setup
from stagectl.interchange.export import ExportedModel
from stagectl.interchange.round_trip import Compared
from stagectl.report.figures import TARGET, WITH, WITHOUT, drawing
from stagectl.report.interactive import picture
from stagectl.report.page import Page, Picture, Table

NOTHING = "nothing: all of the plant is in the model"
COLOURS = (WITHOUT, WITH)  # of the variants
_NOTES = (
    "The commands are currents without feedback, in whole steps of the drive: a loop would hide differences.",
    "A percentage of the motion is the stricter figure: what friction changes of it is much larger.",
)


def page(setup: Setup, exported: ExportedModel, command: str) -> Page:
    """The page; `command` repeats the export."""
    return Page(
        f"stagectl export: {setup.file.name} in {exported.simulator.rstrip(',')}",
        answer(exported),
        [*exported.notes, *_NOTES],
        _pictures(setup, exported),
        [
            _table(setup, exported),
            Table("Not held", ["entry"], [[words] for words in exported.lost or [NOTHING]], (0,)),
        ],
        [command],
        narrow=True,
    )


def _pictures(setup: Setup, exported: ExportedModel) -> list[Picture]:
    """One of each motion."""
    scale, unit = _unit(setup)
    words = "position under the same commands, and the difference"
    return [
        picture(
            motion(dict(zip(exported.variants, each, strict=True)), scale, unit),
            f"{each[0].name.capitalize()}: {words}.",
        )
        for each in zip(*exported.variants.values(), strict=True)
    ]


def _unit(setup: Setup) -> tuple[float, str]:
    """Factor from rad | m, and unit of a position."""
    return 1e6 * setup.file.axis.travel_per_unit, "µm" if setup.file.axis.travel_unit == "m" else "µrad"


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
    scale, unit = _unit(setup)
    head = ["run", "motion", f"rms difference, {unit}", "of the friction's effect, %", "of the motion, %"]
    rows = [
        [name, motion.name, f"{scale * motion.difference:.3g}", *map(_shown, (motion.of_friction, motion.of_motion))]
        for name, each in exported.variants.items()
        for motion in each
    ]
    return Table("There against here", head, rows, (0, 1))


def motion(each: dict[str, Compared], scale: float, unit: str) -> Figure:
    """One motion, ours and that of each variant, with their differences."""
    ours = next(iter(each.values()))
    with drawing(2, 1, figsize=(4.5, 4.4), sharex=True) as (figure, (upper, lower)):
        upper.plot(ours.time, scale * ours.ours, color=TARGET, linewidth=2.4, label="stagectl")
        for (name, theirs), colour in zip(each.items(), COLOURS, strict=False):
            upper.plot(theirs.time, scale * theirs.theirs, color=colour, linewidth=1.1, linestyle="--", label=name)
            difference = scale * (theirs.theirs - theirs.ours)
            if difference.any():
                lower.set_yscale("log")
                difference = np.where(difference, abs(difference), np.nan)
            lower.plot(theirs.time, difference, color=colour, linewidth=1.0, label=name)
        upper.set_title(ours.name, loc="left", fontsize=9, fontweight="bold", color=TARGET)
        upper.set_ylabel(f"position [{unit}]")
        lower.set(xlabel="time [s]", ylabel=f"|difference| [{unit}]")
        upper.legend(fontsize=7, loc="lower left")
    return figure
