"""How a change of the model changes its residual, by simulating again: one column for each direction of change.

No effect has a formula here.  The stage model with and without it tracks the same path, and the difference is its
column, with delays, sampling and estimator included.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import model_tracking
from stagectl.gap.residuals.half_strokes import Run, without_drift_at_rest
from stagectl.gap.residuals.model_tracking import MeasuredPath, ModelResidual
from stagectl.gap.residuals.thresholds import DIVERGED, KEPT, SENSITIVITY_SUBSTEPS, SUBSTEPS
from stagectl.gap.residuals.whitening import Whitener, whitened
from stagectl.kernels import feedback, tracked_model
from stagectl.kernels.fields import put
from stagectl.kernels.stage import Stage
from stagectl.parallel import in_parallel


class TrackedModel(NamedTuple):
    """The stage model that is compared with the logs, and how the columns of a log lie in time."""

    stage: Stage
    unit_tracker: feedback.Pid  # for a stage of 1 m/s^2 per A | 1 rad/s^2 per A
    shift: float = 0.0  # s by which the logged current is late against the position

    @property
    def tracker(self) -> feedback.Pid:
        """The tracker of this model: with its inertia, all models answer to a missing effort alike.

        Gains of another inertia would filter the effort of each model otherwise, and let one go unstable that is five
        times as light.
        """
        return feedback.scaled(self.unit_tracker, self.stage.mechanics.inertia / self.stage.motor.force_constant)


class Direction(NamedTuple):
    """A change of the model."""

    name: str
    change: Callable[[TrackedModel], TrackedModel]
    size: float  # of the change; the column is per unit of it
    factor: Callable[[Array], Array] | None = None  # of the session clock (n,) s: on the column of `change`
    load: float = 0.0  # share of the friction's limit with which the runs begin


def model_of(nominal: Stage, dt: float) -> TrackedModel:
    """The `nominal` model with its tracker for rows every `dt` (s): that of all models in its place."""
    tracker = model_tracking.tracker(nominal, dt)
    return TrackedModel(nominal, feedback.scaled(tracker, nominal.motor.force_constant / nominal.mechanics.inertia))


def model_residual(p: TrackedModel, path: MeasuredPath, substeps: int = SUBSTEPS, load: float = 0.0) -> ModelResidual:
    """The residual along `path`, with the logged current at the instants at which it was taken."""
    if p.shift:
        p, path = _current_in_time(p, path)
    return model_tracking.tracking_residual(tracked_model.Tied(p.stage, p.tracker), path, substeps, load)


def _current_in_time(p: TrackedModel, path: MeasuredPath) -> tuple[TrackedModel, MeasuredPath]:
    """The log's current moved by whole samples, and the model's report late by the rest.

    A current that follows steps of a command is no straight line between two samples: the model knows what it is there.
    Where the model does not describe how a current follows, or no other current than the command is known, what was
    logged is moved, by linear interpolation.
    """
    unknown = bool(np.isnan(path.rows[:, 2]).all())
    if unknown or p.stage.drive.current_lag == 0.0:
        return p, _earlier(path, 0 if unknown else 2, p.shift / path.dt)
    late = p.stage.drive.telemetry.late + p.shift
    whole = math.floor(late / path.dt)
    return put(p, "stage.drive.telemetry.late", late - whole * path.dt), _earlier(path, 2, whole)


@functools.lru_cache(maxsize=16)  # most models of one fit have the same shift
def _earlier(path: MeasuredPath, column: int, samples: float) -> MeasuredPath:
    """`path` with the current in a `column` that was logged `samples` later."""
    rows = path.rows.copy()
    rows[:, column] = _later_value(rows[:, column], samples)
    return path._replace(rows=rows, sensed=_later_value(np.broadcast_to(path.sensed, len(rows)), samples))


def _later_value(signal: Array, samples: float) -> Array:
    """The value (n,) of a signal so many `samples` later, by linear interpolation; at its ends the last one holds."""
    whole, rows = math.floor(samples), len(signal)
    first = min(max(whole, 0), rows - 1)
    before, after = min(max(-whole, 0), rows), min(max(whole + 1, 0), rows)
    line = np.pad(signal[first:], (before, after), mode="edge")[: rows + 1]  # one more row than the signal
    value: Array = line[:-1] + (samples - whole) * np.diff(line)
    return value


def mean_residuals(p: TrackedModel, runs: Sequence[Run], noise: Whitener) -> list[Array]:
    """Whitened residual (m, 2) of each run along the mean of its repeats."""
    return in_parallel(lambda run: _whitened(run, model_residual(p, run.mean), noise), runs)


def residuals_of(p: TrackedModel, runs: Sequence[Run], noise: Whitener) -> list[list[Array]]:
    """Whitened residual (m, 2) of each run and repeat, effort and current; over all cores."""
    return in_parallel(lambda run: [_whitened(run, model_residual(p, path), noise) for path in run.paths], runs)


def deviations(
    p: TrackedModel, runs: Sequence[Run], noise: Whitener, of_repeats: Sequence[Sequence[Array]]
) -> list[list[Array]]:
    """What the residuals `of_repeats` under `p` depart by from those of their mean paths."""
    means = mean_residuals(p, runs, noise)
    return [[residual - mean for residual in repeats] for repeats, mean in zip(of_repeats, means, strict=True)]


def residuals_about(
    p: TrackedModel, runs: Sequence[Run], noise: Whitener, apart: Sequence[Sequence[Array]]
) -> list[list[Array]]:
    """`residuals_of` for a model like that of the deviations `apart`: noise passes through both alike."""
    means = mean_residuals(p, runs, noise)
    return [[mean + deviation for deviation in repeats] for mean, repeats in zip(means, apart, strict=True)]


def _whitened(run: Run, residual: ModelResidual, noise: Whitener) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):  # a simulation that diverged stays diverged
        return without_drift_at_rest(whitened(noise, residual, run.mean.dt), run.rests)


def all_columns(
    p: TrackedModel, runs: Sequence[Run], directions: Sequence[Direction], noise: Whitener
) -> list[dict[str, list[Array]]]:
    """Whitened columns (m, 2) of each run by the direction's name: one for all repeats, or one each on the clock.

    Computed over all cores.  Directions that run on the session clock share the simulation of what they scale.  The
    column of a simulation that diverged is zero.
    """
    if not directions:
        return [{} for _ in runs]
    before = in_parallel(lambda run: model_residual(p, run.mean, SENSITIVITY_SUBSTEPS), runs)
    distinct = {_simulation(direction): direction for direction in directions}
    tasks = [(run, base, change) for run, base in zip(runs, before, strict=True) for change in distinct.values()]
    columns = iter(in_parallel(lambda task: _column(p, *task, noise), tasks))
    simulated = [{key: next(columns) for key in distinct} for _ in runs]
    return [
        {p.name: _on_the_clock(run, by_simulation[_simulation(p)], p.factor) for p in directions}
        for run, by_simulation in zip(runs, simulated, strict=True)
    ]


def _simulation(direction: Direction) -> object:
    """What directions that share a simulation have in common."""
    return direction.name if direction.factor is None else direction.change


def _column(p: TrackedModel, run: Run, before: ModelResidual, direction: Direction, noise: Whitener) -> Array:
    after = model_residual(direction.change(p), run.mean, SENSITIVITY_SUBSTEPS, direction.load)
    with np.errstate(over="ignore", invalid="ignore"):  # a simulation that diverged stays diverged
        # What is added to the model leaves its residual: the column is before less after.
        effort = (before.effort - after.effort) / direction.size
        current = (before.current - after.current) / direction.size
    return _bounded(_whitened(run, ModelResidual(effort, current), noise))


def _on_the_clock(run: Run, column: Array, factor: Callable[[Array], Array] | None) -> list[Array]:
    """One column for all repeats, or for each the column times its factor: what drifts is slow for the tracker."""
    if factor is None:
        return [column]
    clock = run.mean.dt * KEPT * np.arange(len(column), dtype=np.float64)
    return [column * factor(path.start + clock)[:, None] for path in run.paths]


def _bounded(column: Array) -> Array:
    """A simulation that diverged explains nothing."""
    return column if np.isfinite(column).all() and np.abs(column).max(initial=0.0) < DIVERGED else np.zeros_like(column)
