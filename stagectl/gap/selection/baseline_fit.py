"""The baseline fit: how far the gap closes by parameters that the nominal model has already.

Inertia, viscous friction, bias, the time shift of the logged current, every weight of the rolling friction and, where
it helps, one bristle next to them are fitted by Gauss-Newton on the tracked model.  The *form* of the friction law is
a nuisance: no effect may be named for what another law of the family explains.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.stage_changes import delayed
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import friction_family, gram_matrices
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.model_tracking import MeasuredPath, ModelResidual
from stagectl.gap.residuals.sensitivities import (
    Direction,
    TrackedModel,
    all_columns,
    deviations,
    model_residual,
    residuals_about,
    residuals_of,
)
from stagectl.gap.residuals.thresholds import KEPT
from stagectl.gap.residuals.whitening import Whitener, single_noise, whitener
from stagectl.gap.selection import priors, thresholds
from stagectl.gap.selection.bristle_members import BRISTLE, Family, is_member, members, with_best
from stagectl.gap.selection.priors import Prior
from stagectl.gap.selection.start_model import in_time, with_friction
from stagectl.kernels import friction_bristle, stage
from stagectl.kernels.fields import get, put
from stagectl.parallel import in_parallel

DELAY = "dead_time"  # the whole delay of the drive, from the effort that a command needs against its motion
START = "start"  # the friction's state at the beginning, with an amplitude of its own in each run


class BaselineFit(NamedTuple):
    """The nominal model refitted, and its residuals."""

    model: TrackedModel
    noise: Whitener
    directions: tuple[Direction, ...]
    products: gram_matrices.Products  # of all these directions, START taken out
    before: list[list[Array]]  # whitened residual of each run and repeat, nominal model
    after: list[list[Array]]  # the same, refitted
    prior: Prior  # what was known before
    bristle: Direction | None  # of the family, that was chosen for the model; one of `directions`


def weight_name(k: int) -> str:
    """Name of the direction of one stop operator's weight."""
    return f"weight_{k}"


def parameter_names(moving: Iterable[Direction]) -> list[str]:
    """The directions that are parameters of the model: neither the start nor a bristle of the family."""
    names = [direction.name for direction in moving]
    return [name for name in names if name != START and not is_member(name)]


def directions(session: Session, model: TrackedModel, measured: bool) -> list[Direction]:
    """All that the baseline fit may move: where a current was logged its time shift, else the drive's delay.

    `measured`: next to a command.
    """
    p, coulomb = model.stage, friction_family.size(model.stage)
    viscous = thresholds.VISCOUS_CHANGE * viscous_unit(p, session.dt)
    moving = [
        _mechanics("inertia", thresholds.INERTIA_CHANGE * p.mechanics.inertia),
        _mechanics("bias", thresholds.BIAS_CHANGE * coulomb),
        Direction(START, lambda m: m, 1.0, load=thresholds.START_LOAD),
        _mechanics("viscous", viscous),
        *(_weight(k, thresholds.WEIGHT_CHANGE * coulomb) for k in range(len(p.friction.operators.weight))),
    ]
    later = thresholds.SHIFT_CHANGE * session.dt
    if measured or not any(log.commanded for log in session.logs):
        moving.append(Direction("time_shift", lambda m: m._replace(shift=m.shift + later), later))
    else:
        moving.append(Direction(DELAY, lambda m: m._replace(stage=delayed(m.stage, later, session.dt)), later))
    if p.friction.bristle.coulomb > 0.0:
        moving += [
            _bristle("bristle_size", 1.0 + thresholds.BRISTLE_CHANGE, 1.0, thresholds.BRISTLE_CHANGE),
            _bristle("bristle_length", 1.0, 1.0 + thresholds.LENGTH_CHANGE, thresholds.LENGTH_CHANGE),
        ]
    return moving


def viscous_unit(p: stage.Stage, dt: float) -> float:
    """Unit of the viscous friction: the model's own, or a small share of inertia over control period."""
    return p.mechanics.viscous or thresholds.NATURAL_DAMPING * p.mechanics.inertia / dt


def _mechanics(name: str, added: float) -> Direction:
    place = f"stage.mechanics.{name}"
    return Direction(name, lambda m: put(m, place, get(m, place) + added), added)


