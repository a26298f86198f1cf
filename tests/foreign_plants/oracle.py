"""Intervals of estimators that know the friction law: what no identification can be much better than.

Both fit the balance of torque, averaged over each row of the log::

    force_constant * current = inertia * acceleration + viscous * velocity + coulomb * shape + offset + noise

by generalised least squares.  Acceleration, velocity and the shape of the friction are the machine's own, without
noise.  The noise is the machine's own as well: the rounding of the encoder, differentiated twice, and all that the
logged current misses of the true torque: its noise, what happens between two rows, ripple, cogging.  Its spectrum
weights the rows (Whittle's likelihood).

`shape known`
    The friction is known up to its size, the delay is known.
`law known`
    The delay is unknown, too, and so are the law's own parameters, such as its stiffness and its Stribeck peak.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d
from scipy.signal.windows import tukey

from tests.foreign_plants import friction
from tests.foreign_plants.capture_cases import Capture, logged_rows
from tests.foreign_plants.friction import Friction

Array = NDArray[np.float64]
PARAMETERS = ("inertia", "viscous", "coulomb")  # the first three columns
_NORMAL = 1.959964  # half width of a 95 % interval, standard deviations
_FADED = 0.2  # share of the rows that fade in or out
_CHANGE = 0.01  # relative, of a law's own parameter, for its finite difference
_OWN = {  # what `law known` has to find besides the size of the friction
    "maxwell": ("slips",),
    "dahl": ("stiffness", "exponent"),
    "lugre": ("stiffness", "damping", "static", "stribeck_speed"),
    "elastoplastic": ("stiffness", "elastic_share", "damping", "static", "stribeck_speed"),
    "gms": ("slips", "attraction", "static", "stribeck_speed"),
    "stribeck": ("smoothing", "static", "stribeck_speed"),
}


class Oracle(NamedTuple):
    """Half widths of 95 % intervals by parameter, of both estimators, and their estimates."""

    shape_known: dict[str, float]
    law_known: dict[str, float]
    estimates: dict[str, float]  # of `shape known`, from this log's own noise; the delay is that of `law known`


class _Balance(NamedTuple):
    """The averaged balance of torque over n rows."""

    regressors: Array  # (n, 4): acceleration, velocity, shape of friction, 1
    further: Array  # (n, m): what the delay changes of `torque`, and each of the law's parameters of the friction
    torque: Array  # (n,) N m, as the log's current shows it
    rounding: Array  # (n + 2,) rad, measured minus true position at the rows


def oracle(capture: Capture) -> Oracle:
    """Both oracles' intervals for this capture."""
    balance, truth = _balance(capture), capture.truth
    known = np.array([truth.inertia, truth.viscous, truth.coulomb, capture.plant.mechanics.offset])
    missed = balance.torque - balance.regressors @ known
    row, rounding = capture.setting.row, balance.rounding
    density = _density(missed) + _rounding_density(capture, len(missed))
    bent = truth.inertia * np.diff(rounding, 2) / row**2 + truth.viscous * np.diff(rounding)[1:] / row
    shape, estimate = _fit(balance.regressors, missed - bent, density)
    law, corrections = _fit(np.hstack([balance.regressors, balance.further]), missed - bent, density)
    delay = balance.regressors.shape[1]
    widths = {**_named(_NORMAL * law), "delay": float(_NORMAL * law[delay])}
    estimates = {**_named(known + estimate), "delay": float(truth.delay - corrections[delay])}
    return Oracle(_named(_NORMAL * shape), widths, estimates)


def _named(values: Array) -> dict[str, float]:
    return dict(zip(PARAMETERS, map(float, values), strict=False))


