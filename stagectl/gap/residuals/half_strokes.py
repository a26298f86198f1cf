"""The logs of a session by experiment: repeats next to each other, divided into half strokes."""

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.residuals import friction_family, thresholds
from stagectl.gap.residuals.model_tracking import MeasuredPath, at_rest, mean_path, path_of
from stagectl.recording.true_rows import stretches


class Run(NamedTuple):
    """All repeats of one experiment."""

    name: str
    logs: tuple[Log, ...]
    paths: tuple[MeasuredPath, ...]  # of each repeat
    mean: MeasuredPath  # of all repeats
    weight: Array  # (m,) 1 where a kept sample counts, 0 in gaps and at the ends
    cluster: NDArray[np.int64]  # (m,) number of the half stroke, from 0
    rests: tuple[tuple[int, int], ...] = ()  # kept samples between which the axis stands

    @property
    def rows(self) -> int:
        """Control periods that all repeats have."""
        return len(self.mean.rows)


def noise_of_all(runs: Sequence[Run], of_means: bool = False) -> float:
    """The noise of all `runs` over that of the repeated ones, which their repeats tell; 1 where none was repeated.

    A sample of a run that was recorded once has as much noise as any other.  `of_means`: the noise of the mean of the
    repeats, else that of all repeats together.
    """
    noise = [(len(run.paths), np.sum(run.weight**2) * len(run.paths) ** (-1 if of_means else 1)) for run in runs]
    known = sum(size for repeats, size in noise if repeats > 1)
    return float(sum(size for _, size in noise) / known) if known else 1.0


def known_from(position: Array, zone: float) -> int:
    """First row in which the friction's state no longer depends on earlier motion.

    The axis has then gone three times through its rolling zone of length `zone` (rad | m).  0 where it never does: the
    state is a nuisance of the whole run.
    """
    travelled = np.maximum.accumulate(position) - np.minimum.accumulate(position)
    beyond = np.flatnonzero(travelled > thresholds.ZONES_TRAVELLED * zone)
    return int(beyond[0]) if len(beyond) else 0


def by_experiment(logs: Sequence[Log]) -> dict[str, list[Log]]:
    """The repeats of each experiment."""
    experiments: dict[str, list[Log]] = {}
    for log in logs:
        experiments.setdefault(log.experiment, []).append(log)
    return experiments


def runs(session: Session, held_out: bool = False) -> list[Run]:
    """The experiments of `session`: those held out, or the others."""
    experiments = by_experiment([log for log in session.logs if log.held_out == held_out])
    zone = friction_family.length(session.stage.friction)
    return [_run(name, distinct(logs), session.dt, zone) for name, logs in experiments.items()]


def distinct(logs: Sequence[Log]) -> list[Log]:
    """`logs` without copies: a repeat that is equal to the last bit holds no information on random variation."""
    kept: list[Log] = []
    for log in logs:
        if not any(_equal(log, other) for other in kept):
            kept.append(log)
    return kept


def _equal(log: Log, other: Log) -> bool:
    pairs = ((log.position, other.position), (log.command, other.command), (log.current, other.current))
    return all(a is b or (a is not None and b is not None and np.array_equal(a, b, equal_nan=True)) for a, b in pairs)


def _run(name: str, logs: Sequence[Log], dt: float, zone: float) -> Run:
    rows = min(log.rows for log in logs)
    paths = tuple(path._replace(rows=path.rows[:rows]) for path in (path_of(log, dt) for log in logs))
    still = standstills(mean_path(paths).rows[:, 1] if logs[0].reference is None else logs[0].reference[:rows], dt)
    paths = tuple(at_rest(path, log.commanded, still) for path, log in zip(paths, logs, strict=True))
    mean = mean_path(paths)
    valid = np.logical_and.reduce([log.valid[:rows] for log in logs])
    edge = round(thresholds.FILTER_EDGE / dt)
    valid[:edge] = valid[rows - edge :] = False
    valid[: known_from(mean.rows[:, 1], zone)] = False
    cluster = half_strokes(mean.rows[:, 1], dt)
    counts = valid[:: thresholds.KEPT].astype(np.float64)
    return Run(name, tuple(logs), paths, mean, counts, cluster[:: thresholds.KEPT], kept(still))


def standstills(position: Array, dt: float) -> list[tuple[int, int]]:
    """Spans [begin, end) of rows in which `position` (n,), the reference where it is known, does not change."""
    window = max(round(thresholds.REST_WINDOW / dt), 1)
    change = np.abs(position[window:] - position[:-window])
    still = np.concatenate([change <= thresholds.REST_CHANGE * change.max(initial=0.0), np.zeros(window, dtype=bool)])
    return [(begin, end) for begin, end in stretches(still) if (end - begin) * dt >= thresholds.SHORTEST_REST]


def kept(spans: Sequence[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """Spans of rows as spans of kept samples."""
    return tuple((-(-begin // thresholds.KEPT), -(-end // thresholds.KEPT)) for begin, end in spans)


def without_drift_at_rest(signal: Array, rests: Sequence[tuple[int, int]]) -> Array:
    """`signal` (m, k) without its slow course between the samples of each of `rests`.

    The motion does not determine the friction at rest: it relaxes under vibrations smaller than an encoder step, each
    law in its own way.  A cubic removes this; ringing after a stop remains.
    """
    signal = signal.copy()
    for begin, end in rests:
        part = signal[begin:end]
        basis = _cubic(len(part))
        signal[begin:end] = part - basis @ (basis.T @ part)
    return signal


@functools.lru_cache(maxsize=64)
def _cubic(count: int) -> Array:
    """(count, 4) orthonormal polynomials."""
    return np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), 4))[0]


def half_strokes(position: Array, dt: float) -> NDArray[np.int64]:
    """Number of the half stroke (n,) that each sample of `position` (n,) rad | m belongs to, from 0."""
    side = _direction(position, dt)
    number = np.zeros(len(position), dtype=np.int64)
    began, current = 0, 0
    for k in [*np.flatnonzero(np.diff(side, prepend=0.0) != 0.0).tolist(), len(position)]:
        if (k - began) * dt >= thresholds.SHORTEST_STROKE or k == len(position):
            pieces = max(1, round((k - began) * dt / thresholds.LONGEST_STROKE))
            number[began:k] = current + np.minimum(np.arange(k - began) * pieces // max(k - began, 1), pieces - 1)
            began, current = k, current + pieces
    return number


def _direction(position: Array, dt: float) -> Array:
    """(n,) sign of the smoothed velocity; 0 at standstill."""
    window = max(round(thresholds.STROKE_WINDOW / dt), 1)
    smooth = np.convolve(np.pad(position, window, mode="edge"), np.ones(window) / window, mode="same")[window:-window]
    velocity = np.gradient(smooth, dt)
    moving = np.abs(velocity) > thresholds.STROKE_SPEED * np.abs(velocity).max(initial=0.0)
    return np.where(moving, np.sign(velocity), 0.0)


def samples(run: Run) -> Array:
    """(c,) How many of each half stroke of `run` count, of all repeats."""
    return np.array([len(run.paths) * np.sum(run.weight[span] ** 2) for span in spans(run.cluster)])


def spans(cluster: NDArray[np.int64]) -> list[slice]:
    """The samples of each half stroke, from the numbers `cluster` (m,) of all samples."""
    borders = [0, *(np.flatnonzero(np.diff(cluster)) + 1).tolist(), len(cluster)]
    return [slice(begin, end) for begin, end in itertools.pairwise(borders)]
