"""What machines with nothing but another law of friction give an effect, and how far beyond that a gain is.

A law that is off leaves much in one experiment and little in another.  A gain is therefore judged on all data and on
each experiment alone, and the clearest answer stands: an experiment that tells little takes nothing from the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.gram_matrices import Grams, first_hand
from stagectl.gap.selection import null_ensemble
from stagectl.gap.selection.candidates import Form
from stagectl.gap.selection.cross_validation import against, best_of, cut_of, cuts_of, free_of, score_of

BEYOND = 1.5  # of the largest gain in the null ensemble: as far again as half of it
SMALLEST = 60.0  # gain in sums of squares of unit noise: what noise alone gives the best of many forms
CERTAIN = 2.0  # times SMALLEST: what noise gives the best of many forms in the best of many experiments


class Threshold(NamedTuple):
    """What machines without an effect give one effect."""

    limit: float  # gain beyond which it counts as found
    share: float  # largest relative drop that it gives on both hands; well beyond it counts as found, too


class Clarity(NamedTuple):
    """How clear one effect is where it is clearest: on all data, or on one experiment alone."""

    doubt: float  # its limit over its gain
    share: float  # of what is left above the repeats' floor; 0 where noise or another law might give as much


def thresholds(g: Grams, nuisance: Sequence[int], forms: Sequence[Form]) -> dict[str, Threshold]:
    """The gains of every effect on every machine of the null ensemble, and the limit beyond them.

    The limit lies beyond the largest of them.
    """
    free, places = free_of(cuts_of(g), nuisance), [g.of(form.names) for form in forms]
    found: dict[str, list[tuple[float, float]]] = {}
    for member in g.of(null_ensemble.gains(g.names)):
        machine = against(free, member)
        each = [score_of(machine[cut_of(form, machine)], at, form) for form, at in zip(forms, places, strict=True)]
        for effect, score in best_of(each).items():
            found.setdefault(effect, []).append((max(score.gain, 1.0), score.worst))
    return {effect: _threshold(np.array(gains)) for effect, gains in found.items()}


def _threshold(found: Array) -> Threshold:
    gain, share = found.max(axis=0)
    return Threshold(limit(float(gain)), float(share))


def limit(largest: float) -> float:
    """Gain beyond which an effect counts as found, where the null ensemble gives it `largest`."""
    return max(BEYOND * largest, SMALLEST)


def clarity(g: Grams, nuisance: Sequence[int], forms: Sequence[Form]) -> Clarity:
    """How clear one effect is with the best of its `forms`, on all data and on each experiment alone.

    The residual of `g` lacks the effect.
    """
    members, own = g.of(null_ensemble.gains(g.names)), [g.of(form.names) for form in forms]
    places = [*nuisance, *members, *sorted({place for each in own for place in each}), len(g.names)]
    at = {place: k for k, place in enumerate(places)}
    small = np.stack([part[:, places][:, :, places] for part in (g.effort, g.current)])
    where, cut = [[at[place] for place in each] for each in own], cut_of(forms[0], small)

    def answer(counted: NDArray[np.bool_]) -> Clarity:
        first = first_hand(g.stroke)[counted]
        cuts = np.stack([[part[counted][hand].sum(axis=0) for hand in (first, ~first)] for part in small])
        free = free_of(cuts, range(len(nuisance)))[cut]
        machines = [free, *(against(free, at[member]) for member in members)]
        scores = [[score_of(each, here, form) for here, form in zip(where, forms, strict=True)] for each in machines]
        gains = [max(score.gain for score in each) for each in scores]
        left = max(scores[0][0].before - float(g.floor[counted, cut].sum()), gains[0])
        least = limit(max(gains[1:], default=0.0))
        sure = gains[0] > max(least, CERTAIN * SMALLEST)
        return Clarity(least / max(gains[0], 1e-300), gains[0] / left if sure else 0.0)

    alone = [g.experiment == one for one in np.unique(g.experiment)]
    each = [answer(counted) for counted in (np.ones(len(g.stroke), dtype=bool), *alone)]
    return Clarity(min(one.doubt for one in each), max(one.share for one in each))
