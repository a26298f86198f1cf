"""The bristle of the base fitted in range, exponent and damping as well, with all other parameters of the base.

Where the nominal friction is another law, the model does not stay on the measured path in its rolling zone, so that
columns around it tell little of a bristle's shape.  Around a model that has the bristle they do.

Its rolling zone grows by no more than those of the family's operators: what remembers a longer way is no rolling
friction, but the drag of a cable.
"""

import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from stagectl.gap.logs.session import Session
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.friction_family import critical, length, zone
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import Direction, TrackedModel, all_columns, residuals_of
from stagectl.gap.residuals.thresholds import LONGEST_SLIP
from stagectl.gap.selection import baseline_fit, bristle_members, refine, thresholds
from stagectl.gap.selection.baseline_fit import BaselineFit
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels.fields import put

SHAPES = ("shape_length", "shape_exponent", "shape_damping")  # logarithms; share of the bristle's critical damping
_MOST = math.log(thresholds.SHAPE_FACTOR)


def refit(session: Session, runs: Sequence[Run], nominal: TrackedModel, frozen: Sequence[str] = ()) -> BaselineFit:
    """`baseline_fit.refit`, and where it has chosen a bristle, that in its best shape."""
    fit = baseline_fit.refit(session, runs, nominal, frozen)
    if fit.bristle is None:
        return fit
    e = refine.evidence(runs, fit)
    model = _shaped(e, refine.start(e)).model
    shaped = fit._replace(model=model, after=residuals_of(model, runs, fit.noise))
    return _with_columns(shaped, runs, fit.bristle) if _bristled(model) else shaped


def beside_effects(e: Evidence, now: Fitted) -> Fitted:
    """`now` with its bristle in the best shape next to its effects, and these next to that.

    Chosen without the effects, the bristle has taken on a part of them, and must give that back: in its force, which
    moves at each step of `refine`, and in its shape.
    """
    if e.base.bristle is None or e.beside is not None or not (now.effects and _bristled(now.model)):
        return now
    after = _shaped(e, now)
    return after if after.residual_sum_of_squares < now.residual_sum_of_squares else now


def refined(e: Evidence, model: TrackedModel, effects: Sequence[EffectValues]) -> Fitted:
    """`effects` refined from `model` on, with the bristle in the best shape next to them: the base's where none is."""
    return beside_effects(e, refine.refine(e, model if effects else e.base.model, effects))


def _bristled(m: TrackedModel) -> bool:
    return m.stage.friction.bristle.coulomb > 0.0


def _shaped(e: Evidence, now: Fitted) -> Fitted:
    """`now` with its bristle in the best shape, all else next to it; as it is where no bristle is left in the model.

    The columns of bristle and effects turn, and are taken at each step; those of the base where the steps settle.
    """
    around, fresh = _around(e, now), True
    for _ in range(thresholds.SHAPE_STEPS):
        if not _bristled(now.model):
            break
        now, gain, _ = refine.step(around, now, _of_bristle(e, now.model))
        settled = gain < thresholds.SETTLED
        if settled and fresh:
            break
        around, fresh = (_around(e, now), True) if settled else (around, False)
    return now


def _around(e: Evidence, now: Fitted) -> Evidence:
    """`e` with the columns of the base next to the effects of `now`, but for those of its bristle."""
    e = refine.around_effects(e, now)
    kept = [name for name in e.base.products.names if not bristle_members.is_member(name)]
    return refine.with_products(e, gram_matrices.selected(e.base.products, kept), None)


def _of_bristle(e: Evidence, m: TrackedModel) -> refine.Shape:
    """The force of the bristle that is in the model, whose column turns with its shape, and that shape."""
    longest, change = LONGEST_SLIP * length(e.base.prior.nominal.stage.friction), thresholds.SHAPE_SENSITIVITY
    shape = [Direction(name, functools.partial(_bent, move={name: change}), change) for name in SHAPES]
    limits = dict(zip(SHAPES, _shape_limits(m, longest), strict=True))
    return refine.Shape([*refine.bristle(e), *shape], limits, _bent)


def _shape_limits(m: TrackedModel, longest: float) -> list[tuple[float, float]]:
    """How far a step may take the shape of a bristle whose rolling zone is `longest` (rad | m) at most."""
    p = m.stage.friction.bristle
    damped = p.damping / critical(p, m.stage.mechanics.inertia)
    longer = max(min(math.log(longest / zone(p)), _MOST), 0.0)
    return [(-_MOST, longer), (-_MOST, _MOST), (-damped, thresholds.DAMPING_STEP)]


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