def _weight(k: int, added: float) -> Direction:
    """One stop operator, stronger by `added` (N m | N)."""

    def change(m: TrackedModel) -> TrackedModel:
        changed = m.stage.friction.operators.weight.copy()
        changed[k] = max(changed[k] + added, 0.0)
        return put(m, "stage.friction.operators.weight", changed)

    return Direction(weight_name(k), change, added)


def _bristle(name: str, size: float, length: float, change: float) -> Direction:
    """The nominal bristle by a factor on its size or its length."""
    return Direction(
        name,
        lambda m: put(m, BRISTLE, friction_bristle.scaled(m.stage.friction.bristle, size, length)),
        change,
    )


def noise_of(model: TrackedModel, runs: Sequence[Run], dt: float) -> Whitener:
    """The whitening filter, from the differences between the repeats of each run.

    Where no experiment was repeated, noise is added to each column of the logs, as large as the differences between
    neighbouring samples are: through the model it is what two repeats would differ by.
    """
    repeated = [run for run in runs if len(run.paths) > 1]
    groups = [(run, run.paths) for run in repeated] or [(run, _pretended_repeats(run, model)) for run in runs]
    noise = in_parallel(lambda group: _deviations(model, *group), groups)
    return whitener(list(itertools.chain.from_iterable(noise)), _least_noise(runs, model), dt)


def _pretended_repeats(run: Run, model: TrackedModel) -> tuple[MeasuredPath, ...]:
    """The path of a run that was not repeated, and the same with as much noise again as each of its columns shows."""
    rows = run.mean.rows
    sizes = np.array([_roughness(column) for column in rows.T])
    sizes[1] = max(sizes[1], model.stage.encoder.step / np.sqrt(12.0))  # of rounding to whole steps
    noise = np.random.default_rng(thresholds.NOISE_SEED).standard_normal(rows.shape) * sizes
    return (run.mean, run.mean._replace(rows=rows + np.sqrt(2.0) * noise))


def is_measured(runs: Sequence[Run]) -> bool:
    """Whether the logs hold the current next to the command."""
    return bool(np.isfinite(runs[0].mean.rows[:, 2]).all())


def _least_noise(runs: Sequence[Run], model: TrackedModel) -> tuple[float, float]:
    current = np.concatenate([run.mean.rows[:, 0] for run in runs])
    rms = thresholds.LEAST_NOISE * float(np.sqrt(np.nanmean(current * current)))
    return rms * model.stage.motor.force_constant, rms if is_measured(runs) else 0.0


def _deviations(model: TrackedModel, run: Run, paths: Sequence[MeasuredPath]) -> list[ModelResidual]:
    """What the repeats `paths` differ by, as noise of a single one, from the first row that counts to the last.

    Before that they differ by how well the start of each is known.
    """
    counted = np.flatnonzero(run.weight)
    rows = slice(KEPT * counted[0], KEPT * counted[-1] + 1) if len(counted) > 1 else slice(None)
    repeats = [model_residual(model, path) for path in paths]
    clock = [path.start for path in paths]
    effort, current = (single_noise([one[rows] for one in signals], clock) for signals in zip(*repeats, strict=True))
    return [ModelResidual(*pair) for pair in zip(effort, current, strict=True)]


def _roughness(signal: Array) -> float:
    """Standard deviation of white noise, from third differences: nothing else changes from sample to sample."""
    return float(np.sqrt(np.mean(np.diff(signal, 3) ** 2) / thresholds.DIFFERENCED_NOISE))


