"""The bristle of the base fitted in range, exponent and damping as well, with all other parameters of the base.

Where the nominal friction is another law, the model does not stay on the measured path in its rolling zone, so that
columns around it tell little of a bristle's shape.  Around a model that has the bristle they do.

Its rolling zone grows by no more than those of the family's operators: what remembers a longer way is no rolling
friction, but the drag of a cable.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.friction_family import critical, length, zone
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import (
    Direction,
    TrackedModel,
    all_columns,
    deviations,
    residuals_about,
    residuals_of,
)
from stagectl.gap.residuals.thresholds import LONGEST_SLIP
from stagectl.gap.selection import baseline_fit, bristle_members, priors, refine, thresholds
from stagectl.gap.selection.baseline_fit import BaselineFit
from stagectl.gap.selection.candidates import EffectValues, beside, equipped
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels.fields import put

SHAPES = ("shape_length", "shape_exponent", "shape_damping")  # logarithms; share of the bristle's critical damping
_MOST = math.log(thresholds.SHAPE_FACTOR)


class _Data(NamedTuple):
    """What a bristle is fitted to, and next to which effects."""

    runs: Sequence[Run]
    member: Direction  # the bristle
    effects: Sequence[EffectValues]
    residuals: Callable[[TrackedModel], list[list[Array]]]  # of a model of the base, with the effects


def refit(session: Session, runs: Sequence[Run], nominal: TrackedModel, frozen: Sequence[str] = ()) -> BaselineFit:
    """`baseline_fit.refit`, and where it has chosen a bristle, that in its best shape."""
    fit = baseline_fit.refit(session, runs, nominal, frozen)
    if fit.bristle is None:
        return fit
    apart = deviations(fit.model, runs, fit.noise, fit.after)
    data = _Data(runs, fit.bristle, (), lambda m: residuals_about(m, runs, fit.noise, apart))
    shaped = _shaped(fit, data)
    shaped = shaped._replace(after=residuals_of(shaped.model, runs, fit.noise))
    return _with_columns(shaped, runs, fit.bristle) if _bristled(shaped.model) else shaped


def beside_effects(e: Evidence, now: Fitted) -> Fitted:
    """`now` with its bristle in the best shape next to its effects, and these next to that.

    Chosen without the effects, the bristle has taken on a part of them, and must give that back: in its force, which
    moves at each step of `refine`, and in its shape.
    """
    if e.base.bristle is None or e.beside is not None or not (now.effects and _bristled(now.model)):
        return now
    data = _Data(
        e.runs,
        e.base.bristle,
        now.effects,
        lambda m: refine.residuals(e, m, now.effects),
    )
    shaped = _shaped(e.base._replace(model=now.model, after=now.residuals), data)
    if shaped.model is now.model:
        return now
    after = refine.refine(e, shaped.model, now.effects)
    return after if after.residual_sum_of_squares < now.residual_sum_of_squares else now


def refined(e: Evidence, model: TrackedModel, effects: Sequence[EffectValues]) -> Fitted:
    """`effects` refined from `model` on, with the bristle in the best shape next to them: the base's where none is."""
    return beside_effects(e, refine.refine(e, model if effects else e.base.model, effects))


def _bristled(m: TrackedModel) -> bool:
    return m.stage.friction.bristle.coulomb > 0.0


def _shaped(fit: BaselineFit, data: _Data) -> BaselineFit:
    """`fit` with its bristle in the best shape; the same where no bristle is left in the model."""
    for _ in range(thresholds.SHAPE_STEPS):
        if not _bristled(fit.model):
            break
        fit, gain = _stepped(fit, data)
        if gain < thresholds.SETTLED:
            break
    return fit


def _stepped(fit: BaselineFit, data: _Data) -> tuple[BaselineFit, float]:
    """One Gauss-Newton step, or the share of it that lowers the cost, and by how much; else the same fit."""
    free = [one for one in fit.directions if not bristle_members.is_member(one.name)]
    names = [*baseline_fit.parameter_names(free), data.member.name]
    moving = [beside(one, fit.model, data.effects) for one in (*free, *_of_bristle(fit, data.member))]
    columns = all_columns(equipped(fit.model, data.effects), data.runs, moving, fit.noise)
    g = gram_matrices.fold_sums(gram_matrices.products(data.runs, columns, baseline_fit.START), fit.after)
    weight = priors.temper(g, names, fit.prior)
    shape = _shape_limits(fit.model, LONGEST_SLIP * length(fit.prior.nominal.stage.friction))
    limits = np.concatenate([fit.prior.limits(fit.model, names), shape])
    step = priors.bounded_step(g, [*names, *SHAPES], limits, fit.prior.informed(fit.model, names), weight).move

    def cost(fit: BaselineFit) -> float:
        return weight * baseline_fit.sum_of_squares(data.runs, fit.after) + fit.prior.cost(fit.model, names)

    def after(move: Mapping[str, float]) -> BaselineFit:
        model = _bent(baseline_fit.moved(fit.model, move, data.member, fit.prior.dt), move)
        return fit._replace(model=model, after=data.residuals(model))

    return priors.shortened(step, after, cost, fit)


def _of_bristle(fit: BaselineFit, member: Direction) -> list[Direction]:
    """The directions of the force of the bristle that is in the model, and of its shape."""
    force, change = {member.name: member.size}, thresholds.SHAPE_SENSITIVITY
    return [
        member._replace(change=lambda m: baseline_fit.moved(m, force, member, fit.prior.dt)),
        *(Direction(name, functools.partial(_bent, move={name: change}), change) for name in SHAPES),
    ]


def _shape_limits(m: TrackedModel, longest: float) -> Array:
    """(3, 2) how far a step may take the shape of a bristle whose rolling zone is `longest` (rad | m) at most."""
    p = m.stage.friction.bristle
    damped = p.damping / critical(p, m.stage.mechanics.inertia)
    longer = max(min(math.log(longest / zone(p)), _MOST), 0.0)
    return np.array([[-_MOST, longer], [-_MOST, _MOST], [-damped, thresholds.DAMPING_STEP]])


def _bent(m: TrackedModel, move: Mapping[str, float]) -> TrackedModel:
    """`m` with its bristle in another shape, as strong as before; its rolling zone as long with any exponent."""
    p = m.stage.friction.bristle
    if not p.coulomb:
        return m
    longer, exponent, damping = (move.get(name, 0.0) for name in SHAPES)
    shape = p._replace(
        exponent=float(np.clip(p.exponent * math.exp(exponent), *thresholds.EXPONENTS)),
        damping=max(p.damping + damping * critical(p, m.stage.mechanics.inertia), 0.0),
    )
    shape = shape._replace(stiffness=p.stiffness * zone(shape) / (zone(p) * math.exp(longer)))
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
