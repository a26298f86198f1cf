"""How far the values of the model may be off: what parts of the data, each in turn, pull them by.

What a model leaves is no noise: it is wrong alike over one experiment, at one speed or place, or in one octave of
frequency.  A value that is right is the same from all parts of the data, however these are divided.  The data are
therefore divided in every way: by experiment, by each coordinate of the motion, by the clock, by octaves.  What the
parts pull a value by is its error (`gram_matrices.mean_square_error`), and the largest of these counts.
Source of errors by several divisions: A. C. Cameron, J. B. Gelbach, D. L. Miller, Journal of Business & Economic
Statistics 29(2), 2011.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import expit
from scipy.stats import chi2

from stagectl.gap.inference.basis_functions import BasisColumns, RunMotion
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import data_parts, gram_matrices, least_squares, sensitivities
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.thresholds import LEAST_BLOCKS
from stagectl.gap.selection import baseline_fit, constants, linearised
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.established import Say, Selection, dropped
from stagectl.gap.selection.evidence import temper
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.refine import Evidence, Fitted

CLOCK, EXPERIMENT = "clock", "experiment"
CONFIDENCE = 0.95  # of all intervals that are stated
COORDINATES: Mapping[str, Callable[[RunMotion, float], Array]] = {
    "velocity": lambda motion, _: motion.velocity,
    "acceleration": lambda motion, _: motion.acceleration,
    "since_reversal": lambda motion, _: motion.since,
    "position": lambda motion, _: motion.position,
    "position_mod_pitch": lambda motion, pitch: np.mod(motion.position, pitch),
    "current": lambda motion, _: motion.current,
}


class Errors(NamedTuple):
    """What is known of base, friction and effects next to the model that was selected."""

    grams: Grams  # of all columns and the residual
    names: tuple[str, ...]
    matrix: Array  # (k, k) mean square error
    between: Array  # (k, k) what of it parts of the data contradict each other by
    larger: Array  # (k,) by how much each value may be larger besides, and not smaller

    def deviations(self) -> dict[str, float]:
        """Standard error of each parameter's value in the model."""
        error = np.sqrt(np.maximum(np.diag(self.matrix), 0.0))
        return dict(zip(self.names, error.tolist(), strict=True))

    def of(self, names: Sequence[str]) -> Array:
        """(n, n) Mean square errors of the parameters `names`."""
        places = [self.names.index(name) for name in names]
        chosen: Array = self.matrix[np.ix_(places, places)]
        return chosen


def errors(e: Evidence, library: Library, now: Fitted, smooth: BasisColumns) -> dict[str, Errors]:
    """Of all parameters of `now`, with their priors and the friction's form: by the way to divide the data.

    The fit does not know the columns of the friction's form, so that how far it is from the most probable values
    belongs to its error.
    """
    products = linearised.known(e, library, now)
    g = gram_matrices.grams(products, now.residuals)
    nuisances, count = linearised.parameters(e, now, g), linearised.strokes(e)
    left = linearised.left_of(g, nuisances, library.products, now)
    places = [place for prior in nuisances for place in prior.places]
    names, powers = tuple(g.names[place] for place in places), [temper(cut, count) for cut in left]
    mean = np.concatenate([prior.mean for prior in nuisances])
    precision = np.concatenate([prior.deviation**-2.0 for prior in nuisances])
    of_current = g.current.sum(axis=0)[np.ix_(places, places)]
    apart = _by_the_command(e, now, products, (places, (np.diag(precision) + powers[1] * of_current) / powers[0]))
    diluted = _dilution(g.effort.sum(axis=0)[np.ix_(places, places)], names, now, left[0], _jitter(e))
    found = {}
    for way, parts in ways(g, products, now, smooth).items():
        error = gram_matrices.mean_square_error(np.tensordot(parts, powers, (1, 0)), places, mean, precision)
        found[way] = Errors(g, names, error.whole + np.outer(apart, apart), error.between, diluted)
    return found


def _by_the_command(
    e: Evidence, now: Fitted, products: gram_matrices.Products, known: tuple[Sequence[int], Array]
) -> Array:
    """(k,) What values change by where the force is that of the command, and not that of the measured current.

    Where the drive gives another current than its model, or reports another than it gives, one of the two is wrong.
    `known` has the places of the columns, and how well they are known but for the force: by their priors and the
    current.
    """
    places, precision = known
    if not baseline_fit.is_measured(e.runs):
        return np.zeros(len(places))
    commanded = [run._replace(mean=run.mean._replace(rows=run.mean.rows * [1.0, 1.0, np.nan])) for run in e.runs]
    measured = sensitivities.mean_residuals(now.equipped, e.runs, e.base.noise)
    other = sensitivities.mean_residuals(now.equipped._replace(shift=0.0), commanded, e.base.noise)
    a, right = precision, np.zeros(len(places))
    for part, with_one, with_other in zip(products.parts, measured, other, strict=True):
        columns, repeats = part.mean[0][places].astype(np.float64), len(part.run.paths)
        a = a + repeats * columns @ columns.T
        right += repeats * columns @ part.weighted(with_other - with_one)[0]
    changed: Array = least_squares.inverse(a) @ right
    return changed


