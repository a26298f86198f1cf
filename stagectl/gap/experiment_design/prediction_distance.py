"""What a model predicts that an experiment will record, in standard deviations of what its repeats will differ by.

::

    model, setpoints --> closed loop --> position, current --> filtered by 1/sqrt(noise density) --> (m,) numbers

The sum of squares between two such predictions is their distance in sigma, squared: the noncentrality that a test
between both models will have (Atkinson and Fedorov, Biometrika 62(1), 1975: T-optimality).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import welch

from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.residuals import whitening
from stagectl.gap.residuals.half_strokes import standstills, without_drift_at_rest
from stagectl.gap.residuals.thresholds import BAND, KEPT
from stagectl.kernels import rollout, stage
from stagectl.kernels.law import Law

SUBSTEPS = 2  # a period; what resonates divides its steps further by itself
SEGMENT = 2048  # rows of one spectrum of the noise
_LEAST = 1e-4  # of the rms of a signal: a lower noise is not believed
_LEVEL = 1e-6  # of the largest density, where there is no noise at all


class Noise(NamedTuple):
    """Power spectral density of what repeats differ by, over sqrt 2."""

    frequency: Array  # (f,) Hz
    position: Array  # (f,) rad^2/Hz | m^2/Hz
    current: Array  # (f,) A^2/Hz


class Bench(NamedTuple):
    """One experiment as all models are put to it."""

    setpoints: Array  # (n, 8)
    law: Law
    noise: Noise
    start: float  # rad | m, where the axis stands
    clock: float  # s, session clock of the first row
    dt: float  # s
    measured: bool  # the logs hold a measured current; else the command stands for it
    rests: tuple[tuple[int, int], ...] = ()  # kept samples between which the reference stands


class Told(NamedTuple):
    """What a model predicts."""

    values: Array  # (m,) position, then current, in standard deviations; not finite where the simulation diverged
    current: float  # A, largest


def noise_of(session: Session, floor: float) -> Noise:
    """The noise of a session from its repeats; without any, `floor` (rad | m rms) and the model's steps stand in."""
    repeats = [[log for log in session.logs if log.experiment == name] for name in _experiments(session)]
    repeated = [each for each in repeats if len(each) > 1]
    segment = min([SEGMENT, *(log.rows for log in session.logs)])
    position = _density([_deviations(each, "position") for each in repeated], session.dt, segment)
    current = _density([_deviations(each, _signal(session)) for each in repeated], session.dt, segment)
    frequency: Array = np.arange(segment // 2 + 1, dtype=np.float64) / (segment * session.dt)
    step = session.stage.encoder.step / math.sqrt(12.0)
    if not repeated and math.isfinite(floor):
        step = max(step, floor)
    quantum = session.stage.drive.current_quantum / math.sqrt(12.0)
    currents = [log.command if log.current is None else log.current for log in session.logs]
    rms = math.sqrt(max((float(np.mean(one * one)) for one in currents if one is not None), default=0.0))
    return Noise(
        frequency,
        _at_least(position, step, session.dt, frequency),
        _at_least(current, max(quantum, _LEAST * rms), session.dt, frequency),
    )


def _experiments(session: Session) -> list[str]:
    return list(dict.fromkeys(log.experiment for log in session.logs))


def _signal(session: Session) -> str:
    return "current" if measured(session) else "command"


def measured(session: Session) -> bool:
    """Whether all logs hold a measured current."""
    return all(log.current is not None for log in session.logs)


def _deviations(repeats: Sequence[Log], name: str) -> list[Array]:
    """Of each repeat from their mean, as large as a single one's noise."""
    columns = [getattr(log, name) for log in repeats]
    if any(column is None for column in columns):
        return []
    rows = min(len(column) for column in columns)
    return list(whitening.single_noise([column[:rows] for column in columns]))


def _density(each: Sequence[Sequence[Array]], dt: float, segment: int) -> Array:
    """Mean density (f,) of all deviations, smoothed over neighbouring lines; zero where there are none."""
    signals = [one for signals in each for one in signals]
    if not signals:
        return np.zeros(segment // 2 + 1)
    total = sum(len(one) for one in signals)
    found = [welch(one, 1.0 / dt, nperseg=segment)[1] * (len(one) / total) for one in signals]
    mean = np.sum(found, axis=0)
    mean[0] = mean[1]  # Welch's method takes the mean away
    return whitening.smoothed(mean)


def _at_least(density: Array, white: float, dt: float, frequency: Array) -> Array:
    """No density below that of a `white` noise of this standard deviation."""
    least = max(2.0 * dt * white * white, _LEVEL * float(density.max(initial=0.0)), 1e-300)
    found: Array = np.maximum(density, least) if len(density) else np.full(len(frequency), least)
    return found


def told(p: Bench, model: stage.Stage, shift: float = 0.0) -> Told:
    """The prediction of `model` with its current logged late by `shift` (s); quiet, and of a machine without steps."""
    rows = np.zeros((len(p.setpoints), rollout.WIDTH))
    plant = stage.at_reading(model, p.start, p.clock)
    inputs = (np.ascontiguousarray(p.setpoints), np.zeros((len(rows), 2)), rows)
    rollout.closed_loop(rollout.Loop(p.law, model), plant, inputs, p.dt, SUBSTEPS)
    position = rows[:, rollout.COLUMNS.index("measured")] - p.setpoints[:, 0]
    current = rows[:, rollout.COLUMNS.index("measured_current" if p.measured else "current")]
    if not (np.isfinite(position).all() and np.isfinite(current).all()):
        return Told(np.full(2 * len(rows[::KEPT]), np.nan), math.inf)
    columns = [_whitened(p, position, p.noise.position, 0.0), _whitened(p, current, p.noise.current, shift)]
    return Told(without_drift_at_rest(np.stack(columns, axis=1), p.rests).T.ravel(), float(np.abs(current).max()))


def _whitened(p: Bench, signal: Array, density: Array, late: float) -> Array:
    """Every second sample (m,) of the signal, filtered so that noise of that density would have a variance of one.

    Above the roll-off it counts less, as in the cuts of the diagnosis: impacts ring there at instants that no model
    foretells.
    """
    frequency = np.fft.rfftfreq(len(signal), p.dt)
    gain = np.sqrt(2.0 * KEPT * p.dt / np.interp(frequency, p.noise.frequency, density))
    gain = gain * (frequency <= BAND / p.dt) / whitening.roll_off(frequency, p.dt)
    turned = gain * np.exp(-2j * math.pi * late * frequency)
    filtered: Array = np.fft.irfft(np.fft.rfft(signal) * turned, len(signal))[::KEPT]
    return filtered


def late(p: Bench, values: Array) -> Array:
    """Change of a prediction (m,) by a current that is logged one period later: less its slope.

    Nothing where no current is measured, as then it has no clock of its own.
    """
    half = len(values) // 2
    found = np.zeros(len(values))
    if p.measured:
        found[half:] = -np.gradient(values[half:]) / KEPT
    return found


def rests_of(setpoints: Array, dt: float) -> tuple[tuple[int, int], ...]:
    """Kept samples between which the reference of `setpoints` (n, 8) stands."""
    return tuple((-(-begin // KEPT), -(-end // KEPT)) for begin, end in standstills(setpoints[:, 0], dt))
