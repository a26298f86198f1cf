"""Which effects explain the residuals: one Gaussian evidence, compared over sets of effects.

::

    residuals = B b + M g + sum over the set of C_k a_k + noise

    b   the parameters of the model        prior around their nominal values
    g   the form of the friction           prior from the null ensemble: other laws on these very paths
    a   the sizes of an effect             prior around typical sizes, averaged over the grid of its shapes

Everything is linear and Gaussian, so all integrals are known.  The Gram matrices are all that is needed of the data.
Parameters and friction are integrated out once.  Each effect that joins a set is integrated out on top, at the cost of
one small matrix.  A set's weight is its evidence times the prior of its number of effects, and the probability of an
effect is the sum of the weights of the sets that hold it.

Residuals of a wrong model are no white noise: neighbouring samples are wrong together, and so are repeats.  Each cut
therefore counts with a power of its likelihood, so that half strokes count and not samples.

Sources: D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, chapter 28; P. Gruenwald,
T. van Ommen, Bayesian Analysis 12(4), 2017 (tempered likelihoods under wrong models).
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import log_ndtr, logsumexp

from stagectl.gap.logs.session import Array
from stagectl.gap.selection.constants import BEAM, INCLUSION, MOST_EFFECTS, NEGLIGIBLE


class Prior(NamedTuple):
    """What is known beforehand of some columns' amplitudes, each by itself."""

    places: tuple[int, ...]  # of the columns
    mean: Array  # (k,)
    deviation: Array  # (k,)


class Candidate(NamedTuple):
    """An effect with one of its shapes, at one of its scales."""

    effect: str
    form: int  # number of its form in the library
    prior: Prior
    share: float  # of the effect's prior that falls on this candidate
    positive: bool = False  # whether negative amplitudes have no meaning


class Conditioned(NamedTuple):
    """The data with some amplitudes integrated out."""

    gram: Array  # (p, p) of all columns, less what the amplitudes explain
    right: Array  # (p,) columns times residual, likewise
    log_evidence: float  # over that of no amplitude at all


class Weighed(NamedTuple):
    """A set of candidates, with its share of the posterior."""

    members: tuple[int, ...]  # numbers of the candidates, ascending
    effects: frozenset[str]
    probability: float
    log_weight: float  # of its evidence and its prior, over that of no effect


class Verdict(NamedTuple):
    """The posterior over sets."""

    sets: tuple[Weighed, ...]  # the most probable first; all shapes and scales by themselves

    def of_effects(self) -> dict[str, float]:
        """The probability of each effect: the sum over the sets that hold it."""
        total: dict[str, float] = {}
        for item in self.sets:
            for name in item.effects:
                total[name] = total.get(name, 0.0) + item.probability
        return total

    def of_sets(self) -> dict[frozenset[str], float]:
        """The probability of each set of effects, over all shapes and scales; the most probable first."""
        total: dict[frozenset[str], float] = {}
        for item in self.sets:
            total[item.effects] = total.get(item.effects, 0.0) + item.probability
        return dict(sorted(total.items(), key=lambda pair: -pair[1]))

    def best(self, effects: frozenset[str]) -> Weighed:
        """The most probable shapes and scales of one set of effects."""
        return next(item for item in self.sets if item.effects == effects)


def temper(excess: float, strokes: int) -> float:
    """Power in (0, 1] of the likelihood of a cut whose nuisances leave `excess` (sum of squares of unit noise).

    An error of form of relative size rho, wrong together over a half stroke, has rho^2 = 1 / `strokes`: no free number.
    """
    return 1.0 / (1.0 + max(excess, 0.0) / max(strokes, 1))


def fitted_odds(gain: float, more: int, strokes: int) -> float:
    """Log of the odds of a fit that gains so much (unit noise) with `more` values: each pays by the half strokes.

    Source: G. Schwarz, Annals of Statistics 6(2), 1978.
    """
    return 0.5 * (gain - more * math.log(max(strokes, 1)))


def conditioned(p: Conditioned, prior: Prior, positive: bool = False) -> Conditioned:
    """`p` with the amplitudes of `prior` integrated out as well."""
    places = list(prior.places)
    precision = prior.deviation**-2.0
    factor = cho_factor(p.gram[np.ix_(places, places)] + np.diag(precision), lower=True)
    right = p.right[places] + precision * prior.mean
    solved = cho_solve(factor, np.column_stack([p.gram[places], right]))
    amplitude, diagonal = solved[:, -1], np.diag(factor[0])
    gain = 0.5 * float(right @ amplitude - precision @ prior.mean**2)
    gain -= float(np.log(diagonal).sum() + np.log(prior.deviation).sum())
    if positive:
        spread = np.sqrt(np.diag(cho_solve(factor, np.eye(len(places)))))
        gain += float((math.log(2.0) + log_ndtr(amplitude / spread)).sum())
    return Conditioned(
        p.gram - p.gram[:, places] @ solved[:, :-1], p.right - p.gram[:, places] @ amplitude, p.log_evidence + gain
    )


