"""The bristle of the friction family that joins the stop operators: the best of a coarse grid.

Along a measured path the friction is linear in the weights of the operators and in the force of a bristle, for one
shape of the bristle.  `bristle_shape` then fits its shape: where the true law is one bristle, the operators come out
almost empty.
"""

from collections.abc import Sequence
from typing import NamedTuple

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import friction_family, gram_matrices, least_squares
from stagectl.gap.residuals.sensitivities import Direction, TrackedModel
from stagectl.gap.selection import thresholds
from stagectl.gap.selection.priors import MEMBER
from stagectl.kernels import friction_bristle, stage
from stagectl.kernels.fields import put

BRISTLE = "stage.friction.bristle"  # its place in a tracked model


class Family(NamedTuple):
    """The columns of a refit, with the bristles among them."""

    products: gram_matrices.Products
    bristles: tuple[Direction, ...]
    chosen: Direction | None = None  # the bristle that is in the model

    @property
    def names(self) -> list[str]:
        """The column of the chosen bristle, if there is one."""
        return [] if self.chosen is None else [self.chosen.name]


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
    bristle = friction_bristle.scaled(p, size / p.coulomb)
    return Direction(name, lambda m: put(m, BRISTLE, bristle), size)


def shaped_as(m: TrackedModel, other: TrackedModel) -> TrackedModel:
    """`m` with its bristle in the shape of that of `other`, as strong as before; unchanged where one has none."""
    own, shape = (each.stage.friction.bristle for each in (m, other))
    if not (own.coulomb and shape.coulomb):
        return m
    return put(m, BRISTLE, friction_bristle.scaled(shape, own.coulomb / shape.coulomb))


def with_best(family: Family, residuals: list[list[Array]], names: Sequence[str]) -> Family:
    """The `family` with the bristle chosen that explains most of `residuals` next to the parameters `names`."""
    g = gram_matrices.fold_sums(family.products, residuals)
    return family._replace(chosen=_best(g, names, family.bristles))


def _best(g: gram_matrices.Grams, names: Sequence[str], bristles: Sequence[Direction]) -> Direction | None:
    """The bristle that explains most next to the parameters `names`; None where none explains enough."""
    summed, closable = g.both.sum(axis=0), float(g.both[:, -1, -1].sum() - g.floor.sum())
    own = g.places(names)
    without = least_squares.fit(summed, own).residual_sum_of_squares
    fits = [(least_squares.fit(summed, [*own, *g.places([bristle.name])]), bristle) for bristle in bristles]
    possible = [(fit.residual_sum_of_squares, bristle) for fit, bristle in fits if fit.amplitude[-1] > 0.0]
    left, best = min(possible, key=lambda pair: pair[0], default=(without, None))
    return best if without - left > thresholds.BRISTLE_GAIN * closable else None