def refit(session: Session, runs: Sequence[Run], nominal: TrackedModel, frozen: Sequence[str] = ()) -> BaselineFit:
    """Fit the parameters that the model has to the data, except those whose names are `frozen`."""
    noise = noise_of(nominal, runs, session.dt)
    model = put(nominal, "stage.friction", friction_family.spread(nominal.stage.friction))
    if is_measured(runs) and "time_shift" not in frozen:
        model = in_time(model, runs, noise, session.dt)
    prior = priors.prior_of(model, runs, session.dt)
    model = with_friction(model, runs, noise, prior.effort)
    before = residuals_of(nominal, runs, noise)
    moving = directions(session, model, is_measured(runs))
    free = [direction for direction in moving if direction.name not in frozen]
    bristles, own = members(nominal.stage), parameter_names(free)
    known = gram_matrices.products(runs, all_columns(model, runs, [*free, *bristles], noise), START)
    state, family = _State(model, residuals_of(model, runs, noise)), Family(known, tuple(bristles))
    data = _Data(runs, noise, deviations(model, runs, noise, state.residuals))
    prior = priors.believed(gram_matrices.fold_sums(known, state.residuals), own, prior)
    for _ in range(thresholds.BASELINE_STEPS):
        if family.chosen is None:
            family = with_best(family, state.residuals, own)
        state, gain = _stepped(prior, data, state, family, own)
        if not gain:
            break
    moving_all, after = (*free, *family.bristles), residuals_of(state.model, runs, noise)
    return BaselineFit(state.model, noise, moving_all, family.products, before, after, prior, family.chosen)


class _Data(NamedTuple):
    runs: Sequence[Run]
    noise: Whitener
    apart: list[list[Array]]  # what repeats depart by from the mean path


class _State(NamedTuple):
    model: TrackedModel
    residuals: list[list[Array]]


def _stepped(prior: Prior, data: _Data, now: _State, family: Family, own: Sequence[str]) -> tuple[_State, float]:
    """One Gauss-Newton step, or the share of it that lowers the cost, and by how much; `now` where none does."""
    g, names = gram_matrices.fold_sums(family.products, now.residuals), [*own, *family.names]
    weight = priors.temper(g, names, prior)
    limits, informed = prior.limits(now.model, names), prior.informed(now.model, names)

    def moved_by(move: Mapping[str, float]) -> _State:
        model = moved(now.model, move, family.chosen, prior.dt)
        return _State(model, residuals_about(model, *data))

    def cost(state: _State) -> float:
        return weight * sum_of_squares(data.runs, state.residuals) + prior.cost(state.model, names)

    step = priors.bounded_step(g, names, limits, informed, weight).move
    return priors.shortened(step, moved_by, cost, now)


def sum_of_squares(runs: Sequence[Run], residuals: list[list[Array]]) -> float:
    """Sum of squares over all samples that count; not finite where a simulation has diverged."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(
            sum(
                np.sum((residual * run.weight[:, None]) ** 2)
                for run, repeats in zip(runs, residuals, strict=True)
                for residual in repeats
            )
        )


def moved(model: TrackedModel, move: Mapping[str, float], member: Direction | None, dt: float) -> TrackedModel:
    """`model` with each parameter moved by its step, and the bristle `member` of the family, if there is one.

    `dt` is the control period (s).
    """
    p = model.stage
    mechanics = p.mechanics._replace(
        inertia=p.mechanics.inertia + move.get("inertia", 0.0),
        viscous=max(p.mechanics.viscous + move.get("viscous", 0.0), 0.0),
        bias=p.mechanics.bias + move.get("bias", 0.0),
    )
    operators = p.friction.operators
    weights = np.array([max(weight + move.get(weight_name(k), 0.0), 0.0) for k, weight in enumerate(operators.weight)])
    length = max(1.0 + move.get("bristle_length", 0.0), thresholds.SHORTEST_BRISTLE)
    bristle = friction_bristle.scaled(p.friction.bristle, 1.0 + move.get("bristle_size", 0.0), length)
    if member is not None:
        bristle = _with_force(bristle, member.change(model).stage.friction.bristle, move.get(member.name, 0.0))
    changed = p.friction._replace(operators=operators._replace(weight=weights), bristle=bristle)
    moved_stage = p._replace(mechanics=mechanics, friction=changed)
    if move.get(DELAY):
        moved_stage = delayed(moved_stage, move[DELAY], dt)
    return model._replace(stage=moved_stage, shift=model.shift + move.get("time_shift", 0.0))


def _with_force(
    bristle: friction_bristle.Bristle, member: friction_bristle.Bristle, force: float
) -> friction_bristle.Bristle:
    """The bristle `member` with the force of `bristle` and `force` (N m | N) more; none where nothing is left."""
    coulomb = max(bristle.coulomb + force, 0.0)
    if not coulomb:
        return friction_bristle.NEUTRAL
    shape = bristle if bristle.coulomb else member
    return friction_bristle.scaled(shape, coulomb / shape.coulomb)
