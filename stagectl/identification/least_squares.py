"""Moving mass, friction and offset of an axis from one record of its position and force, by least squares.

::

    F = M a + Fv v + Fc sign(v) + offset

One recipe for every column, the usual one for robots: position through a zero-phase Butterworth low-pass,
velocity and acceleration by central differences; the ends cut off, where the filter knows one side only; then
force and all columns, sign(v) included, through the same zero-phase low-pass at 0.8 of the new Nyquist
frequency and decimated ("parallel filter": filtering both sides of a linear equation keeps its
solution).

Source: M. Gautier, P. Poignet, Extended Kalman filtering and weighted least squares dynamic identification of
robot, Control Engineering Practice 9(12), 2001; A. Janot, M. Gautier, M. Brunot, Data Set and Reference
Models of EMPS, Workshop on Nonlinear System Identification Benchmarks, 2019.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import signal

from stagectl.units import StageError

Array = npt.NDArray[np.floating[Any]]

LEAST_ROWS = 50  # left after decimation; twelve for each parameter
EDGE = 5.0  # periods of the cut-off frequency that are cut off at each end
JITTER = 1e-3  # largest deviation of a sample time's step from their mean, relative
BOTH_WAYS = 0.05  # least share of the samples that move in the rarer direction
WORST_CONDITION = 1e4  # of the regressor with columns of unit length


class IdentificationError(StageError):
    """A record that does not tell the parameters: what is wrong with it, and what to record instead."""


class Estimate(NamedTuple):
    """A parameter and how well the record knows it."""

    value: float
    deviation: float  # standard deviation, from the residual taken as white


class Result(NamedTuple):
    """Parameters in the units of force (N | N m) over those of position (m | rad)."""

    inertia: Estimate  # M, kg | kg m^2
    viscous: Estimate  # Fv, N s/m | N m s/rad
    coulomb: Estimate  # Fc, N | N m
    offset: Estimate  # N | N m, positive where standing still would need a positive force
    residual_percent: float  # norm of the force residual over norm of the force, both filtered and decimated
    condition: float  # of the regressor with columns of unit length, so that it has no units
    correlation: Array  # (4, 4) of the estimates, in the order above


def least_squares(
    time: Array, position: Array, force: Array, cutoff_hz: float = 100.0, order: int = 4, decimate: int = 10
) -> Result:
    """Parameters of `force` (n,) that moves `position` (n,) at equally spaced `time` (n,) s.

    Raises IdentificationError where samples are missing, not finite or not equally spaced, where the
    recipe does not fit them, and where the motion does not separate the parameters.
    """
    dt = _sampling_time(time, position, force)
    _check_recipe(len(time), dt, cutoff_hz, decimate)
    columns = _regressor(position, dt, cutoff_hz, order)
    _check_directions(columns[:, 1])
    edge = _edge(cutoff_hz, dt)
    both = np.column_stack([columns, force])[edge : len(time) - edge]
    if decimate > 1:
        both = signal.decimate(both, decimate, axis=0)
    return _solved(both[:, :4], both[:, 4])


def _regressor(position: Array, dt: float, cutoff_hz: float, order: int) -> Array:
    """Columns (n, 4): acceleration, velocity, its sign, one."""
    b, a = signal.butter(order, cutoff_hz, fs=1.0 / dt)
    velocity = np.gradient(signal.filtfilt(b, a, position), dt)
    acceleration = np.gradient(velocity, dt)
    return np.column_stack([acceleration, velocity, np.sign(velocity), np.ones(len(velocity))])


def _solved(regressor: Array, force: Array) -> Result:
    """Solve with columns of unit length: neither rounding nor the condition depends on the units."""
    length = np.linalg.norm(regressor, axis=0)
    condition = float(np.linalg.cond(regressor / length)) if np.all(length > 0.0) else math.inf
    if not condition <= WORST_CONDITION:
        raise IdentificationError(
            f"condition of the regressor = {condition:.3g}; must lie in [1, {WORST_CONDITION:g}]: the motion "
            "does not separate the parameters; record accelerations and several speeds in both directions"
        )
    scaled, *_ = np.linalg.lstsq(regressor / length, force, rcond=None)
    residual = force - regressor / length @ scaled
    variance = float(residual @ residual) / (len(force) - 4)
    information = np.linalg.inv((regressor / length).T @ (regressor / length))
    spread = np.sqrt(np.diag(information))
    deviations = math.sqrt(variance) * spread / length
    pairs = zip((scaled / length).tolist(), deviations.tolist(), strict=True)
    inertia, viscous, coulomb, offset = (Estimate(value, deviation) for value, deviation in pairs)
    percent = 100.0 * float(np.linalg.norm(residual) / np.linalg.norm(force))
    correlation = information / np.outer(spread, spread)
    return Result(inertia, viscous, coulomb, offset, percent, condition, correlation)


def _edge(cutoff_hz: float, dt: float) -> int:
    return math.ceil(EDGE / (cutoff_hz * dt) - 1e-6)


def _sampling_time(time: Array, position: Array, force: Array) -> float:
    """Mean step of `time` (s), once all columns are sound."""
    for name, column, unit in (("time", time, "s"), ("position", position, "m"), ("force", force, "N")):
        if np.shape(column) != (len(time),):
            raise IdentificationError(f"{name} has shape {np.shape(column)}; must be ({len(time)},) as time")
        if not np.all(np.isfinite(column)):
            row = int(np.argmin(np.isfinite(column)))
            raise IdentificationError(
                f"{name}[{row}] = {column[row]} {unit}; must be finite: cut the record to a part without gaps"
            )
    if len(time) < 2:
        raise IdentificationError(f"record of {len(time)} samples; must have more: record longer")
    dt = float(time[-1] - time[0]) / (len(time) - 1)
    steps = np.diff(time)
    worst = int(np.argmax(np.abs(steps - dt)))
    if not (dt > 0.0 and abs(steps[worst] - dt) <= JITTER * dt):
        raise IdentificationError(
            f"time[{worst + 1}] - time[{worst}] = {steps[worst]:g} s; must lie within {100.0 * JITTER:g} % "
            f"of the mean step, {dt:g} s: resample the record, or cut it to a part without gaps"
        )
    return dt


def _check_recipe(rows: int, dt: float, cutoff_hz: float, decimate: int) -> None:
    if decimate < 1:
        raise IdentificationError(f"decimate = {decimate}; must be at least 1, which keeps every sample")
    if not 0.0 < cutoff_hz < 0.5 / dt:
        raise IdentificationError(
            f"cutoff_hz = {cutoff_hz:g} Hz; must lie in (0, {0.5 / dt:g}) Hz, below half of the sampling rate"
        )
    least = LEAST_ROWS * decimate + 2 * _edge(cutoff_hz, dt)
    if rows < least:
        raise IdentificationError(f"record of {rows} samples; must have at least {least}: record longer")


def _check_directions(velocity: Array) -> None:
    """Without both directions Coulomb friction and offset are one number."""
    fastest = float(np.abs(velocity).max())
    share = min(float(np.mean(velocity > 0.01 * fastest)), float(np.mean(velocity < -0.01 * fastest)))
    if share < BOTH_WAYS:
        raise IdentificationError(
            f"share of the samples in the rarer direction = {share:.3g}; must lie in [{BOTH_WAYS}, 0.5]: "
            "coulomb friction and offset are separable only in a motion there and back; record one"
        )
