"""The bristle of the friction family that joins the stop operators: the best of a coarse grid, then its best shape.

Along a measured path the friction is linear in the weights of the operators and in the force of a bristle, for one
shape of the bristle.  So each shape that is tried costs one column, and all weights follow it at once: where the true
law is one bristle, the operators come out empty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import friction_family, gram_matrices, least_squares
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import Direction, TrackedModel, all_columns
from stagectl.gap.residuals.whitening import Whitener
from stagectl.gap.selection import thresholds
from stagectl.gap.selection.priors import MEMBER, Prior
from stagectl.kernels import friction_bristle, stage


class Family(NamedTuple):
    """The columns of a refit, with the bristles among them."""

    products: gram_matrices.Products
    bristles: tuple[Direction, ...]
    chosen: Direction | None = None  # the bristle that is in the model

    @property
    def names(self) -> list[str]:
        """The column of the chosen bristle, if there is one."""
        return [] if self.chosen is None else [self.chosen.name]


class Data(NamedTuple):
    """What a refit fits."""

    runs: Sequence[Run]
    noise: Whitener
    residuals: list[list[Array]]  # whitened, of the model


def is_member(name: str) -> bool:
    """Whether a direction is a bristle of the family, of which the model has one at most."""
    return name.startswith(MEMBER) and name not in ("bristle_size", "bristle_length")


def members(nominal: stage.Stage) -> list[Direction]:
    """Bristles that may join the stop operators; none where the nominal law is a bristle itself."""
    if nominal.friction.bristle.coulomb > 0.0:
        return []
    size = thresholds.MEMBER_CHANGE * friction_family.size(nominal)
    return [member(f"{MEMBER}{k}", p, size) for k, p in enumerate(friction_family.bristles(nominal))]


def member(name: str, p: friction_bristle.Bristle, size: float) -> Direction:
    """The bristle `p`, as strong as `size` (N m | N)."""
    bristle = p._replace(coulomb=size, stiffness=p.stiffness * size / p.coulomb)
    return Direction(name, lambda m: with_bristle(m, bristle), size)


def with_bristle(m: TrackedModel, bristle: friction_bristle.Bristle) -> TrackedModel:
    """`m` with this bristle in the place of its own."""
    return m._replace(stage=m.stage._replace(friction=m.stage.friction._replace(bristle=bristle)))


def with_best(family: Family, model: TrackedModel, data: Data, names: Sequence[str], prior: Prior) -> Family:
    """The `family` with the bristle chosen, in its best shape, that explains most next to the parameters `names`."""
    g = gram_matrices.fold_sums(family.products, data.residuals)
    best = _best(g, names, family.bristles)
    return family if best is None else _in_best_shape(family, best, model, data, names, prior)


def _best(g: gram_matrices.Grams, names: Sequence[str], bristles: Sequence[Direction]) -> Direction | None:
    """The bristle that explains most next to the parameters `names`; None where none explains enough."""
    summed, closable = g.both.sum(axis=0), float(g.both[:, -1, -1].sum() - g.floor.sum())
    own = g.places(names)
    without = least_squares.fit(summed, own).residual_sum_of_squares
    fits = [(least_squares.fit(summed, [*own, *g.places([bristle.name])]), bristle) for bristle in bristles]
    possible = [(fit.residual_sum_of_squares, bristle) for fit, bristle in fits if fit.amplitude[-1] > 0.0]
    left, best = min(possible, key=lambda pair: pair[0], default=(without, None))
    return best if without - left > thresholds.BRISTLE_GAIN * closable else None


def _in_best_shape(
    family: Family, coarse: Direction, model: TrackedModel, data: Data, names: Sequence[str], prior: Prior
) -> Family:
    """The `coarse` bristle replaced by the one whose range and exponent leave least, all weights fitted with it."""
    p = coarse.change(model).stage.friction.bristle
    kept = gram_matrices.selected(family.products, [n for n in family.products.names if n != coarse.name])
    limits = prior.limits(model, [*names, coarse.name])

    def of(shape: Array) -> Direction:
        length, exponent = (math.exp(x) for x in shape)
        bent = p._replace(
            stiffness=p.stiffness / length, exponent=float(np.clip(p.exponent * exponent, *thresholds.EXPONENTS))
        )
        return member(coarse.name, bent, p.coulomb)

    def joined(direction: Direction) -> gram_matrices.Products:
        return gram_matrices.with_columns(kept, all_columns(model, data.runs, [direction], data.noise))

    def left(shape: Array) -> float:
        summed = gram_matrices.fold_sums(joined(of(shape)), data.residuals)
        g, places = summed.both.sum(axis=0), summed.places([*names, coarse.name])
        return least_squares.residual_sum_of_squares(g, places, least_squares.bounded(g, places, *limits.T))

    simplex = thresholds.SHAPE_STEP * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    search = minimize(
        left,
        np.zeros(2),
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": thresholds.SHAPES_TRIED},
    )
    best = of(np.asarray(search.x))
    bristles = tuple(best if each is coarse else each for each in family.bristles)
    return Family(joined(best), bristles, best)
