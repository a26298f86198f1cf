"""Everything linear around one model: the residuals, what nuisances explain of them, and the effects that may join."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, half_strokes, sensitivities
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.half_strokes import spans
from stagectl.gap.residuals.thresholds import EXPLAINED, RIDGE
from stagectl.gap.selection import candidates, constants, null_ensemble, refine, usual_sizes
from stagectl.gap.selection.candidates import EffectValues, Form
from stagectl.gap.selection.evidence import (
    Candidate,
    Conditioned,
    Prior,
    Verdict,
    Weighed,
    compare,
    conditioned,
    means,
    temper,
)
from stagectl.gap.selection.refine import Evidence, Fitted

# Effects that are in no set together: one that holds the other, and both scales of the current, which together make as
# little of every force as one likes, and of every residual with it.
APART = {effect.name: effect.generalisations for effect in EFFECTS.values() if effect.generalisations}
APART |= {constants.SCALING[0]: constants.SCALING[1:]}
Cuts = tuple[float, float]  # of the residual effort and of the missing current
Powers = tuple[float, float, float]  # of the likelihoods of both cuts, and of what repeats differ by in the effort


class Predicted(NamedTuple):
    """What repeats of a model's residuals and has an order, so that an unknown would be named."""

    cuts: Cuts = (0.0, 0.0)  # sums of squares
    share: float = 0.0  # of the residual effort, that a function of one coordinate predicts


class Remains(NamedTuple):
    """What one model leaves, with its base, the friction's form and its effects' parameters fitted."""

    strokes: Array  # (c,) sum of squares of the residual effort, of each half stroke
    floor: Array  # (c,) what of it repeats differ by
    samples: Array  # (c,) that count, of all repeats
    experiments: tuple[int, ...]  # half strokes of each, in their order
    current: float  # sum of squares of the missing current
    drift: float = 0.0  # sum of squares of the residual effort that repeats differ by
    excess: Cuts = (0.0, 0.0)  # sum of squares above the floor


class Library(NamedTuple):
    """All candidates with their columns, next to those of the base and of the null ensemble."""

    forms: tuple[Form, ...]
    products: gram_matrices.Products
    excess: Cuts  # sum of squares above the floor that the nuisances leave of the baseline fit
    predict: Callable[[Evidence, Fitted], Predicted] = lambda *_: Predicted()
    unordered: Callable[[Evidence, Fitted], bool] = lambda *_: False  # whether a model leaves what has no order


class Linearised(NamedTuple):
    """The sets of effects that may join one model, compared."""

    start: Conditioned  # whose evidence is that of the model without any of them
    candidates: list[Candidate]
    forms: tuple[Form, ...]
    excess: Cuts
    powers: Powers
    verdict: Verdict

    @property
    def largest(self) -> float:
        """Of the cuts of `excess`, each times the power of its likelihood."""
        return max(power * cut for power, cut in zip(self.powers, self.excess, strict=False))

    @property
    def empty(self) -> float:
        """Probability that no effect joins."""
        return self.verdict.of_sets().get(frozenset(), 0.0)

    def values(self, chosen: Weighed) -> list[EffectValues]:
        """The effects of a set, with their most probable sizes."""
        members = [self.candidates[k] for k in chosen.members]
        sizes = means(self.start, [member.prior for member in members])
        forms = [self.forms[member.form] for member in members]
        return [EffectValues(f.effect, f.values(size.tolist())) for f, size in zip(forms, sizes, strict=True)]

    def explained(self, chosen: Weighed) -> float:
        """What a set explains, as a share of what is left of the largest cut."""
        priors = [self.candidates[k].prior for k in chosen.members]
        places, size = [place for prior in priors for place in prior.places], np.concatenate(means(self.start, priors))
        gain = size @ (2.0 * self.start.right[places] - self.start.gram[np.ix_(places, places)] @ size)
        return float(gain) / self.largest if self.largest > 0.0 else 0.0


def library_of(e: Evidence, forms: Sequence[Form], products: gram_matrices.Products) -> Library:
    """The candidates `forms`, whose columns `products` hold, next to the baseline fit."""
    now = refine.start(e)
    g = gram_matrices.fold_sums(products, now.residuals)
    return Library(tuple(forms), products, left_of(g, parameters(e, now, g), products, now))


