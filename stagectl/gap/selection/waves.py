"""Waves of the position that stand out of what surrounds them, however little they are of all that is missing.

An error in the form of the friction lies at the reversals and in the slow course of a stroke.  At a fine order of the
position there is next to none of it: a line there is judged by the spectrum beside it, and not by the whole.
"""

from typing import NamedTuple

import numpy as np

from stagectl.gap.residuals import pitch_orders
from stagectl.gap.residuals.pitch_orders import Lines
from stagectl.gap.selection import constants, refine
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.material import without
from stagectl.gap.selection.refine import Evidence, Fitted

SINGLE, MAP = constants.WAVES


class Wave(NamedTuple):
    """An effect of the model that stands by its line."""

    rest: Fitted  # the model without it, which has the line
    probability: float  # that the line is none of noise


def with_wave(e: Evidence, library: Library, now: Fitted) -> Fitted | None:
    """`now` with the wave at the highest line in what it lacks, and its multiples; None where none is high enough."""
    found = _lines(e, now)
    order = float(found.orders[np.argmax(found.height)])
    present = {valued.effect.name for valued in now.effects}
    if not _stands_out(found, order) or present & {*constants.WAVES}:
        return None
    wanted = MAP if any(_stands_out(found, multiple * order) for multiple in (2, 3, 4)) else SINGLE
    for form in library.forms:
        if form.effect.name == wanted and abs(form.shape["order"] - order) <= found.apart:
            after = refine.refine(e, now.model, [*now.effects, EffectValues(form.effect, form.values(form.typical))])
            return after if not _stands_out(_lines(e, after), order) else None
    return None


def wave(e: Evidence, now: Fitted, valued: EffectValues) -> Wave | None:
    """The effect `valued` of `now` as a wave; None where what is missing without it has no line at its order.

    The power of noise is distributed exponentially: half of it lies below its median.
    """
    if valued.effect.name not in constants.WAVES:
        return None
    rest, order = without(e, now, valued), valued.values["order"]
    found = _lines(e, rest)
    if not _stands_out(found, order):
        return None
    return Wave(rest, float(1.0 - len(found.orders) * 0.5 ** _height(found, order)))


def _lines(e: Evidence, now: Fitted) -> Lines:
    return pitch_orders.lines(now.equipped, e.runs, now.model.stage.mechanics.pitch)


def _stands_out(found: Lines, order: float) -> bool:
    return _height(found, order) >= constants.LINE


def _height(found: Lines, order: float) -> float:
    near = np.abs(found.orders - order) <= found.apart
    return float(found.height[near].max(initial=0.0))
