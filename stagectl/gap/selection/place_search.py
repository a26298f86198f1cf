"""Where the fit of an effect may begin whose columns bend: a search over all its parameters at once.

Behind a gap the load hits its stops, and a resonance rings at its own frequency alone: the sum of squares has many
minima, and a Gauss-Newton step ends in the nearest one.  Next to the friction's form, which is free, the deepest is far
deeper than the others: differential evolution finds it, from the effect's grid and from places between.

Source: R. Storn, K. Price, Journal of Global Optimization 11, 1997.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import Bounds, differential_evolution
from scipy.stats import qmc

from stagectl.gap.effects.effect import Definition
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.residuals.thresholds import DIVERGED
from stagectl.gap.selection import linearised, thresholds
from stagectl.gap.selection.candidates import EffectValues, Form, equipped
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.parallel import in_parallel


class _Axis(NamedTuple):
    """A parameter from `low` to `high`: 0 to 1 along the axis, in equal ratios unless it is a share or may be zero."""

    name: str
    low: float
    high: float
    share: bool = False

    def value(self, along: float) -> float:
        if self._in_ratios:
            return float(self.low * (self.high / self.low) ** along)
        return self.low + (self.high - self.low) * along

    def along(self, value: float) -> float:
        if self._in_ratios:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low) if self.high > self.low else 0.0

    @property
    def _in_ratios(self) -> bool:
        return not self.share and 0.0 < self.low < self.high


def places(e: Evidence, library: Library, now: Fitted, grid: Sequence[Form]) -> list[EffectValues]:
    """The most promising places of one effect next to `now`, the best first; `grid`: all of it."""
    effect = grid[0].effect
    axes, left = _axes(effect), left_by(e, library, now)

    def at(point: Array) -> EffectValues:
        return EffectValues(effect, {axis.name: axis.value(x) for axis, x in zip(axes, point.tolist(), strict=True)})

    def cost(point: Array) -> float:
        return left(at(point))

    def side_by_side(of: Callable[[Array], float], points: Iterable[Array]) -> list[float]:
        return in_parallel(of, list(points))

    found = differential_evolution(
        cost,
        Bounds(np.zeros(len(axes)), np.ones(len(axes))),
        maxiter=thresholds.SEARCH_GENERATIONS,
        init=_first(axes, grid),
        polish=False,
        updating="deferred",
        workers=side_by_side,
        seed=thresholds.SEARCH_SEED,
    )
    best = np.argsort(found.population_energies)[: thresholds.PROMISING_PLACES]
    return [at(found.population[k]) for k in best]


def _axes(effect: Definition) -> list[_Axis]:
    """The range of each parameter: that of its grid and its typical sizes, and wider; of a share, all."""
    axes = [_axis(size.name, size.typical, (size.low, size.high)) for size in effect.amplitudes]
    for shape in effect.shapes:
        limits = (shape.low, shape.high)
        axes.append(_Axis(shape.name, *limits, share=True) if shape.share else _axis(shape.name, shape.grid, limits))
    return axes


def _axis(name: str, usual: Sequence[float], limits: tuple[float, float]) -> _Axis:
    low, high = min(usual) / thresholds.SEARCH_WIDER, max(usual) * thresholds.SEARCH_WIDER
    return _Axis(name, max(low, limits[0]), min(high, limits[1]))


def _first(axes: Sequence[_Axis], grid: Sequence[Form]) -> Array:
    """(n, p) The first places, along the axes: those of the `grid`, and as many others as the search needs."""
    known = [[axis.along(form.values(form.typical)[axis.name]) for axis in axes] for form in grid]
    source = qmc.Sobol(len(axes), seed=thresholds.SEARCH_SEED)
    others = source.random(1 << (thresholds.SEARCH_MEMBERS * len(axes) - 1).bit_length())
    return np.concatenate([np.clip(known, 0.0, 1.0), others])


def left_by(e: Evidence, library: Library, now: Fitted) -> Callable[[EffectValues], float]:
    """The sum of squares of the effort that `now` leaves with one effect more, next to the friction's form.

    What the effect changes is simulated along the mean of the repeats, and the same in all of them.
    """
    known = linearised.known(e, library, now)
    nuisances = linearised.parameters(e, now, gram_matrices.fold_sums(known, now.residuals))
    before = sensitivities.mean_residuals(now.equipped, e.runs, e.base.noise)

    def left(place: EffectValues) -> float:
        model = equipped(now.model, [*now.effects, place])
        after = sensitivities.mean_residuals(model, e.runs, e.base.noise)
        changes = [then - first for then, first in zip(after, before, strict=True)]
        if not all(np.abs(change).max() < DIVERGED for change in changes):
            return math.inf
        residuals = [[each + change for each in of] for of, change in zip(now.residuals, changes, strict=True)]
        return linearised.left_in_effort(gram_matrices.fold_sums(known, residuals), nuisances)

    return left
