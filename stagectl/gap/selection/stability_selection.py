"""How often an effect would have been found again: one experiment left out, the half strokes of the rest resampled.

An effect that one experiment alone carries, or a few half strokes, is a property of these and not of the machine: but
where the others do not excite it at all, as a limit that is reached in one motion, they tell nothing of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.gram_matrices import Grams, first_hand
from stagectl.gap.selection.candidates import Form
from stagectl.gap.selection.cross_validation import cut_of, scores

SEEN = 0.2  # of an effect's column, below which a resample does not excite it


def inclusion(g: Grams, nuisance: Sequence[int], forms: Sequence[Form], share: float, times: int) -> float:
    """Share of the resamples in which a form of one effect takes more than `share` of what the nuisances leave.

    `times` resamples for each experiment that is left out; the residual of `g` lacks the effect.
    """
    places = [*nuisance, *sorted({place for form in forms for place in g.of(form.names)}), len(g.names)]
    small = np.stack([cut[:, places][:, :, places] for cut in (g.effort, g.current)])
    cut = cut_of(forms[0], small)
    at = {place: k for k, place in enumerate(places)}
    own = [[at[place] for place in g.of(form.names)] for form in forms]
    first, source = first_hand(g.stroke), np.random.default_rng(0)
    energy = [small[cut][:, k, k] for k in {place for chosen in own for place in chosen}]
    found = []
    drawn = np.array(_resampled(g, times, source))
    dealt = np.tensordot(np.stack([drawn * first, drawn * ~first], axis=1), small, (2, 1))  # (r, 2 hands, 2 cuts, ...)
    for weight, hands in zip(drawn, dealt, strict=True):
        if not any(weight @ one > SEEN * one.sum() for one in energy):
            continue
        both = np.swapaxes(hands, 0, 1)
        best = max(scores(both, range(len(nuisance)), own, forms), key=lambda score: score.gain)
        # Without the effect the base stands where it does beside it: what it would take back is not left.
        found.append(best.gain > share * (best.before - float(weight @ g.floor[:, cut])))
    return float(np.mean(found)) if found else 0.0


def _resampled(g: Grams, times: int, source: np.random.Generator) -> list[Array]:
    """How often each half stroke (c,) counts."""
    found = []
    for left_out in np.unique(g.experiment):
        kept = np.flatnonzero(g.experiment != left_out) if np.ptp(g.experiment) else np.arange(len(g.experiment))
        for _ in range(times):
            drawn = source.choice(kept, len(kept))
            found.append(np.bincount(drawn, minlength=len(g.experiment)).astype(np.float64))
    return found