def _balance(capture: Capture) -> _Balance:
    """The rows from the third on, so that each has two predecessors for the rounding's differences."""
    plant, trace, row = capture.plant, capture.trace, capture.setting.row
    ticks = round(plant.controller.period / plant.step)
    age = round(plant.encoder.age / plant.step)
    lost = math.ceil(capture.truth.delay / row)  # rows whose current was logged before the log began
    ends = logged_rows(capture.setting, plant)[lost:] * ticks - age
    means = (np.diff(trace.velocity[ends]) / row, np.diff(trace.position[ends]) / row)
    shape = _averaged(trace.friction, ends) / plant.friction.coulomb
    torque, slope = _shown(capture, lost)
    regressors = np.column_stack([*means, shape, np.ones(len(shape))])[1:]
    further = np.column_stack([slope, *_law_sensitivities(capture, ends)])[1:]
    rounding = capture.columns["position_rad"][lost:] - trace.position[ends]
    return _Balance(regressors, further, torque[1:], rounding)


def _averaged(values: Array, ends: NDArray[np.int64]) -> Array:
    """Mean of a value per step over each row."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray(np.diff(total[ends]) / np.diff(ends), dtype=np.float64)


def _shown(capture: Capture, lost: int) -> tuple[Array, Array]:
    """The torque over each row as the log's current shows it at the true delay, and its slope over the delay."""
    column = "current_A" if capture.setting.column == "measured" else "current_command_A"
    time, constant = capture.columns["time_s"], capture.plant.drive.force_constant
    curve = CubicSpline(time, constant * capture.columns[column])
    at = time[lost:] - capture.truth.delay
    torque = np.diff(curve.antiderivative()(at)) / capture.setting.row
    return torque, -np.diff(curve(at)) / capture.setting.row


def _law_sensitivities(capture: Capture, ends: NDArray[np.int64]) -> list[Array]:
    """What the friction changes with each of the law's own parameters, along the true path."""
    f = capture.plant.friction
    base = _averaged(_friction_along(capture, f), ends)
    changes = []
    for name in _OWN[capture.setting.law]:
        changed = f._replace(**{name: getattr(f, name) * (1.0 + _CHANGE)})
        changes.append((_averaged(_friction_along(capture, changed), ends) - base) / _CHANGE)
    return changes


def _friction_along(capture: Capture, f: Friction) -> Array:
    return np.asarray(friction.along(f, friction.states(f), capture.trace.drift, capture.plant.step))


def _tapered(rows: Array) -> Array:
    """The spectrum of rows that fade in and out, (n // 2 + 1, ...): a noise that was differentiated leaks else."""
    window = tukey(len(rows), _FADED)
    window /= math.sqrt(np.mean(window**2))
    return np.asarray(np.fft.rfft((window * rows.T).T, axis=0))


def _density(missed: Array) -> Array:
    """Spectral density of a noise, per row and smoothed over frequency; (n // 2 + 1,)."""
    periodogram = np.abs(_tapered(missed - missed.mean())) ** 2 / len(missed)
    smooth = uniform_filter1d(periodogram[1:], max(9, len(missed) // 100), mode="nearest")
    return np.asarray(np.concatenate([smooth[:1], smooth]), dtype=np.float64)


def _rounding_density(capture: Capture, rows: int) -> Array:
    """Of the encoder's rounding, differentiated twice."""
    row, truth = capture.setting.row, capture.truth
    turn = np.exp(-2j * math.pi * np.fft.rfftfreq(rows))
    passed = truth.inertia * (1.0 - turn) ** 2 / row**2 + truth.viscous * (1.0 - turn) / row
    return np.asarray(np.abs(passed) ** 2 * capture.plant.encoder.step**2 / 12.0, dtype=np.float64)


def _fit(regressors: Array, torque: Array, density: Array) -> tuple[Array, Array]:
    """Standard deviations and estimates by generalised least squares, rows weighted in frequency."""
    double = np.full(len(density), 2.0)
    double[0] = 1.0
    if len(torque) % 2 == 0:
        double[-1] = 1.0
    scale = np.linalg.norm(regressors, axis=0) + 1e-300
    weighted = _tapered(regressors / scale) * np.sqrt(double / density / len(torque))[:, None]
    aim = _tapered(torque) * np.sqrt(double / density / len(torque))
    information = np.real(weighted.conj().T @ weighted)
    covariance = np.linalg.pinv(information, hermitian=True)
    estimate = covariance @ np.real(weighted.conj().T @ aim)
    return np.sqrt(np.diag(covariance)) / scale, estimate / scale