def linearised(
    e: Evidence, library: Library, now: Fitted, out: EffectValues | None = None, traces: bool = True
) -> Linearised:
    """The sets that may join `now`, compared; `out` is an effect that was just taken out of it, with its values.

    An effect that explains much explains it with an error of form, so the powers stay those of the beginning.  Without
    `traces`, effects of any size count, and an error of form is no larger than all that `now` leaves.  An error of form
    is the same in all repeats: what these differ by is noise, and what drifts.
    """
    refined = () if out is None else (as_form(out),)
    columns = [*refine.parameters(now), *(each for form in refined for each in candidates.directions(form))]
    more = sensitivities.all_columns(now.equipped, e.runs, columns, e.base.noise)
    products = gram_matrices.with_columns(library.products, more)
    g = gram_matrices.fold_sums(products, now.residuals)
    present = candidates.in_place(now.effects)
    if present & set(constants.SCALING):
        present |= set(constants.SCALING)
    forms = tuple(form for form in (*library.forms, *refined) if form.effect.name not in present)
    excited = np.einsum("ckk->k", g.effort) + np.einsum("ckk->k", g.current) > 0.0
    tried = [c for c in usual_sizes.of_effects(forms, g.places) if excited[list(c.prior.places)].all()]
    nuisances = parameters(e, now, g)
    small = [usual_sizes.immaterial(library.forms, g.places)] if traces else []
    left = left_of(g, nuisances, library.products, now)
    apart = gram_matrices.differences(products, now.residuals)
    drift = float(apart.square[0, -1, -1]) - gram_matrices.unexplained(apart.square[0])
    powers = powers_of(library.excess if traces else left, drift, strokes(e))
    start = start_of(g, [*nuisances, *small], powers, apart)
    return Linearised(start, tried, forms, left, powers, compare(start, tried, APART))


def powers_of(cuts: Cuts, drift: float, count: int) -> Powers:
    """Powers of the likelihoods where both `cuts` and a `drift` are left (sums of squares), over `count` half strokes.

    A drift has an error of form, too, but repeats never say less of it than all they hold.
    """
    effort, current = (temper(cut, count) for cut in cuts)
    return effort, current, max(effort, temper(drift, count))


def excess(e: Evidence, library: Library, now: Fitted) -> Cuts:
    """Sum of squares above the floor that base, friction and the effects' own parameters leave."""
    g = gram_matrices.fold_sums(known(e, library, now), now.residuals)
    return left_of(g, parameters(e, now, g), library.products, now)


def scatter(e: Evidence, library: Library, now: Fitted) -> float:
    """Standard deviation of the `excess` of the effort where nothing is missing, at most; 0 without repeats.

    Of R repeats, n samples of unit noise leave n R, and their mean and their differences scatter by themselves: the
    variance is 2 n R / (R - 1).  Noise that is not white has fewer samples of its own.
    """
    repeats = float(np.mean([len(each) for each in e.deviations]))
    noise = float(gram_matrices.noise(library.products, now.residuals)[0])
    return math.sqrt(2.0 * noise / max(repeats - 1.0, 1.0))


def remains(e: Evidence, library: Library, now: Fitted) -> Remains:
    """What `now` leaves in each half stroke."""
    g = gram_matrices.grams(known(e, library, now), now.residuals)
    nuisances, current = parameters(e, now, g), float(g.current[:, -1, -1].sum())
    effort, left = _strokes_left(g.effort, nuisances), left_of(g, nuisances, library.products, now)
    drift = float(gram_matrices.differences(library.products, now.residuals).square[0, -1, -1])
    return Remains(effort, g.floor[:, 0], samples(e), experiments(e), current, drift, left)


def samples(e: Evidence) -> Array:
    """(c,) How many of each half stroke count, of all repeats."""
    return np.concatenate([half_strokes.samples(run) for run in e.runs])


def experiments(e: Evidence) -> tuple[int, ...]:
    """The number of half strokes of each experiment."""
    return tuple(len(half_strokes.samples(run)) for run in e.runs)


