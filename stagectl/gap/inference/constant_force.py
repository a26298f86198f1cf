"""What gives the constant force of the data: a bias that is off, or an effect that does as it does.

While an axis slides, a Coulomb asymmetry is a constant force; at rest an offset of the current is one.  A fit whose
bias is free makes a bias of all of them.  So the library is compared twice, next to a bias that is free and next to the
nominal one, and the two share the probability by their evidence.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.special import expit, logsumexp

from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.inference import thresholds
from stagectl.gap.inference.cable_centre import BIAS
from stagectl.gap.inference.parameter_errors import shift_odds
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.selection import constants, established, linearised, material, refine
from stagectl.gap.selection.candidates import EffectValues, joined
from stagectl.gap.selection.established import Say, Selection
from stagectl.gap.selection.linearised import Library, Linearised
from stagectl.gap.selection.refine import Evidence, Fitted


class Compared(NamedTuple):
    """The library next to a model whose bias is free, and next to the same one with the nominal bias."""

    fixed: Evidence  # without the bias among its parameters
    nominal: Fitted
    beside: tuple[Linearised, Linearised]  # the free bias, the nominal one

    @property
    def bias(self) -> float:
        """Probability of a bias that is off, over all sets of effects."""
        free, nominal = (at.start.log_evidence + _total(at) for at in self.beside)
        given = self.nominal.model.stage.mechanics.bias
        return float(expit(np.log(shift_odds(BIAS, given)) + free - nominal))

    def of_effects(self) -> Mapping[str, float]:
        """Probability of each effect, whatever the bias."""
        free, nominal = (at.verdict.of_effects() for at in self.beside)
        p = self.bias
        return {name: p * free.get(name, 0.0) + (1.0 - p) * nominal.get(name, 0.0) for name in {*free, *nominal}}


def settled(e: Evidence, library: Library, selected: Selection, say: Say) -> tuple[Evidence, Selection]:
    """`selected`, or an effect in the place of the bias where that is more probable; the data then move no bias."""
    now = selected.fitted
    if BIAS not in refine.nuisances(e) or not _matters(e, now):
        return e, selected
    twin = next((valued for valued in now.effects if BIAS in EFFECTS[valued.effect.name].look_alikes), None)
    compared = _compared(e, library, now, twin)
    nominal = compared.beside[1]
    instead = nominal.values(nominal.verdict.sets[0])
    if compared.bias >= constants.KEPT or not instead:
        return e, _weighed(selected, compared)
    say(f"{', '.join(valued.effect.name for valued in instead)} in the place of the bias")
    after = refine.refine(compared.fixed, compared.nominal.model, joined(compared.nominal.effects, instead))
    standing = established.established(compared.fixed, library, after, say)
    if not {v.effect.name for v in instead} & {v.effect.name for v in standing.fitted.effects}:
        return e, _weighed(selected, compared)  # nothing stands in its place
    return compared.fixed, _weighed(standing, compared)


def _matters(e: Evidence, now: Fitted) -> bool:
    """Whether the bias of the model is off by more than what matters."""
    least = thresholds.SHIFT_LEAST[BIAS] / constants.FRICTION
    return abs(e.base.prior.moved(now.model, BIAS)) > least * e.base.prior.width(BIAS)


def _compared(e: Evidence, library: Library, now: Fitted, twin: EffectValues | None) -> Compared:
    """All sets of effects but for the `twin`, which may join as any other."""
    rest = now if twin is None else material.without(e, now, twin)
    fixed, nominal = _fixed(e), _with_nominal_bias(e, rest)
    free = linearised.linearised(e, library, rest, twin)
    return Compared(fixed, nominal, (free, linearised.linearised(fixed, library, nominal, twin)))


def _fixed(e: Evidence) -> Evidence:
    """The same data, of which nothing is the bias's."""
    kept = tuple(direction for direction in e.base.directions if direction.name != BIAS)
    names = [name for name in e.base.products.names if name != BIAS]
    products = gram_matrices.selected(e.base.products, names)
    return e._replace(base=e.base._replace(directions=kept, products=products))


def _with_nominal_bias(e: Evidence, now: Fitted) -> Fitted:
    moved = refine.moved(e, now.model, {BIAS: -e.base.prior.moved(now.model, BIAS)})
    return refine.at_values(e, moved, now.effects)


def _total(at: Linearised) -> float:
    return float(logsumexp([item.log_weight for item in at.verdict.sets]))


def _weighed(selected: Selection, compared: Compared) -> Selection:
    """`selected` with the probability of a bias that is off, and that of its twins whether it is or not."""
    either = compared.of_effects()
    twins = [name for name in selected.probability if BIAS in EFFECTS[name].look_alikes]
    capped = {name: min(selected.probability[name], either.get(name, 0.0)) for name in twins}
    return selected._replace(probability={**selected.probability, **capped, BIAS: compared.bias})
