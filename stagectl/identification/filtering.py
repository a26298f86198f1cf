"""The filtering that every column of a linear regression goes through alike, and how it follows the record.

Position through a zero-phase Butterworth low-pass of fourth order, velocity and acceleration by central differences;
the ends cut off, where the filter knows one side only; then all columns through the same zero-phase low-pass at 0.8 of
the new Nyquist frequency, and decimated ("parallel filter": filtering both sides of a linear equation keeps its
solution).

The cut-off is a tenth of the sampling rate (100 Hz at 1 kHz, the usual recipe for robots), lower where the encoder's
noise, which grows with the fifth power of the cut-off in the acceleration, would otherwise exceed a hundredth of its
variance.

Source: M. Gautier, P. Poignet, Extended Kalman filtering and weighted least squares dynamic identification of robot,
Control Engineering Practice 9(12), 2001.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from scipy import signal

from stagectl.identification.capture import Array, IdentificationError

LEAST_ROWS = 50  # left after decimation; twelve for each parameter of the smallest model
EDGE = 5.0  # periods of the cut-off frequency that are cut off at each end
SHARE = 0.1  # cut-off over sampling rate
NOISE = 0.01  # largest share of the acceleration's variance that may be encoder noise
LOWEST = 0.005  # cut-off over sampling rate below which nothing is tried
ORDER = 4


class Recipe(NamedTuple):
    """How a record is filtered."""

    cutoff: float  # Hz
    decimate: int  # rows to one
    dt: float  # s, of the record

    @property
    def edge(self) -> int:
        """Rows that are cut off at each end."""
        return math.ceil(EDGE / (self.cutoff * self.dt) - 1e-6)


class Motion(NamedTuple):
    """A filtered motion: columns (n,) in axis units."""

    position: Array
    velocity: Array
    acceleration: Array


def recipe(position: Array, dt: float, cutoff_hz: float | None = None, decimate: int | None = None) -> Recipe:
    """The recipe for `position` (n,) every `dt` (s); what is given is taken.

    Raises IdentificationError where a given one cannot be, or the record is too short for it.
    """
    if decimate is not None and decimate < 1:
        raise IdentificationError(f"decimate = {decimate}; must be at least 1, which keeps every sample")
    if cutoff_hz is not None and not 0.0 < cutoff_hz < 0.5 / dt:
        raise IdentificationError(
            f"cutoff_hz = {cutoff_hz:g} Hz; must lie in (0, {0.5 / dt:g}) Hz, below half of the sampling rate"
        )
    cutoff = _followed(position, dt) if cutoff_hz is None else cutoff_hz
    rate = cutoff if cutoff_hz is None else SHARE / dt  # a cut-off that was asked for leaves the decimation as it is
    kept = max(1, round(1.0 / (rate * dt))) if decimate is None else decimate
    found = Recipe(cutoff, kept, dt)
    least = LEAST_ROWS * kept + 2 * found.edge
    if len(position) < least:
        raise IdentificationError(f"record of {len(position)} samples; must have at least {least}: record longer")
    return found


def moved(position: Array, found: Recipe) -> Motion:
    """The motion (n,) at every row of the record."""
    b, a = signal.butter(ORDER, found.cutoff, fs=1.0 / found.dt)
    smooth = np.asarray(signal.filtfilt(b, a, position), dtype=np.float64)
    velocity = np.gradient(smooth, found.dt)
    return Motion(smooth, velocity, np.gradient(velocity, found.dt))


def thinned(columns: Array, found: Recipe) -> Array:
    """Columns (n, k) without their ends, filtered and decimated: (m, k)."""
    inside = columns[found.edge : len(columns) - found.edge]
    if found.decimate == 1:
        return inside
    return np.asarray(signal.sosfiltfilt(_low_pass(found.decimate), inside, axis=0)[:: found.decimate])


@functools.cache
def _low_pass(decimate: int) -> Array:
    """What scipy.signal.decimate would design anew at every call: Chebyshev, eighth order, 0.05 dB."""
    return np.asarray(signal.cheby1(8, 0.05, 0.8 / decimate, output="sos"))


def _followed(position: Array, dt: float) -> float:
    """A tenth of the sampling rate, or what the encoder's noise admits (Hz)."""
    cutoff, floor = SHARE / dt, _floor(position, dt)
    while cutoff > LOWEST / dt and len(position) > 2 * LEAST_ROWS:
        acceleration = moved(position, Recipe(cutoff, 1, dt)).acceleration
        noise = (2.0 * math.pi) ** 4 * floor * cutoff**5 / 5.0
        if noise <= NOISE * float(np.var(acceleration)):
            break
        cutoff *= 0.8
    return cutoff


def _floor(position: Array, dt: float) -> float:
    """Density (m^2/Hz | rad^2/Hz) of white noise in `position`, from the upper half of its spectrum."""
    if len(position) <= 2 * LEAST_ROWS:
        return 0.0
    upper = signal.sosfiltfilt(signal.butter(ORDER, 0.25 / dt, "highpass", fs=1.0 / dt, output="sos"), position)
    return float(np.var(upper)) / (0.25 / dt)
