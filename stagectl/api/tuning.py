"""`tune`: gains from the model in the stage file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from stagectl.api.arguments import PathLike, quantity
from stagectl.api.checked import checked
from stagectl.api.result import ReportedResult, Sheet, drawn, gains_frame
from stagectl.api.stage import DesignedStage, StageLike, as_stage, check_same_kind, load_stage
from stagectl.config.patch import Change, write
from stagectl.extras import require
from stagectl.tuning import constants, families, sheet
from stagectl.tuning import search as tuning
from stagectl.units import Quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stagectl.report.page import Page

_BANDWIDTH = Quantity("Hz", "[-inf, inf]", "bandwidth; the search knows its range")
_MARGIN, _PEAK = Quantity("rad", "[0, 1.5]", "phase margin"), Quantity("", "(1, 100]", "peak of the sensitivity")
TuningFigure = Literal["bode", "sensitivities", "nyquist", "step", "stiffness", "bandwidths"]


@dataclass(frozen=True, repr=False, eq=False)
class TunedGains(ReportedResult):
    """A feedback that was designed for a stage; `with_margin`: its margin goes into the stage file, too."""

    stage: DesignedStage
    tuned: tuning.Tuned
    with_margin: bool = False

    @property
    def bandwidth(self) -> float:
        """Bandwidth (Hz); of a cascade that of its position loop."""
        return self.tuned.bandwidth

    @property
    def gains(self) -> dict[str, tuple[float, str]]:
        """Continuous gains by name: (value, unit)."""
        return sheet.named_gains(self.stage.setup, self.tuned.control)

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON values, SI."""
        return sheet.result(self.stage.setup, self.tuned)

    def to_frame(self) -> Any:
        """The gains, one a row."""
        return gains_frame(self.gains)

    def sheet(self) -> Sheet:
        """Gains, margins, closed loop, and what is to be known about them."""
        from stagectl.report.tables.tuning import tables

        setup = self.stage.setup
        return Sheet(setup.file.name, sheet.headline(self.tuned), tables(setup, self.tuned), sheet.notes(self.tuned))

    def plot(self, what: TuningFigure = "bode") -> Figure:
        """Bode plot, sensitivities, Nyquist plot, step, dynamic stiffness, or what other bandwidths would give.

        Raises ArgumentError for another name.
        """
        require("report", "plot")
        from stagectl.report.tuning import drawings

        return drawn(drawings(self.stage.setup, self.tuned), what)

    def page(self, command: str = "") -> Page:
        """The page with all figures."""
        from stagectl.report.tuning import page

        return page(self.stage.setup, self.tuned, command)

    @checked
    def apply(self, stage: StageLike | None = None) -> DesignedStage:
        """The stage with these gains, in memory.

        Raises DesignError where the loop would be refused, ArgumentError for a stage of another kind of axis.
        """
        target = self.stage if stage is None else as_stage(stage)
        check_same_kind(self.stage, target, "gains")
        return target.changed(self._changes(families.law_of(target.setup.file.control)))

    @checked
    def write(self, path: PathLike) -> list[Change]:
        """Write a copy of the stage file with these gains to `path`, or patch that file itself; comments stay.

        Raises ConfigError where another file is there, or the result would be refused.
        """
        return write(self.stage.path, Path(path), self._changes(families.law_of(self.stage.setup.file.control)))

    def _changes(self, before: str) -> Mapping[str, Any]:
        """What the stage file must hold, by dotted name (SI); another law than `before` replaces its whole block."""
        control, law = self.tuned.control, families.law_of(self.tuned.control)
        chosen: dict[str, Any] = sheet.entries(control)
        if law == before:
            changes = {f"control.{name}": value for name, value in chosen.items()}
            return changes | ({"control.margin": control.margin} if self.with_margin else {})
        kept = {name: getattr(control, name) for name in control._fields if name not in chosen}
        defaults = control._field_defaults
        stated = {name: value for name, value in kept.items() if name == "margin" or value != defaults.get(name)}
        return {"control": {"law": law, **chosen, **stated}}


@checked
def tune(
    stage: StageLike,
    bandwidth: float | str | None = None,
    margin: float | str | None = None,
    *,
    peak: float | str | None = None,
    law: Literal["pid", "cascade"] | None = None,
    own_ratios: bool = False,
    at_rest: bool = True,
) -> TunedGains:
    """Design the feedback from the stage's model, with its period and all its delays.

    `bandwidth` is in Hz; default: the highest that keeps the margins.  `margin` is the least phase margin in rad;
    default: that of the stage file.  `peak` is the largest peak of the sensitivity; default: 2, if no bandwidth is
    given. All three may be text with a unit: ``"30 deg"``.  `own_ratios` keeps the ratios of the stage's own cascade.
    `at_rest`: only designs with which the axis comes to rest where the model's friction holds it.

    Raises ArgumentError for a value out of range, TuningError where no design keeps the margins.
    """
    designed = stage if isinstance(stage, DesignedStage) else load_stage(stage, judged=False)
    hertz = quantity("bandwidth", bandwidth, _BANDWIDTH, "it such as 40Hz")
    least = quantity("margin", margin, _MARGIN, "it such as 30deg")
    largest = quantity("ms", peak, _PEAK, "it such as 2")
    if largest is None:
        largest = constants.SENSITIVITY_PEAK if hertz is None else math.inf
    control = designed.setup.file.control
    if least is not None:
        control = control._replace(margin=least)
    family = families.family(designed.setup.stage, control, law or families.law_of(control), own_ratios)
    demand = tuning.Demand(control.margin, largest, at_rest)
    return TunedGains(designed, tuning.tuned(family, demand, hertz), with_margin=least is not None)
