"""The filter that every column of a linear regression passes, and how it is chosen from the record.

The position passes a zero-phase Butterworth low-pass of fourth order; velocity and acceleration are derivatives of
cubic splines through it, which are true up to the cut-off.  Central differences are not: with a motion of 3 Hz in a log
of 100 Hz they make the inertia 1.2 % too large.  The ends, where the filter knows one side only, are cut off.  Then all
columns pass the same zero-phase low-pass at 0.8 of the new Nyquist frequency and are decimated ("parallel filter":
filtering both sides of a linear equation keeps its solution).  It lies at 0.4 of the cut-off, where the filter that
only the position passes is still neutral.

The cut-off is a tenth of the sampling rate: 100 Hz at 1 kHz, the usual choice for robots, leaves the motion far below.
In a log of 100 Hz it may not: the cut-off is higher, up to the usual one, where the low-pass would cut off more than a
tenth of the acceleration's variance, for what is left of such a motion tells friction from inertia no longer.  It is
lower where the encoder's noise would otherwise exceed a hundredth of that variance; there that noise grows with the
fifth power of the cut-off.  Noise that the encoder has not made does not show there: a regression must look for it at
lower cut-offs.

Source: M. Gautier, P. Poignet, Extended Kalman filtering and weighted least squares dynamic identification of robot,
Control Engineering Practice 9(12), 2001.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from scipy import signal
from scipy.interpolate import CubicSpline

from stagectl.identification import thresholds
from stagectl.identification.capture import Array, IdentificationError, Refusal
from stagectl.number_format import duration

ORDER = 4
PASSED = 0.4  # of the cut-off: 0.8 of the Nyquist frequency after the decimation


class FilterDesign(NamedTuple):
    """How a record is filtered."""

    cutoff: float  # Hz
    decimate: int  # rows to one
    dt: float  # s, of the record

    @property
    def edge(self) -> int:
        """Rows that are cut off at each end."""
        return math.ceil(thresholds.FILTER_EDGE / (self.cutoff * self.dt) - 1e-6)


class FilteredMotion(NamedTuple):
    """A filtered motion: columns (n,) in axis units."""

    position: Array
    velocity: Array
    acceleration: Array


def design_filter(position: Array, dt: float, share: float = 1.0) -> FilterDesign:
    """The filter for `position` (n,) every `dt` (s), with this `share` of the cut-off that suits its encoder.

    Raises IdentificationError where the record is too short for it.
    """
    cutoff = share * _automatic_cutoff(position, dt)
    kept = max(1, round(1.0 / (cutoff * dt)))
    design = FilterDesign(cutoff, kept, dt)
    least = thresholds.FILTERED_LEAST_ROWS * kept + 2 * design.edge
    if len(position) < least:
        length, shortest = duration(dt * len(position)), duration(dt * least)
        text = (
            f"record of {len(position)} samples, {length}; must have at least {least}, {shortest}, for its low-pass at "
            f"{cutoff:.3g} Hz: record longer"
        )
        raise IdentificationError(text, Refusal.TOO_SHORT, value=len(position), admissible=f"[{least}, inf)")
    return design


def filtered_motion(position: Array, design: FilterDesign) -> FilteredMotion:
    """The motion (n,) at every row of the record."""
    b, a = signal.butter(ORDER, design.cutoff, fs=1.0 / design.dt)
    smooth = np.asarray(signal.filtfilt(b, a, position), dtype=np.float64)
    velocity = slope(smooth, design.dt)
    return FilteredMotion(smooth, velocity, slope(velocity, design.dt))


def slope(columns: Array, dt: float) -> Array:
    """Derivative of columns (n, ...) with a row every `dt` (s): that of the cubic spline through each."""
    time = dt * np.arange(len(columns))
    return np.asarray(CubicSpline(time, columns)(time, 1), dtype=np.float64)


def decimated(columns: Array, design: FilterDesign) -> Array:
    """Columns (n, k) without their ends, filtered and decimated: (m, k)."""
    inside = columns[design.edge : len(columns) - design.edge]
    if design.decimate == 1:
        return inside
    return np.asarray(signal.sosfiltfilt(_low_pass(design.decimate), inside, axis=0)[:: design.decimate])


@functools.cache
def _low_pass(decimate: int) -> Array:
    """What scipy.signal.decimate would design anew at every call: Chebyshev, eighth order, 0.05 dB."""
    return np.asarray(signal.cheby1(8, 0.05, 0.8 / decimate, output="sos"))


def _automatic_cutoff(position: Array, dt: float) -> float:
    """A tenth of the sampling rate; more where the motion has it, less where the encoder's noise requires it (Hz)."""
    usual = thresholds.CUTOFF_SHARE / dt
    if len(position) <= 2 * thresholds.FILTERED_LEAST_ROWS:
        return usual
    highest = max(usual, min(thresholds.HIGHEST_CUTOFF * usual, thresholds.USUAL_CUTOFF))
    cutoff, density = highest, _noise_density(position, dt)
    while True:
        acceleration = filtered_motion(position, FilterDesign(cutoff, 1, dt)).acceleration
        noise = (2.0 * math.pi) ** 4 * density * cutoff**5 / 5.0
        quiet = noise <= thresholds.ACCELERATION_NOISE * float(np.var(acceleration))
        if quiet or cutoff <= thresholds.LOWEST_CUTOFF_SHARE / dt:
            break
        cutoff *= 0.8
    return min(cutoff, max(usual, _fastest(acceleration, dt) / PASSED))


def _fastest(acceleration: Array, dt: float) -> float:
    """The frequency (Hz) above which the share `CUT_MOTION` of the acceleration's variance lies."""
    frequency, power = signal.periodogram(acceleration, 1.0 / dt, "hann")
    above = np.cumsum(power[::-1])[::-1] > thresholds.CUT_MOTION * float(np.sum(power))
    return float(np.max(frequency[above], initial=0.0))


def _noise_density(position: Array, dt: float) -> float:
    """Density (m^2/Hz | rad^2/Hz) of white noise in `position`, from the upper half of its spectrum."""
    upper = signal.sosfiltfilt(signal.butter(ORDER, 0.25 / dt, "highpass", fs=1.0 / dt, output="sos"), position)
    return float(np.var(upper)) / (0.25 / dt)
