"""The loop cut open: what drive and mechanics lack, each brought to the same ground by the noise of repeats.

::

    cut B, drive       measured current - current of the drive model                A
    cut C, mechanics   effort that keeps the model on the measured path             N m | N

A whitening filter, zero-phase and made from the differences between repeats (never from what a model lacks),
gives both the unit of one standard deviation of noise at every frequency of the band.  All that follows is linear:
residuals and candidates pass the same filter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import welch

from stagectl.gap.session import Array
from stagectl.gap.tying import Lacking

BAND = 0.2  # of the sampling frequency: 400 Hz at 2 kHz
# Of the sampling frequency, 40 Hz at 2 kHz: above, the weight falls with the frequency, as what a servo axis makes of
# an effort does.  Impacts and bounces ring there, whose instants no model foretells.
ROLL_OFF = 0.02
KEPT = 2  # every second sample: the band is below half of what is left
_SEGMENT = 512
_SMALLEST = 1e-6  # of the largest noise density: a lower one is a lack of data, not of noise


class Whitener(NamedTuple):
    """1/sqrt(noise density) of both cuts over frequency."""

    frequency: Array  # (f,) Hz
    effort: Array  # (f,) per N m | N
    current: Array  # (f,) per A; zero where no current is measured


def whitener(differences: list[Lacking], smallest: tuple[float, float], dt: float) -> Whitener:
    """From single noise records: the differences between repeats over sqrt 2.

    `smallest` holds the least standard deviations to believe in, of effort and current: a simulated drive has no noise
    of its own.
    """
    frequency, effort = density([one.effort for one in differences], dt)
    current = density([one.current for one in differences], dt)[1]
    least = [2.0 * dt * one * one for one in smallest]
    return Whitener(frequency, _inverse(np.maximum(effort, least[0])), _inverse(np.maximum(current, least[1])))


def density(signals: list[Array], dt: float) -> tuple[Array, Array]:
    """Mean power spectral density (f,) of `signals`, smoothed over neighbouring lines, and its frequencies (Hz)."""
    segment = min(_SEGMENT, *(len(one) for one in signals))
    found = [welch(one, 1.0 / dt, nperseg=segment) for one in signals]
    total = sum(len(one) for one in signals)
    mean = sum(spectrum * len(one) for (_, spectrum), one in zip(found, signals, strict=True)) / total
    return found[0][0], np.convolve(np.pad(mean, 2, mode="edge"), np.ones(5) / 5.0, mode="valid")


def _inverse(spectrum: Array) -> Array:
    largest = float(spectrum.max(initial=0.0))
    if largest == 0.0:
        return np.zeros_like(spectrum)
    inverse: Array = 1.0 / np.sqrt(np.maximum(spectrum, _SMALLEST * largest))
    return inverse


def whitened(p: Whitener, lacks: Lacking, dt: float) -> Array:
    """(m, 2) effort and current, in standard deviations of a repeat's noise, every `KEPT`-th sample."""
    columns = [_filtered(lacks.effort, p.frequency, p.effort, dt), _filtered(lacks.current, p.frequency, p.current, dt)]
    return np.stack(columns, axis=1)


def _filtered(signal: Array, frequency: Array, gain: Array, dt: float) -> Array:
    """Zero-phase filter of `gain` over `frequency`, mirrored at the ends so that neither rings into the other."""
    count = len(signal)
    if not gain.any() or not signal.any():
        return np.zeros(len(signal[::KEPT]))
    mirrored = np.concatenate([signal, signal[::-1]])
    lines = np.asarray(np.fft.rfftfreq(len(mirrored), dt), dtype=np.float64)
    shape = np.interp(lines, frequency, gain) * _edge(lines, BAND / dt) / np.hypot(1.0, lines * dt / ROLL_OFF)
    filtered: Array = np.fft.irfft(np.fft.rfft(mirrored) * shape, len(mirrored))[:count:KEPT]
    return filtered * math.sqrt(dt / BAND)  # a density of one over the band becomes a variance of one


def _edge(lines: Array, limit: float) -> Array:
    """One within the band, falling to zero over its last tenth."""
    edge: Array = np.clip((limit - lines) / (0.1 * limit), 0.0, 1.0)
    return edge