def known(e: Evidence, library: Library, now: Fitted) -> gram_matrices.Products:
    """The columns of base, friction's form, and the effects' own parameters."""
    own = sensitivities.all_columns(now.equipped, e.runs, refine.parameters(now), e.base.noise)
    names = [*refine.moving(e), *null_ensemble.member_names(library.products.names), *refine.free_names(e)]
    return gram_matrices.with_columns(gram_matrices.selected(library.products, names), own)


def as_form(valued: EffectValues) -> Form:
    """An effect at its refined values, as one more place on the grid of its shapes."""
    effect, values = valued.effect, valued.values
    typical = tuple(
        values[a.name] if abs(values[a.name]) > constants.LEAST_SIZE * abs(a.typical[0]) else a.typical[0]
        for a in effect.amplitudes
    )
    names = tuple(f"{effect.name}(refined).{a.name}" for a in effect.amplitudes)
    return Form(effect, {shape.name: values[shape.name] for shape in effect.shapes}, typical, names)


def parameters(e: Evidence, now: Fitted, g: Grams) -> list[Prior]:
    """Priors of the base, of the friction's form, of the effects' parameters in the model, of the function beside."""
    base = usual_sizes.of_base(e.base.prior, now.model, refine.moving(e), g.places)
    form = usual_sizes.of_form_error(g.places(null_ensemble.member_names(g.names)))
    beside = [] if e.beside is None else [e.beside.prior(g.places)]
    return [base, form, usual_sizes.of_own(now, g.places), *beside]


def left_of(g: Grams, nuisances: Sequence[Prior], products: gram_matrices.Products, now: Fitted) -> Cuts:
    """Sum of squares that `nuisances` leave above the noise, which the `products` tell from a drift.

    Of the current the whole counts: the time shift belongs to the mechanics, and would hide a dead time.
    """
    floor = gram_matrices.noise(products, now.residuals)
    return left_in_effort(g, nuisances) - float(floor[0]), float(g.current[:, -1, -1].sum() - floor[1])


def left_in_effort(g: Grams, nuisances: Sequence[Prior]) -> float:
    """Sum of squares of the residual effort that `nuisances` leave, with the noise."""
    return float(_strokes_left(g.effort.sum(axis=0)[None], nuisances)[0])


def _strokes_left(strokes: Array, nuisances: Sequence[Prior]) -> Array:
    """(c,) Sums of squares that the `nuisances`, fitted to all `strokes` (c, p + 1, p + 1), leave of each."""
    g, places = strokes.sum(axis=0), [place for prior in nuisances for place in prior.places]
    residual = np.zeros(len(g))
    residual[places] = -np.concatenate(means(Conditioned(g[:-1, :-1], g[:-1, -1], 0.0), nuisances))
    residual[-1] = 1.0
    left: Array = (strokes @ residual) @ residual
    return left


def start_of(
    g: Grams, nuisances: Sequence[Prior], powers: Sequence[float], apart: gram_matrices.Differences | None = None
) -> Conditioned:
    """The data with all nuisances integrated out; each cut counts with the power of its likelihood.

    What repeats differ by is `apart`, with the third of the `powers`; it counts as all else unless given.
    """
    mixed = powers[0] * g.effort.sum(axis=0) + powers[1] * g.current.sum(axis=0)
    if apart is not None:
        at = np.ix_([*apart.places, -1], [*apart.places, -1])
        mixed[at] += (powers[2] - powers[0]) * apart.square[0]
    squares = np.diag(mixed)[:-1]
    gram = mixed[:-1, :-1] + RIDGE * np.diag(squares)  # rounding must not make it indefinite
    state = Conditioned(gram, mixed[:-1, -1], -0.5 * float(mixed[-1, -1]))
    for prior in nuisances:
        if prior.places:
            state = conditioned(state, prior)
    # Of a column that the nuisances explain, rounding is left: it says nothing.
    own = np.diag(state.gram) > EXPLAINED * squares
    return state._replace(gram=state.gram * np.outer(own, own), right=state.right * own)


def strokes(e: Evidence) -> int:
    """Number of half strokes, repeats of one not counted."""
    return sum(len(spans(run.cluster)) for run in e.runs)
