"""The base refit: how far the gap closes by the parameters that the model has already.

Inertia, viscous friction, bias, the time shift of the logged current, every weight of the rolling friction and, where
it helps, one bristle beside them, by Gauss-Newton on the tied model: what moves along the measured path is almost
linear in all of them, so that two or three steps do.  The friction law's *form* is a nuisance here: no effect may
be named for what another law of the family explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import friction_family, gram_matrices, least_squares, whitening
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.model_tracking import Lacking
from stagectl.gap.residuals.sensitivities import Direction, Model, all_columns, lacks, residuals_of
from stagectl.kernels import friction_bristle, stage
from stagectl.parallel import in_parallel

START = "start"  # of the friction, in each run its own
SPREAD = 0.3  # prior standard deviation of inertia and viscous friction, of their nominal values
STEPS = 3
HELPS = 0.02  # of the closable misfit: a bristle that takes less is left out


class Base(NamedTuple):
    """The nominal model refitted, and what it leaves."""

    model: Model
    noise: whitening.Whitener
    directions: tuple[Direction, ...]
    products: gram_matrices.Products  # of all these directions, START taken out
    before: list[list[Array]]  # whitened residual of each run and repeat, nominal model
    after: list[list[Array]]  # the same, refitted
    moved: dict[str, float]  # how far each parameter went, in its own unit
    deviation: dict[str, float]  # its standard deviation, robust against correlation within half strokes


def weight(k: int) -> str:
    """Name of the direction of one stop operator's weight."""
    return f"weight_{k}"


def directions(session: Session, model: Model, measured: bool) -> list[Direction]:
    """All that the base refit may move."""
    p, coulomb = model.stage, friction_family.size(model.stage)
    found = [
        Direction("inertia", lambda m: _mechanics(m, inertia=0.05 * p.mechanics.inertia), 0.05 * p.mechanics.inertia),
        Direction("bias", lambda m: _mechanics(m, bias=0.05 * coulomb), 0.05 * coulomb),
        Direction(START, lambda m: m, 1.0, load=0.5),
    ]
    damping = 0.1 * (p.mechanics.viscous or 1e-3 * p.mechanics.inertia / session.dt)
    found.append(Direction("viscous", lambda m: _mechanics(m, viscous=damping), damping))
    found += [_weight(k, 0.02 * coulomb) for k in range(len(p.friction.operators.weight))]
    if measured:
        step = 0.2 * session.dt
        found.append(Direction("time_shift", lambda m: m._replace(shift=m.shift + step), step))
    if p.friction.bristle.coulomb > 0.0:
        found += [_bristle_size(), _bristle_length()]
    return found


def _mechanics(m: Model, **added: float) -> Model:
    p = m.stage.mechanics
    changed = p._replace(**{name: getattr(p, name) + value for name, value in added.items()})
    return m._replace(stage=m.stage._replace(mechanics=changed))


def _friction(m: Model, **parts: Any) -> Model:
    return m._replace(stage=m.stage._replace(friction=m.stage.friction._replace(**parts)))


def with_weight(m: Model, k: int, added: float) -> Model:
    """The model with one stop operator stronger by `added` (N m | N)."""
    p = m.stage.friction.operators
    changed = p.weight.copy()
    changed[k] = max(changed[k] + added, 0.0)
    return _friction(m, operators=p._replace(weight=changed))


def _weight(k: int, size: float) -> Direction:
    return Direction(weight(k), lambda m: with_weight(m, k, size), size)


def _bristle_size() -> Direction:
    return Direction("bristle_size", lambda m: _friction(m, bristle=_grown(m.stage.friction.bristle, 1.1, 1.0)), 0.1)


def _bristle_length() -> Direction:
    return Direction("bristle_length", lambda m: _friction(m, bristle=_grown(m.stage.friction.bristle, 1.0, 1.2)), 0.2)


def _grown(p: friction_bristle.Bristle, size: float, length: float) -> friction_bristle.Bristle:
    return p._replace(coulomb=p.coulomb * size, stiffness=p.stiffness * size / length)


