"""What a change of the model does to what it lacks, by re-simulation: one column for every direction of change.

No effect has a formula of its own here: the stage model with and without it runs tied to the same path, and the
difference is its column, delays, sampling and estimator included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import model_tracking, whitening
from stagectl.gap.residuals.half_strokes import Run, rested
from stagectl.gap.residuals.model_tracking import Lacking, Path
from stagectl.kernels import feedback, tracked_model
from stagectl.kernels.stage import Stage
from stagectl.parallel import in_parallel

LARGEST = 1e8  # standard deviations: beyond, a simulation has diverged


class Model(NamedTuple):
    """The stage model that is compared, and how the log's columns lie in time."""

    stage: Stage
    tracker: feedback.Pid
    shift: float = 0.0  # s by which the logged current is late against the position


class Direction(NamedTuple):
    """A change of the model."""

    name: str
    change: Callable[[Model], Model]
    size: float  # of the change; the column is per unit of it
    factor: Callable[[Array], Array] | None = None  # of the session clock (n,) s: on the column of `change`
    load: float = 0.0  # share of the friction's limit with which the runs begin


def model_of(session: Session, stage: Stage) -> Model:
    """`stage` tied as the session's nominal model would be."""
    return Model(stage, model_tracking.tracker(session.stage, session.dt))


def lacks(p: Model, path: Path, substeps: int = model_tracking.SUBSTEPS, load: float = 0.0) -> Lacking:
    """What the model lacks along `path`, the logged current moved back to the instants of the position."""
    if p.shift:
        path = path._replace(rows=_moved(path.rows, p.shift / path.dt))
    return model_tracking.lacking(tracked_model.Tied(p.stage, p.tracker), path, substeps, load)


def _moved(rows: Array, samples: float) -> Array:
    """`rows` with the current of `samples` later: what was logged late belongs there."""
    count, whole = len(rows), math.floor(samples)
    held = np.pad(rows[:, 2], abs(whole) + 1, mode="edge")[abs(whole) + 1 + whole :]
    rows = rows.copy()
    rows[:, 2] = held[:count] + (samples - whole) * (held[1 : count + 1] - held[:count])
    return rows


def residuals(p: Model, run: Run, noise: whitening.Whitener) -> list[Array]:
    """Whitened (m, 2) of each repeat: the effort and the current that the model lacks."""
    return [rested(run, whitening.whitened(noise, lacks(p, path), path.dt)) for path in run.paths]


def mean_residuals(p: Model, runs: Sequence[Run], noise: whitening.Whitener) -> list[Array]:
    """Whitened (m, 2) of each run along the mean of its repeats."""

    def of(run: Run) -> Array:
        return rested(run, whitening.whitened(noise, lacks(p, run.mean), run.mean.dt))

    return in_parallel(of, runs)


def residuals_of(p: Model, runs: Sequence[Run], noise: whitening.Whitener) -> list[list[Array]]:
    """`residuals` of all runs, over all cores."""
    return in_parallel(lambda run: residuals(p, run, noise), runs)


def all_columns(
    p: Model, runs: Sequence[Run], directions: Sequence[Direction], noise: whitening.Whitener
) -> list[dict[str, list[Array]]]:
    """Whitened (m, 2) of each run and direction by its name: one for all repeats, or one each on the session clock.

    Batched over all cores.  Directions that run on the clock share the simulation of what they scale; a diverged one
    is a column of zeros.
    """
    if not directions:
        return [{} for _ in runs]
    before = in_parallel(lambda run: lacks(p, run.mean, model_tracking.OF_COLUMNS), runs)
    distinct = {_key(one): one for one in directions}
    tasks = [(run, base, one) for run, base in zip(runs, before, strict=True) for one in distinct.values()]
    found = iter(in_parallel(lambda task: _column(p, *task, noise), tasks))
    each = [{key: next(found) for key in distinct} for _ in runs]
    return [
        {one.name: _on_the_clock(run, mine[_key(one)], one.factor) for one in directions}
        for run, mine in zip(runs, each, strict=True)
    ]


def _key(one: Direction) -> object:
    return one.name if one.factor is None else one.change


def _column(p: Model, run: Run, before: Lacking, one: Direction, noise: whitening.Whitener) -> Array:
    after = lacks(one.change(p), run.mean, model_tracking.OF_COLUMNS, one.load)
    # The residual is what the model lacks: adding to the model takes from it, so the column is before less after.
    change = Lacking((before.effort - after.effort) / one.size, (before.current - after.current) / one.size)
    return _bounded(rested(run, whitening.whitened(noise, change, run.mean.dt)))


def _on_the_clock(run: Run, column: Array, factor: Callable[[Array], Array] | None) -> list[Array]:
    """One column for all repeats, or for each the column times its factor: what drifts is slow beside the tracker."""
    if factor is None:
        return [column]
    clock = run.mean.dt * whitening.KEPT * np.arange(len(column), dtype=np.float64)
    return [column * factor(path.start + clock)[:, None] for path in run.paths]


def _bounded(column: Array) -> Array:
    """A diverged simulation explains nothing."""
    return column if np.isfinite(column).all() and np.abs(column).max(initial=0.0) < LARGEST else np.zeros_like(column)
