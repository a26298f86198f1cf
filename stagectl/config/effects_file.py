"""What a stage file says of effects beyond the plant's own fields, and which of them cannot be together."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, NamedTuple

from stagectl.kernels import effects, jit
from stagectl.units import Quantity

if TYPE_CHECKING:
    from stagectl.config.stage_file import StageFile


class Residual(NamedTuple):
    """A data-based effort that opposes the motor, over one coordinate: straight between its values, flat beyond."""

    coordinate: Annotated[effects.Coordinate, "what the table is entered with"]
    start: Annotated[float, Quantity("", "[-1e9, 1e9]", "coordinate of the first value, in its SI unit")]
    step: Annotated[float, Quantity("", "(0, 1e9]", "between values, in the coordinate's SI unit")]
    values: Annotated[tuple[float, ...], Quantity("N m | N", "[-1e6, 1e6]", "effort")]


def table_of(p: Residual | None) -> effects.Table:
    """The residual as the plant takes it."""
    if p is None:
        return effects.NO_TABLE
    return effects.Table(effects.COORDINATES.index(p.coordinate), p.start, p.step, jit.table(p.values))


def effects_that_cannot_be(file: StageFile) -> list[str]:
    """What the plant's delay line cannot hold, and a gap that nothing spans."""
    wrong, drive, t = [], file.drive, file.mechanics.transmission
    room = (7 - drive.delay_samples) * file.control.period
    if drive.dead_time > room:
        wrong.append(
            f"drive.dead_time = {drive.dead_time * 1e3:g} ms; must lie in [0, {room * 1e3:g}] ms: the plant's delay "
            f"line holds 7 control periods, drive.delay_samples takes {drive.delay_samples} of them"
        )
    if drive.telemetry.late > file.control.period:
        wrong.append(
            f"drive.telemetry.late = {drive.telemetry.late * 1e3:g} ms; must be at most control.period, "
            f"{file.control.period * 1e3:g} ms"
        )
    if drive.continuous_current < math.inf and drive.continuous_current >= drive.current_limit:
        wrong.append(
            f"drive.continuous_current = {drive.continuous_current:g} A; must be below drive.current_limit, "
            f"{drive.current_limit:g} A, to which it folds back"
        )
    if (t.load_share > 0.0 or t.backlash > 0.0) and not (t.load_share > 0.0 and t.resonance > 0.0):
        wrong.append(
            "mechanics.transmission needs load_share and resonance, both above 0: without them motor and load are one, "
            "and no gap opens between them"
        )
    return wrong