def members(nominal: stage.Stage) -> list[Direction]:
    """Bristles that may stand beside the stop operators; none where the nominal law is a bristle itself."""
    if nominal.friction.bristle.coulomb > 0.0:
        return []
    size = 0.1 * friction_family.size(nominal)
    return [_member(f"bristle_{k}", p, size) for k, p in enumerate(friction_family.bristles(nominal))]


def _member(name: str, p: friction_bristle.Bristle, size: float) -> Direction:
    one = p._replace(coulomb=size, stiffness=p.stiffness * size / p.coulomb)
    return Direction(name, lambda m: _friction(m, bristle=one), size)


def noise_of(model: Model, runs: Sequence[Run], dt: float) -> whitening.Whitener:
    """The whitening filter, from what the repeats of each run differ by.

    Where no experiment was repeated, from what rounding to encoder counts and the model's own residual at the upper
    end of the band tell.
    """
    repeated = [run for run in runs if len(run.paths) > 1]
    each = in_parallel(lambda run: [lacks(model, path) for path in run.paths], repeated or runs)
    differences = [one for all_ in each for one in (_deviations(all_) if repeated else [_roughness(all_[0])])]
    return whitening.whitener(differences, _least(runs, model), dt)


def _least(runs: Sequence[Run], model: Model) -> tuple[float, float]:
    """A ten-thousandth of what drives the axis: effort (N m | N) and current (A)."""
    current = np.concatenate([run.mean.rows[:, 0] for run in runs])
    rms = 1e-4 * float(np.sqrt(np.nanmean(current * current)))
    measured = bool(np.isfinite(runs[0].mean.rows[:, 2]).all())
    return rms * model.stage.motor.force_constant, rms if measured else 0.0


def _deviations(each: list[Lacking]) -> list[Lacking]:
    scale = np.sqrt(len(each) / (len(each) - 1))
    effort, current = np.mean([x.effort for x in each], axis=0), np.mean([x.current for x in each], axis=0)
    return [Lacking(scale * (x.effort - effort), scale * (x.current - current)) for x in each]


def _roughness(p: Lacking) -> Lacking:
    """What is left of a signal by third differences: noise, as nothing else changes from sample to sample."""
    return Lacking(*(np.diff(one, 3, prepend=np.zeros(3)) / np.sqrt(20.0) for one in p))


def refit(session: Session, runs: Sequence[Run], nominal: Model, frozen: Sequence[str] = ()) -> Base:
    """Move the parameters that the model has towards the data; those of the names `frozen` stay."""
    measured = bool(np.isfinite(runs[0].mean.rows[:, 2]).all())
    noise = noise_of(nominal, runs, session.dt)
    model = nominal._replace(stage=nominal.stage._replace(friction=friction_family.spread(nominal.stage.friction)))
    before = residuals_of(nominal, runs, noise)
    free = [one for one in directions(session, model, measured) if one.name not in frozen]
    beside = members(nominal.stage)
    known = gram_matrices.products(runs, all_columns(model, runs, [*free, *beside], noise), START)
    left, total = before, dict.fromkeys((one.name for one in free), 0.0)
    chosen: Direction | None = None
    for _ in range(STEPS):
        g = gram_matrices.dealt(known, left)
        if chosen is None:
            chosen = _best_member(model, g, free, beside)
        move = _bounded_step(model, g, free, chosen, total)
        model = moved(model, move, chosen)
        total = {name: total.get(name, 0.0) + step for name, step in move.items()}
        left = residuals_of(model, runs, noise)
    g = gram_matrices.grams(known, left)
    deviation = robust(g, [one.name for one in free if one.name != START])
    return Base(model, noise, (*free, *beside), known, before, left, total, deviation)


