"""The stage model tracks the measured path of a log: what must be added to its effort is the residual effort."""

import functools
import math
from collections.abc import Sequence
from itertools import compress
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from stagectl.gap.logs.log_start import LogStart, of_log
from stagectl.gap.logs.session import Array, Log
from stagectl.gap.residuals.noise_at_rest import Spans, quiet
from stagectl.gap.residuals.thresholds import SUBSTEPS, TICK, TRACKER_BANDWIDTH, YIELD_TIME
from stagectl.kernels import feedback, friction, stage, tracked_model


class MeasuredPath(NamedTuple):
    """What a model tracks: one log, or the mean of repeats; known by its identity."""

    rows: Array  # (n, 3) command A, position rad | m, current A (NaN: not measured)
    start: float  # s, session clock
    dt: float  # s
    sensed: Array | float = 0.0  # (n,) A, what of the current is noise of its sensor, as far as is known
    still: Spans = ()  # in which the axis is known to stand
    carried: float = 0.0  # A, under which it stands before the first row

    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other

    @property
    def begins(self) -> LogStart:
        """How the log begins; what is left of the noise of a standing axis is no velocity."""
        if any(begin == 0 for begin, _ in self.still):
            return LogStart(float(self.rows[0, 1]), self.start, (0.0, self.carried))
        return of_log(self.rows[:, 1], self.rows[:, 0], self.start, self.dt, self.carried)


class _Inputs(NamedTuple):
    """What every model is given along one path."""

    begins: LogStart
    rows: Array  # (n, 3) command, current as it is fed back (A), share that the bristle takes over
    line: Array  # (n, m) positions of m ticks (rad | m)
    current: Array  # (n,) A, as it was measured
    unknown: NDArray[np.bool_]  # (n,) where it was not


class ModelResidual(NamedTuple):
    """What the model leaves unexplained along a path."""

    effort: Array  # (n,) N m | N, residual effort: the correction that keeps the model on the path
    current: Array  # (n,) A, missing current: measured minus the drive model's; zero where no current is measured


def path_of(log: Log, dt: float) -> MeasuredPath:
    """The path of one log; where the command is not known, the measured current takes its place."""
    current = log.current if log.commanded and log.current is not None else np.full(log.rows, np.nan)
    return MeasuredPath(np.column_stack([log.driving, log.position, current]), log.start, dt, carried=log.carried)


def at_rest(path: MeasuredPath, commanded: bool, still: Spans) -> MeasuredPath:
    """`path` without the noise of its sensors in the spans `still`, in which the axis stands.

    What the current departs from the command by is averaged: the machine feels the noise of its command.  Where that is
    not `commanded`, a measured current stands in its place.
    """
    command, position, current = path.rows.T
    apart = current - command
    known = command if commanded else quiet(command, still, path.dt)
    rows = np.column_stack([known, quiet(position, still, path.dt), current])
    return path._replace(rows=rows, sensed=apart - quiet(apart, still, path.dt), still=still)


def mean_path(paths: Sequence[MeasuredPath]) -> MeasuredPath:
    """The mean of all repeats: the same motion with less noise."""
    rows = min(len(path.rows) for path in paths)
    sensed = np.mean([np.asarray(path.sensed) for path in paths], axis=0)
    return paths[0]._replace(rows=np.mean([path.rows[:rows] for path in paths], axis=0), sensed=sensed)


def ticks(dt: float) -> int:
    """How often the tracker corrects in a period `dt` (s)."""
    return max(round(dt / TICK), 1)


def tracker(nominal: stage.Stage, dt: float) -> feedback.Pid:
    """The controller that keeps a model on the path, designed by pole placement on the nominal mechanics.

    All candidates share its poles: the estimator must not depend on what it estimates.
    """
    tick = dt / ticks(dt)
    gains = feedback.place_poles(nominal.mechanics, nominal.motor.force_constant, TRACKER_BANDWIDTH / tick)
    return feedback.discretised(gains, tick)


def places(position: Array, late: int, count: int) -> Array:
    """Positions (n, m) at the `count` ticks of each row of `position` (n,), by a cubic (Catmull and Rom).

    Many ticks need where the machine is then: the position is logged `late` (samples).
    """
    if count == 1:
        return position[:, None]
    line = np.pad(position, (1, late + 2), mode="reflect", reflect_type="odd")[late:]
    t = np.arange(count) / count
    cubic = 0.5 * np.stack([((2 - t) * t - 1) * t, (3 * t - 5) * t * t + 2, ((4 - 3 * t) * t + 1) * t, (t - 1) * t * t])
    return sliding_window_view(line, 4)[: len(position)] @ cubic


@functools.lru_cache(maxsize=16)  # many models in turn along a few paths
def _inputs(path: MeasuredPath, late: int) -> _Inputs:
    """Of models whose encoder reports a position `late` (samples)."""
    command, position, current = path.rows.T
    line = places(position, late, ticks(path.dt))
    rows = np.column_stack([command, current - path.sensed, _taken_over(path)])
    return _Inputs(path.begins, rows, np.ascontiguousarray(line), current.copy(), np.isnan(current))


def _taken_over(path: MeasuredPath) -> Array:
    """Share (n,) of the tracker's correction that the bristle takes over in each row: only where the axis stands."""
    share = np.zeros(len(path.rows))
    for begin, end in path.still:
        share[begin:end] = -math.expm1(-path.dt / YIELD_TIME)
    return share


def _that_carries(p: stage.Friction) -> stage.Friction:
    """`p` without stop operators of no weight: they give no force, and a fitted family has many."""
    weight, slip = p.operators.weight, p.operators.slip
    return p._replace(operators=friction.bundle(compress(weight, weight), compress(slip, weight)))


def tracking_residual(
    p: tracked_model.Tied, path: MeasuredPath, substeps: int = SUBSTEPS, load: float = 0.0
) -> ModelResidual:
    """The residual of `p` along `path`.

    Its friction begins with the share `load` of what it can hold, or in the middle of a motion without that share.
    """
    encoder = p.stage.encoder._replace(step=0.0)  # the log is quantised already
    p = p._replace(stage=p.stage._replace(encoder=encoder, friction=_that_carries(p.stage.friction)))
    given, count = _inputs(path, p.stage.encoder.delay_samples), ticks(path.dt)
    plant = given.begins.plant(p.stage, path.dt)
    if load:
        for stops in (plant.stops, plant.memory.stops):
            stops[:] = load if given.begins.going_on[0] == 0.0 else (1.0 - load) * stops
    x = tracked_model.State(plant, feedback.AT_REST)
    out = np.empty((2, len(path.rows)))
    steps = stage.steps_that_hold(p.stage, path.dt / count, math.ceil(substeps / count))
    tracked_model.follow(p, x, (given.rows, given.line, out.T), path.dt, steps)
    missing = given.current - out[1]
    missing[given.unknown] = 0.0
    with np.errstate(over="ignore"):  # of a candidate that diverges: its residual is not finite, and it is left out
        return ModelResidual(out[0] * p.stage.motor.force_constant, missing)
