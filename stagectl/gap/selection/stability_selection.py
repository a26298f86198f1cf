"""How often an effect would be found again: one experiment left out, the half strokes of the rest resampled.

An effect that only one experiment or a few half strokes carry is a property of these and not of the machine.  Where
the other experiments do not excite it at all, such as a limit that one motion reaches, they say nothing on it.

Source: N. Meinshausen, P. Bühlmann, Stability selection, J. R. Statist. Soc. B 72(4), 2010; here with a bootstrap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.run_products import first_fold
from stagectl.gap.selection.candidates import Form
from stagectl.gap.selection.cross_validation import channel_of, scores
from stagectl.gap.selection.thresholds import EXCITED


def inclusion(g: Grams, nuisance: Sequence[int], forms: Sequence[Form], share: float, times: int) -> float:
    """Share of the resamples in which a form of one effect explains more than `share` of what the nuisances leave.

    `times` resamples for each experiment that is left out; the effect is not in the model whose residual `g` holds.
    """
    places = [*nuisance, *sorted({place for form in forms for place in g.places(form.names)}), len(g.names)]
    small = np.stack([channel[:, places][:, :, places] for channel in (g.effort, g.current)])
    channel = channel_of(forms[0], small)
    position = {place: k for k, place in enumerate(places)}
    own = [[position[place] for place in g.places(form.names)] for form in forms]
    energy = [small[channel][:, k, k] for k in {place for columns in own for place in columns}]
    first, resamples = first_fold(g.stroke), np.array(_resamples(g, times))
    sums = np.tensordot(np.stack([resamples * first, resamples * ~first], axis=1), small, (2, 1))  # (r, fold, channel)
    included = []
    for counts, fold_sums in zip(resamples, sums, strict=True):
        if not any(counts @ column > EXCITED * column.sum() for column in energy):
            continue
        both = np.swapaxes(fold_sums, 0, 1)
        best = max(scores(both, range(len(nuisance)), own, forms), key=lambda score: score.gain)
        # Without the effect the base stays where it is with it: what the base would take back does not remain.
        included.append(best.gain > share * (best.before - float(counts @ g.floor[:, channel])))
    return float(np.mean(included)) if included else 0.0


def _resamples(g: Grams, times: int) -> list[Array]:
    """How often each half stroke (c,) counts, in each resample."""
    source = np.random.default_rng(0)
    resamples = []
    for left_out in np.unique(g.experiment):
        kept = np.flatnonzero(g.experiment != left_out) if np.ptp(g.experiment) else np.arange(len(g.experiment))
        for _ in range(times):
            drawn = source.choice(kept, len(kept))
            resamples.append(np.bincount(drawn, minlength=len(g.experiment)).astype(np.float64))
    return resamples