def _best_member(
    model: Model, g: gram_matrices.Grams, free: Sequence[Direction], beside: list[Direction]
) -> Direction | None:
    summed, closable = g.both.sum(axis=0), float(g.both[:, -1, -1].sum() - g.floor.sum())
    own = g.of([one.name for one in free if one.name != START])
    alone = least_squares.fit(summed, own).misfit
    fits = [(least_squares.fit(summed, [*own, *g.of([one.name])]), one) for one in beside]
    good = [(one.misfit, member) for one, member in fits if one.amplitude[-1] > 0.0]
    best = min(good, key=lambda pair: pair[0], default=None)
    return best[1] if best is not None and alone - best[0] > HELPS * closable else None


def _bounded_step(
    model: Model, g: gram_matrices.Grams, free: Sequence[Direction], chosen: Direction | None, total: dict[str, float]
) -> dict[str, float]:
    """One Gauss-Newton step within what is physical: no negative weight, inertia or damping."""
    names = [one.name for one in free if one.name != START] + ([chosen.name] if chosen is not None else [])
    low = np.array([lowest(model, name) for name in names])
    step = least_squares.bounded(g.both.sum(axis=0), g.of(names), low, np.full(len(names), np.inf))
    return dict(zip(names, step.tolist(), strict=True))


def lowest(model: Model, name: str) -> float:
    """How far down a parameter may go: no negative weight, inertia or damping."""
    p = model.stage
    if name.startswith("weight_"):
        return -float(p.friction.operators.weight[int(name.removeprefix("weight_"))])
    if name in ("inertia", "viscous"):
        return -0.9 * float(getattr(p.mechanics, name))
    if is_member(name):
        return -p.friction.bristle.coulomb
    return -0.8 if name.startswith("bristle_") else -np.inf


def is_member(name: str) -> bool:
    """Whether a direction is a bristle of the family, of which one at most is in the model."""
    return name.startswith("bristle_") and name not in ("bristle_size", "bristle_length")


def moved(model: Model, move: dict[str, float], member: Direction | None) -> Model:
    """`model` with each parameter moved by its step."""
    p = model.stage
    mechanics = p.mechanics._replace(
        inertia=p.mechanics.inertia + move.get("inertia", 0.0),
        viscous=max(p.mechanics.viscous + move.get("viscous", 0.0), 0.0),
        bias=p.mechanics.bias + move.get("bias", 0.0),
    )
    operators = p.friction.operators
    weights = np.array([max(w + move[weight(k)], 0.0) for k, w in enumerate(operators.weight)])
    bristle = _grown(
        p.friction.bristle, 1.0 + move.get("bristle_size", 0.0), max(1.0 + move.get("bristle_length", 0.0), 0.2)
    )
    if member is not None:
        bristle = _added(bristle, member, model, move[member.name])
    changed = p.friction._replace(operators=operators._replace(weight=weights), bristle=bristle)
    stage_ = p._replace(mechanics=mechanics, friction=changed)
    return model._replace(stage=stage_, shift=model.shift + move.get("time_shift", 0.0))


def _added(
    bristle: friction_bristle.Bristle, member: Direction, model: Model, force: float
) -> friction_bristle.Bristle:
    one = member.change(model).stage.friction.bristle
    coulomb = max(bristle.coulomb + force, 0.0)
    return one._replace(coulomb=coulomb, stiffness=one.stiffness * coulomb / one.coulomb) if coulomb else bristle


def robust(g: gram_matrices.Grams, names: Sequence[str]) -> dict[str, float]:
    """Standard deviations by the sandwich over half strokes: what is left is no white noise."""
    variances = np.diag(covariance(g, names))
    return dict(zip(names, np.sqrt(np.maximum(variances, 0.0)).tolist(), strict=True))


def covariance(g: gram_matrices.Grams, names: Sequence[str]) -> Array:
    """Covariance (k, k) of the amplitudes of `names`, by the same sandwich."""
    places, summed = g.of(names), g.both.sum(axis=0)
    a = summed[np.ix_(places, places)]
    inverse = least_squares.inverse(a)
    best = inverse @ summed[places, -1]
    scores = np.array([one[places, -1] - one[np.ix_(places, places)] @ best for one in g.both])
    found: Array = inverse @ (scores.T @ scores) @ inverse
    return found
