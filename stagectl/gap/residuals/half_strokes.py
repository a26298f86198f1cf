"""The logs of a session, experiment by experiment: repeats side by side, cut into half strokes."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.model_tracking import Path, mean_path, path_of
from stagectl.gap.residuals.whitening import KEPT

SHORTEST = 0.1  # s, of a half stroke: faster reversals are taken together
LONGEST = 1.0  # s: a longer one is cut again, or a slow scan would be one cluster
WIPED = 3.0  # of the rolling zone: so far in one direction, and every element slips
REST = 0.04  # s of standstill that count as one
EDGE = 0.02  # s at both ends, where the filter has no neighbour


class Run(NamedTuple):
    """All repeats of one experiment."""

    name: str
    logs: tuple[Log, ...]
    paths: tuple[Path, ...]  # of each repeat
    mean: Path  # of all of them
    weight: Array  # (m,) 1 where a kept sample counts, 0 in gaps and at the ends
    cluster: NDArray[np.int64]  # (m,) number of the half stroke, from 0
    rests: tuple[tuple[int, int], ...] = ()  # kept samples between which the axis stands

    @property
    def rows(self) -> int:
        """Control periods that all repeats have."""
        return len(self.mean.rows)


def known_from(position: Array, zone: float) -> int:
    """Row from which the friction's state is known whatever it was before: the axis has gone through its zone.

    0 where it never does: then the state of the whole run is a nuisance.
    """
    gone = np.maximum.accumulate(position) - np.minimum.accumulate(position)
    beyond = np.flatnonzero(gone > WIPED * zone)
    return int(beyond[0]) if len(beyond) else 0


def by_experiment(logs: Sequence[Log]) -> dict[str, list[Log]]:
    """Repeats side by side."""
    found: dict[str, list[Log]] = {}
    for log in logs:
        found.setdefault(log.experiment, []).append(log)
    return found


def runs(session: Session, held_out: bool = False) -> list[Run]:
    """The experiments of `session`, those held out or the others."""
    found = by_experiment([log for log in session.logs if log.held_out == held_out])
    zone = friction_family.length(session.stage.friction)
    return [_run(name, distinct(logs), session.dt, zone) for name, logs in found.items()]


def distinct(logs: Sequence[Log]) -> list[Log]:
    """`logs` without copies: a repeat that is the same to the last bit tells nothing of what varies by chance."""
    found: list[Log] = []
    for log in logs:
        if not any(_same(log, other) for other in found):
            found.append(log)
    return found


def _same(one: Log, other: Log) -> bool:
    pairs = ((one.position, other.position), (one.command, other.command), (one.current, other.current))
    return all(a is b or (a is not None and b is not None and np.array_equal(a, b, equal_nan=True)) for a, b in pairs)


def _run(name: str, logs: Sequence[Log], dt: float, zone: float) -> Run:
    rows = min(log.rows for log in logs)
    paths = tuple(path._replace(rows=path.rows[:rows]) for path in (path_of(log, dt) for log in logs))
    mean = mean_path(list(paths))
    valid = np.logical_and.reduce([log.valid[:rows] for log in logs])
    edge = round(EDGE / dt)
    valid[:edge] = valid[rows - edge :] = False
    valid[: known_from(mean.rows[:, 1], zone)] = False
    cluster = half_strokes(mean.rows[:, 1], dt)
    still = standstills(mean.rows[:, 1] if logs[0].reference is None else logs[0].reference[:rows], dt)
    rests = tuple((-(-begin // KEPT), -(-end // KEPT)) for begin, end in still)
    return Run(name, tuple(logs), paths, mean, valid[::KEPT].astype(np.float64), cluster[::KEPT], rests)


def standstills(position: Array, dt: float) -> list[tuple[int, int]]:
    """Spans [begin, end) in which `position` (n,), the reference where it is known, stays where it is."""
    window = max(round(0.01 / dt), 1)
    change = np.abs(position[window:] - position[:-window])
    still = np.concatenate([change <= 1e-3 * change.max(initial=0.0), np.zeros(window, dtype=bool)])
    edges = np.flatnonzero(np.diff(still.astype(np.int8), prepend=0, append=0))
    spans = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(begin, end) for begin, end in spans if (end - begin) * dt >= REST]


def rested(run: Run, signal: Array) -> Array:
    """`signal` (m, 2) without its slow course at standstill."""
    return without_rests(signal, run.rests)


def without_rests(signal: Array, rests: Sequence[tuple[int, int]]) -> Array:
    """`signal` (m, k) without its slow course between the samples of each of `rests`.

    What friction holds at rest is not determined by the motion: it relaxes under vibrations smaller than a count,
    each law in its own way.  A cubic takes that away; what rings after a stop stays.
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
    basis: Array = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), 4))[0]
    return basis


def half_strokes(position: Array, dt: float) -> NDArray[np.int64]:
    """Number of the half stroke (n,) that each sample belongs to."""
    window = max(round(0.02 / dt), 1)
    smooth = np.convolve(np.pad(position, window, mode="edge"), np.ones(window) / window, mode="same")[window:-window]
    velocity = np.gradient(smooth, dt)
    moving = np.abs(velocity) > 1e-3 * np.abs(velocity).max(initial=0.0)
    side = np.where(moving, np.sign(velocity), 0.0)
    number = np.zeros(len(position), dtype=np.int64)
    began, current = 0, 0
    for k in [*np.flatnonzero(np.diff(side, prepend=0.0) != 0.0).tolist(), len(position)]:
        if (k - began) * dt >= SHORTEST or k == len(position):
            pieces = max(1, round((k - began) * dt / LONGEST))
            number[began:k] = current + np.minimum(np.arange(k - began) * pieces // max(k - began, 1), pieces - 1)
            began, current = k, current + pieces
    return number
