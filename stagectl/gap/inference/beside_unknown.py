"""Names next to an unknown: what is like it in place may be no more than a part of it.

Where something is missing that no effect explains, the library does not hold all of the truth, and the effect that is
most like what is missing explains much of it.  Two causes over one coordinate are there as often as any second effect;
one cause, of which a stand-in leaves no more than the share that is seen, is there as often as that share is small; and
an effect whose form on this machine is not quite that of the library leaves a share that is exponentially distributed.
What an effect leaves over its own coordinate counts in the same way where it is too little for an unknown, if a
function orders it and no friction law does.  A wave stands by its line, whatever harmonics are left next to it.
"""

import math
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.effect import DRIVE
from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.inference import verdict
from stagectl.gap.inference.basis_functions import BasisColumns
from stagectl.gap.inference.thresholds import FORM_LEFT
from stagectl.gap.inference.unknown import Residual, error_of_form, kindred, unknown
from stagectl.gap.inference.unstructured_residual import BANDS
from stagectl.gap.result.diagnosis import NAMED, UnknownTerm
from stagectl.gap.selection import linearised, waves
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.constants import INCLUSION
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.material import without
from stagectl.gap.selection.refine import Evidence, Fitted


class BesideUnknown(NamedTuple):
    """A selection, what of it is named, and what no effect explains next to that."""

    selected: Selection
    named: Selection
    shape: UnknownTerm | None


def beside_unknown(e: Evidence, library: Library, selected: Selection, smooth: BasisColumns) -> BesideUnknown:
    """`selected` with its unknown, and with no effect more probable than that both are there.

    What is no longer named belongs to the unknown, which is looked for again without it.
    """
    named = verdict.only_named(e, selected)
    residual = Residual(e, named.fitted, smooth)
    shape = unknown(e, named, smooth, residual)
    left = shape or error_of_form(named.fitted, residual)
    if left is None:
        return BesideUnknown(selected, named, None)
    probability = dict(selected.probability)
    by_form = (valued for valued in named.fitted.effects if not waves.stands(e, named.fitted, valued))
    for valued in (valued for valued in by_form if of_kin(valued.effect.name, left)):
        there = there_beside(e, library, named.fitted, valued, left)
        probability[valued.effect.name] = min(probability[valued.effect.name], there)
    less = selected._replace(probability=probability)
    if all(probability[valued.effect.name] >= NAMED for valued in named.fitted.effects):
        return BesideUnknown(less, named, shape)
    return beside_unknown(e, library, less, smooth)


def there_beside(e: Evidence, library: Library, now: Fitted, valued: EffectValues, shape: UnknownTerm) -> float:
    """Probability that an effect of `now` is there beside the unknown `shape`.

    What a function of the coordinate does not take in the place of the effect is an effect of its own.
    """
    rest, cut = without(e, now, valued), int(shape.block == DRIVE)
    left = linearised.excess(e, library, now)[cut]
    explained = linearised.excess(e, library, rest)[cut] - left
    taken = library.predict(e, rest).cuts[cut] - library.predict(e, now).cuts[cut]
    return 1.0 - float(np.clip(taken / max(explained, 1e-300), 0.0, 1.0)) * (1.0 - stands(explained, left))


def stands(explained: float, left: float) -> float:
    """Probability that an effect which has `explained` so much is there, beside what is `left` (sums of squares)."""
    explained, left = max(explained, 0.0), max(left, 0.0)
    if left == 0.0:
        return 1.0
    share = left / (left + explained)
    there = INCLUSION + math.exp(-share / FORM_LEFT)
    return there / (there + share)


def of_kin(name: str, shape: UnknownTerm) -> bool:
    """Whether the residual of the effect `name` may be ordered by the coordinate of the unknown `shape`.

    A band of frequency is none: impacts and resonances of every form leave something in it.
    """
    if shape.block == DRIVE:
        return EFFECTS[name].block == DRIVE
    if shape.coordinate == BANDS:
        return False
    return EFFECTS[name].block != DRIVE and not kindred(shape.coordinate).isdisjoint(EFFECTS[name].seen_over)
