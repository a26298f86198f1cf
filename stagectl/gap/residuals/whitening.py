"""The loop cut open: what drive and mechanics lack, each brought to the same ground by the noise of repeats.

::

    cut B, drive       measured current - current of the drive model                A
    cut C, mechanics   effort that keeps the model on the measured path             N m | N

A whitening filter, zero-phase and made from the differences between repeats (never from what a model lacks),
gives both the unit of one standard deviation of noise at every frequency of the band.  All that follows is linear:
residuals and candidates pass the same filter.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.signal import welch

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.model_tracking import Lacking

BAND = 0.2  # of the sampling frequency: 400 Hz at 2 kHz
# Of the sampling frequency, 40 Hz at 2 kHz: above, the weight of an effort falls with the frequency, as what a servo
# axis makes of it does.  Impacts and bounces ring there, whose instants no model foretells.  A current knows none.
ROLL_OFF = 0.02
KEPT = 2  # every second sample: the band is below half of what is left
_SEGMENT = 512
_SMALLEST = 1e-6  # of the largest noise density: a lower one is a lack of data, not of noise


@dataclass(frozen=True, eq=False)
class Whitener:
    """1/sqrt(noise density) of both cuts over frequency; one is made for a diagnosis, and known by its identity."""

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
    """(m, 2) effort and current, in standard deviations of a repeat's noise, every `KEPT`-th sample.

    A zero-phase filter over the signal and its mirror image, so that neither end rings into the other: what a cosine
    transform does.
    """
    count = len(lacks.effort)
    gains = _gains(p, count, dt)
    return np.stack([_filtered(one, gain) for one, gain in zip(lacks, gains, strict=True)], axis=1)


def _filtered(signal: Array, gain: Array | None) -> Array:
    kept = len(signal[::KEPT])
    if gain is None or not signal.any():
        return np.zeros(kept)
    mirrored = np.concatenate([signal, signal[: len(signal) - len(gain) - 1 : -1]])
    with np.errstate(over="ignore", invalid="ignore"):  # a simulation that diverged stays what it is
        filtered: Array = fft.idct(fft.dct(mirrored) * gain)[: len(signal) : KEPT]
    return filtered


@functools.lru_cache(maxsize=256)
def _gains(p: Whitener, count: int, dt: float) -> tuple[Array | None, Array | None]:
    """Of both cuts at each line of a transform of `count` rows, filled up to a length that transforms fast."""
    rows = fft.next_fast_len(count, real=True)
    found = gains(p, np.arange(rows) / (2.0 * dt * rows), dt)
    effort, current = (one if one.any() else None for one in found)
    return effort, current


def gains(p: Whitener, lines: Array, dt: float) -> tuple[Array, Array]:
    """Of both cuts at the frequencies `lines` (f,) Hz, for signals of the control period `dt` (s)."""
    # A density of one over the band becomes a variance of one.
    shape = math.sqrt(dt / BAND) * _edge(lines, BAND / dt)
    effort = np.interp(lines, p.frequency, p.effort) * shape / np.hypot(1.0, lines * dt / ROLL_OFF)
    return effort, np.interp(lines, p.frequency, p.current) * shape


def _edge(lines: Array, limit: float) -> Array:
    """One within the band, falling to zero over its last tenth."""
    edge: Array = np.clip((limit - lines) / (0.1 * limit), 0.0, 1.0)
    return edge