def means(p: Conditioned, priors: Sequence[Prior]) -> list[Array]:
    """Most probable amplitudes of the columns of several priors together."""
    if not priors:
        return []
    places = [place for prior in priors for place in prior.places]
    precision = np.concatenate([prior.deviation**-2.0 for prior in priors])
    pull = precision * np.concatenate([prior.mean for prior in priors])
    solved = np.linalg.solve(p.gram[np.ix_(places, places)] + np.diag(precision), p.right[places] + pull)
    ends = np.cumsum([len(prior.places) for prior in priors])
    return np.split(solved, ends[:-1])


def gains(p: Conditioned, candidates: Sequence[Candidate]) -> Array:
    """(n,) log of the Bayes factor of each candidate next to what is integrated out already."""
    result = np.empty(len(candidates))
    for count in {len(candidate.prior.places) for candidate in candidates}:
        chosen = [k for k, candidate in enumerate(candidates) if len(candidate.prior.places) == count]
        result[chosen] = _gains(p, [candidates[k] for k in chosen])
    return result


def _gains(p: Conditioned, candidates: Sequence[Candidate]) -> Array:
    """`gains` of candidates with the same number of amplitudes."""
    places = np.array([candidate.prior.places for candidate in candidates])
    mean = np.array([candidate.prior.mean for candidate in candidates])
    deviation = np.array([candidate.prior.deviation for candidate in candidates])
    precision = deviation**-2.0
    a = p.gram[places[:, :, None], places[:, None, :]] + precision[:, :, None] * np.eye(places.shape[1])
    right = p.right[places] + precision * mean
    covariance = np.linalg.inv(a)
    amplitude = (covariance @ right[:, :, None])[:, :, 0]
    gain = 0.5 * np.sum(right * amplitude - precision * mean**2, axis=1)
    gain -= 0.5 * np.linalg.slogdet(a)[1] + np.log(deviation).sum(axis=1)
    spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    one_sided = (math.log(2.0) + log_ndtr(amplitude / spread)).sum(axis=1)
    result: Array = gain + np.where([candidate.positive for candidate in candidates], one_sided, 0.0)
    return result


def compare(start: Conditioned, candidates: Sequence[Candidate], wider: Mapping[str, Sequence[str]]) -> Verdict:
    """The posterior over sets of effects, next to the nuisances that `start` has integrated out.

    All single effects, then from the best sets on with one effect more.  A set never holds two forms of one effect, nor
    an effect beside one of its `wider` forms, which holds it already.
    """
    log_prior = np.array([math.log(INCLUSION * candidate.share) for candidate in candidates])
    found: dict[tuple[int, ...], float] = {(): 0.0}
    beam: list[tuple[tuple[int, ...], Conditioned, float]] = [((), start._replace(log_evidence=0.0), 0.0)]
    for count in range(MOST_EFFECTS):
        fresh: dict[tuple[int, ...], float] = {}
        for members, state, prior in beam:
            free = _free(members, candidates, wider)
            if not free:
                continue
            scores = state.log_evidence + prior + log_prior[free] + gains(state, [candidates[k] for k in free])
            kept = _that_count(scores, max(found.values())) if count else range(len(free))
            fresh.update((tuple(sorted((*members, free[k]))), float(scores[k])) for k in kept)
        found.update(fresh)
        best = sorted(fresh, key=fresh.__getitem__, reverse=True)[:BEAM]
        beam = [
            (members, _joined(start, members, candidates), float(log_prior[list(members)].sum())) for members in best
        ]
    return _normalised(found, candidates)


def _that_count(scores: Array, best: float) -> list[int]:
    """Places of the `scores` (n,) of larger sets that the sum of all notices next to the `best`, or that go on."""
    least = max(best, float(scores.max())) + math.log(NEGLIGIBLE)
    if len(scores) > BEAM:
        least = min(least, float(np.partition(scores, -BEAM)[-BEAM]))
    places: list[int] = np.flatnonzero(scores >= least).tolist()
    return places


def _free(members: tuple[int, ...], candidates: Sequence[Candidate], wider: Mapping[str, Sequence[str]]) -> list[int]:
    present = {candidates[k].effect for k in members}
    barred = present | {name for one in present for name in wider.get(one, ())}
    barred |= {name for name, holders in wider.items() if present & set(holders)}
    return [k for k, candidate in enumerate(candidates) if candidate.effect not in barred]


def _joined(start: Conditioned, members: tuple[int, ...], candidates: Sequence[Candidate]) -> Conditioned:
    state = start._replace(log_evidence=0.0)
    for k in members:
        state = conditioned(state, candidates[k].prior, candidates[k].positive)
    return state


def _normalised(found: Mapping[tuple[int, ...], float], candidates: Sequence[Candidate]) -> Verdict:
    whole = float(logsumexp(list(found.values())))
    sets = [
        Weighed(members, frozenset(candidates[k].effect for k in members), math.exp(weight - whole), weight)
        for members, weight in found.items()
    ]
    return Verdict(tuple(sorted(sets, key=lambda item: -item.log_weight)))