def _dilution(a: Array, names: Sequence[str], now: Fitted, left: float, jitter: float) -> Array:
    """(k,) How much larger each value may be, as what is `left` (sum of squares) may be motion and no force.

    An acceleration is the log's motion twice differentiated: jitter of the time stamps, a filter or aliasing make more
    of it than any other column.  Then the regression of the force on it gives too little inertia, and that of it on the
    force too much; the true one lies between, and needs no more force than there is for what is more than `jitter` (sum
    of squares) of it.  `a` (k, k) are the columns' products.  Source: R. Frisch, Statistical Confluence Analysis by
    Means of Complete Regression Systems, 1934.
    """
    apart = np.diag(least_squares.inverse(a))  # one over the square of each column, less what the others make of it
    inertia, largest = now.model.stage.mechanics.inertia, np.zeros(len(names))
    for k in [k for k, name in enumerate(names) if name == "inertia" and apart[k] > 0.0]:
        by_motion, sure = inertia + max(left, 0.0) * apart[k] / inertia, 1.0 - jitter * apart[k]
        largest[k] = min(by_motion, math.sqrt(inertia * by_motion / sure) if sure > 0.0 else math.inf) - inertia
    return largest


def _jitter(e: Evidence) -> float:
    """Sum of squares that noise makes of an inertia's column: no more than what makes the unit noise of a sample."""
    samples = sum(float(np.sum(run.weight * run.weight)) for run in e.runs)
    return samples / e.base.prior.nominal.stage.mechanics.inertia**2


def ways(g: Grams, products: gram_matrices.Products, now: Fitted, smooth: BasisColumns) -> dict[str, Array]:
    """Every way to divide the data: the matrices (b, 2, p + 1, p + 1) of its parts, by its name."""
    divided = {EXPERIMENT: gram_matrices.by_experiment(g)}
    if sum(len(run.paths) for run in smooth.runs) >= 2 * LEAST_BLOCKS:
        divided[CLOCK] = data_parts.by_clock(products, now.residuals)
    for name, place in COORDINATES.items():
        along = data_parts.quantiles([place(motion, smooth.size.pitch) for motion in smooth.motions])
        divided[name] = data_parts.by_sample(products, now.residuals, along)
    return {**divided, "frequency": data_parts.by_octave(products, now.residuals)}


def log_odds(moved: Array, error: Array, prior: Array) -> float:
    """Log of the odds of a change of values (k,) against none: the prior density at no change over the posterior one.

    `error` (k, k) is their mean square error, `prior` (k,) the standard deviations of a change before the data.  A
    direction whose error is as wide as its prior says nothing.  Source: J. M. Dickey, Annals of Mathematical
    Statistics 42(1), 1971.
    """
    size, away = _on_axes(moved, error, prior)
    return float(0.5 * np.sum((np.log(size) + away**2 / size)[size < 1.0]))


def _on_axes(moved: Array, error: Array, scale: Array) -> tuple[Array, Array]:
    """Mean square errors (k,) along their own axes, and the values on these, both in units of `scale` (k,)."""
    size, axes = np.linalg.eigh(error / np.outer(scale, scale))
    return np.maximum(size, np.finfo(np.float64).eps), axes.T @ (moved / scale)  # no better than rounding lets it


def borne_out(e: Evidence, library: Library, selected: Selection, smooth: BasisColumns, say: Say) -> Selection:
    """`selected` with no effect more probable than that its size is not none, as far as parts of the session agree.

    What is more probably of no size leaves the model.  An effect may show in one experiment alone, but in all repeats
    of it, and experiments that show it must not contradict each other.  A drift may end soon, but shows in all
    experiments.  Where nothing was repeated, drifts, and waves that stand by their line alone, must show in all
    experiments; of any other effect each division of the data must tell that it has a size, as its interval is that of
    the division that contradicts itself most.
    """
    known = errors(e, library, selected.fitted, smooth)
    of_size = {valued.effect.name: _borne_out(valued, known) for valued in selected.fitted.effects}
    weak = min(of_size, key=of_size.__getitem__, default="")
    if weak and of_size[weak] < constants.KEPT:
        return borne_out(e, library, dropped(e, library, selected.fitted, weak, say), smooth, say)
    return selected._replace(probability={name: min(p, of_size[name]) for name, p in selected.probability.items()})


def _borne_out(valued: EffectValues, known: Mapping[str, Errors]) -> float:
    """Probability that an effect has a size, as far as those parts of the data agree that must.

    None where the region that is stated, the widest of all, holds no effect: a probability agrees with its interval.
    """
    if any(_may_be_none(valued, each) for each in known.values()):
        return 0.0
    if CLOCK not in known:
        alone = valued.effect.time_variation is not None or valued.effect.name in constants.WAVES
        must = [known[EXPERIMENT]] if alone else known.values()
        return min(_of_size(valued, each, each.matrix) for each in must)
    must = [known[EXPERIMENT]] if valued.effect.time_variation else [known[EXPERIMENT], known[CLOCK]]
    return min(_of_size(valued, way, way.between) for way in must)


def _may_be_none(valued: EffectValues, known: Errors) -> bool:
    """Whether the 95 % region of the amplitudes holds zero."""
    value, names = _amplitudes(valued)
    size, away = _on_axes(value, known.of(names), np.maximum(abs(value), 1e-300))
    return float(np.sum(away**2 / size)) < chi2.ppf(CONFIDENCE, len(value))


def _of_size(valued: EffectValues, known: Errors, error: Array) -> float:
    value, names = _amplitudes(valued)
    places = [known.names.index(name) for name in names]
    usual = np.array([abs(each.typical[0]) for each in valued.effect.amplitudes])
    prior = constants.WIDEST * np.maximum(abs(value), usual)
    odds = log_odds(value, error[np.ix_(places, places)], prior)
    return float(expit(np.log(constants.INCLUSION) + odds))


def _amplitudes(valued: EffectValues) -> tuple[Array, list[str]]:
    """The amplitudes (k,) of an effect, and their names."""
    names = [each.name for each in valued.effect.amplitudes]
    return np.array([valued.values[name] for name in names]), [f"{valued.effect.name}.{name}" for name in names]
