"""The bristle of the base fitted in range, exponent and damping as well, with all other parameters of the base.

Where the nominal friction is another law, the model does not stay on the measured path in its rolling zone, so that
columns around it tell little of a bristle's shape.  Around a model that has the bristle they do.
"""

import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.friction_family import critical
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import (
    Direction,
    TrackedModel,
    all_columns,
    deviations,
    residuals_about,
    residuals_of,
)
from stagectl.gap.selection import baseline_fit, bristle_members, priors, thresholds
from stagectl.gap.selection.baseline_fit import BaselineFit
from stagectl.kernels.fields import put

SHAPES = ("shape_length", "shape_exponent", "shape_damping")  # logarithms; share of the bristle's critical damping
_MOST = math.log(thresholds.SHAPE_FACTOR)


def refit(session: Session, runs: Sequence[Run], nominal: TrackedModel, frozen: Sequence[str] = ()) -> BaselineFit:
    """`baseline_fit.refit`, and where it has chosen a bristle, that in its best shape."""
    fit = baseline_fit.refit(session, runs, nominal, frozen)
    return fit if fit.bristle is None else _shaped(fit, runs, fit.bristle)


def _shaped(fit: BaselineFit, runs: Sequence[Run], member: Direction) -> BaselineFit:
    """`fit` with its bristle in the best shape; the same where no bristle is left in the model."""
    apart = deviations(fit.model, runs, fit.noise, fit.after)
    for _ in range(thresholds.SHAPE_STEPS):
        if not fit.model.stage.friction.bristle.coulomb:
            break
        fit, gain = _stepped(fit, runs, member, apart)
        if gain < thresholds.SETTLED:
            break
    fit = fit._replace(after=residuals_of(fit.model, runs, fit.noise))
    return _with_columns(fit, runs, member) if fit.model.stage.friction.bristle.coulomb else fit


def _stepped(
    fit: BaselineFit, runs: Sequence[Run], member: Direction, apart: list[list[Array]]
) -> tuple[BaselineFit, float]:
    """One Gauss-Newton step, or the share of it that lowers the cost, and by how much; else the same fit."""
    free = [one for one in fit.directions if not bristle_members.is_member(one.name)]
    names = [*baseline_fit.parameter_names(free), member.name]
    columns = all_columns(fit.model, runs, [*free, *_of_bristle(fit, member)], fit.noise)
    g = gram_matrices.fold_sums(gram_matrices.products(runs, columns, baseline_fit.START), fit.after)
    weight = priors.temper(g, names, fit.prior)
    limits = np.concatenate([fit.prior.limits(fit.model, names), _shape_limits(fit.model)])
    step = priors.bounded_step(g, [*names, *SHAPES], limits, fit.prior.informed(fit.model, names), weight).move

    def cost(fit: BaselineFit) -> float:
        return weight * baseline_fit.sum_of_squares(runs, fit.after) + fit.prior.cost(fit.model, names)

    def after(move: Mapping[str, float]) -> BaselineFit:
        model = _bent(baseline_fit.moved(fit.model, move, member, fit.prior.dt), move)
        return fit._replace(model=model, after=residuals_about(model, runs, fit.noise, apart))

    return priors.shortened(step, after, cost, fit)


def _of_bristle(fit: BaselineFit, member: Direction) -> list[Direction]:
    """The directions of the force of the bristle that is in the model, and of its shape."""
    force, change = {member.name: member.size}, thresholds.SHAPE_SENSITIVITY
    return [
        member._replace(change=lambda m: baseline_fit.moved(m, force, member, fit.prior.dt)),
        *(Direction(name, functools.partial(_bent, move={name: change}), change) for name in SHAPES),
    ]


def _shape_limits(m: TrackedModel) -> Array:
    """(3, 2) how far a step may take the shape."""
    damped = m.stage.friction.bristle.damping / critical(m.stage.friction.bristle, m.stage.mechanics.inertia)
    return np.array([[-_MOST, _MOST], [-_MOST, _MOST], [-damped, thresholds.DAMPING_STEP]])


def _bent(m: TrackedModel, move: Mapping[str, float]) -> TrackedModel:
    """`m` with its bristle in another shape, as strong as before."""
    p = m.stage.friction.bristle
    length, exponent, damping = (move.get(name, 0.0) for name in SHAPES)
    shape = p._replace(
        stiffness=p.stiffness / math.exp(length),
        exponent=float(np.clip(p.exponent * math.exp(exponent), *thresholds.EXPONENTS)),
        damping=max(p.damping + damping * critical(p, m.stage.mechanics.inertia), 0.0),
    )
    return put(m, bristle_members.BRISTLE, shape)


def _with_columns(fit: BaselineFit, runs: Sequence[Run], member: Direction) -> BaselineFit:
    """`fit` with the column of its bristle's shape in the place of the one that was chosen first."""
    nominal, shape = fit.prior.nominal, fit.model.stage.friction.bristle
    new = bristle_members.member(member.name, shape, member.size)
    names = [name for name in fit.products.names if name != member.name]
    kept = gram_matrices.selected(fit.products, names)
    products = gram_matrices.with_columns(kept, all_columns(nominal, runs, [new], fit.noise))
    directions = tuple(new if one is member else one for one in fit.directions)
    return fit._replace(products=products, directions=directions, bristle=new)
