"""What a model predicts that an experiment will record, in standard deviations of what its repeats will differ by.

::

    model, setpoints --> closed loop --> position, current --> filtered by 1/sqrt(noise density) --> (m,) numbers

The sum of squares between two such predictions is their distance in sigma, squared: the noncentrality that a test
between both models will have.

Source: A. C. Atkinson, V. V. Fedorov, Biometrika 62(1), 1975 (T-optimality).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.experiment_design import thresholds
from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.residuals import whitening
from stagectl.gap.residuals.half_strokes import by_experiment, without_drift_at_rest
from stagectl.gap.residuals.thresholds import BAND, KEPT
from stagectl.gap.validation.rollouts import Rollout, closed_loop, column
from stagectl.kernels import stage


class RepeatNoise(NamedTuple):
    """Power spectral density of what repeats differ by, over sqrt 2."""

    frequency: Array  # (f,) Hz
    position: Array  # (f,) rad^2/Hz | m^2/Hz
    current: Array  # (f,) A^2/Hz


class PlannedRun(NamedTuple):
    """One experiment as it is simulated with every model."""

    rollout: Rollout
    noise: RepeatNoise
    measured: bool  # the logs hold a measured current; else the command is taken for it
    rests: tuple[tuple[int, int], ...] = ()  # kept samples between which the reference stands still


class Prediction(NamedTuple):
    """What a model predicts."""

    values: Array  # (m,) position, then current, in standard deviations; not finite where the simulation diverged
    current: float  # A, largest


def noise_of(session: Session, floor: float) -> RepeatNoise:
    """The noise of a session from its repeats; without any, `floor` (rad | m rms) and the model's steps stand in."""
    repeated = [logs for logs in by_experiment(session.logs).values() if len(logs) > 1]
    step = session.stage.encoder.step / math.sqrt(12.0)
    if not repeated and math.isfinite(floor):
        step = max(step, floor)
    quantum = session.stage.drive.current_quantum / math.sqrt(12.0)
    instrument = "current" if measured(session) else "command"
    frequency, position = _density(repeated, "position", step, session.dt)
    current = _density(repeated, instrument, max(quantum, thresholds.LEAST_NOISE * _rms(session)), session.dt)
    return RepeatNoise(frequency, position, np.interp(frequency, *current))


def measured(session: Session) -> bool:
    """Whether all logs hold a measured current."""
    return all(log.current is not None for log in session.logs)


def _rms(session: Session) -> float:
    """Of the current (A), in the log where it is largest."""
    currents = [log.command if log.current is None else log.current for log in session.logs]
    squares = (float(np.mean(current * current)) for current in currents if current is not None)
    return math.sqrt(max(squares, default=0.0))


def _density(repeated: Sequence[Sequence[Log]], name: str, white: float, dt: float) -> tuple[Array, Array]:
    """Frequencies (f,) Hz and density (f,) of what repeats of a column differ by.

    Nowhere below that of a `white` noise of this standard deviation, and equal to it where nothing was repeated.
    """
    signals = [deviation for logs in repeated for deviation in _deviations(logs, name)]
    frequency, power = whitening.density(signals, dt) if signals else (np.array([0.0, 0.5 / dt]), np.zeros(2))
    least = max(2.0 * dt * white * white, thresholds.LEAST_DENSITY * float(power.max()), 1e-300)
    return frequency, np.maximum(power, least)


def _deviations(repeats: Sequence[Log], name: str) -> list[Array]:
    """Of each repeat from their mean, as large as a single one's noise."""
    columns = [getattr(log, name) for log in repeats]
    if any(values is None for values in columns):
        return []
    rows = min(len(values) for values in columns)
    return list(whitening.single_noise([values[:rows] for values in columns], [log.start for log in repeats]))


def predict(p: PlannedRun, model: stage.Stage, shift: float = 0.0) -> Prediction:
    """The prediction of `model` with its current logged late by `shift` (s), without noise."""
    rows = closed_loop(p.rollout, model, thresholds.SUBSTEPS)
    position = column(rows, "measured") - p.rollout.setpoints[:, 0]
    current = column(rows, "measured_current" if p.measured else "current")
    if not (np.isfinite(position).all() and np.isfinite(current).all()):
        return Prediction(np.full(2 * len(rows[::KEPT]), np.nan), math.inf)
    columns = [_whitened(p, position, p.noise.position, 0.0), _whitened(p, current, p.noise.current, shift)]
    return Prediction(without_drift_at_rest(np.stack(columns, axis=1), p.rests).T.ravel(), float(np.abs(current).max()))


def _whitened(p: PlannedRun, signal: Array, density: Array, late: float) -> Array:
    """Every second sample (m,) of the signal, filtered so that noise of that density would have a variance of one.

    Above the roll-off it counts less, as in the cuts of the diagnosis: impacts ring there at instants that no model
    predicts.
    """
    dt = p.rollout.dt
    frequency = np.fft.rfftfreq(len(signal), dt)
    gain = np.sqrt(2.0 * KEPT * dt / np.interp(frequency, p.noise.frequency, density))
    gain = gain * (frequency <= BAND / dt) / whitening.roll_off(frequency, dt)
    turned = gain * np.exp(-2j * math.pi * late * frequency)
    return np.fft.irfft(np.fft.rfft(signal) * turned, len(signal))[::KEPT]


def shift_slope(p: PlannedRun, values: Array) -> Array:
    """Change of a prediction (m,) by a current that is logged one period later: less its slope.

    Zero where no current is measured, as then it has no clock of its own.
    """
    half = len(values) // 2
    change = np.zeros(len(values))
    if p.measured:
        change[half:] = -np.gradient(values[half:]) / KEPT
    return change
