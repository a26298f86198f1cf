"""Residuals of mechanics and drive in one unit: standard deviations of the noise between repeats.

::

    residual effort    effort that keeps the model on the measured path             N m | N
    missing current    measured current minus the current of the drive model        A

A zero-phase filter whitens both over the band.  It is made from the differences between repeats, never from what a
model leaves unexplained.  All that follows is linear: residuals and sensitivities pass the same filter.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.signal import periodogram

from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import thresholds
from stagectl.gap.residuals.model_tracking import ModelResidual
from stagectl.number_format import duration, percent


@dataclass(frozen=True, eq=False)
class Whitener:
    """1/sqrt(noise density) of both residuals over frequency; a diagnosis makes one, known by its identity."""

    frequency: Array  # (f,) Hz
    effort: Array  # (f,) per N m | N
    current: Array  # (f,) per A; zero where no current is measured


def whitener(noise: Sequence[ModelResidual], least: tuple[float, float], dt: float) -> Whitener:
    """The filter from `noise` records of single repeats, sampled every `dt` (s).

    Noise below `least` (N m | N, and A rms) is not believed: a simulated drive has none.
    """
    frequency, effort = density([record.effort for record in noise], dt)
    current = density([record.current for record in noise], dt)[1]
    least_effort, least_current = (2.0 * dt * deviation * deviation for deviation in least)
    return Whitener(
        frequency, _inverse_root(np.maximum(effort, least_effort)), _inverse_root(np.maximum(current, least_current))
    )


def single_noise(repeats: Sequence[Array], clock: Sequence[float]) -> Array:
    """(r, n) deviations of repeats from their mean, scaled to the noise of a single one.

    Of three repeats or more, from a straight line over the session `clock` (r,) s: what drifts is no noise.
    """
    signals, drifts = np.stack(repeats), len(repeats) > 2 and np.ptp(clock) > 0.0
    trend, _ = np.linalg.qr(np.vander(np.asarray(clock) - np.mean(clock), 2 if drifts else 1))
    left = signals - trend @ (trend.T @ signals)
    scaled: Array = np.sqrt(len(signals) / (len(signals) - trend.shape[1])) * left
    return scaled


def density(signals: Sequence[Array], dt: float) -> tuple[Array, Array]:
    """Frequencies (b,) Hz and the mean power spectral density (b,) of `signals` in bands of a third of an octave.

    The periodograms of whole signals resolve the lowest band, in which an axis moves and friction differs from one
    repeat to the next.  No mean is taken away: what repeats differ by on the whole is noise as well.
    """
    spectra = [periodogram(signal, 1.0 / dt, window="hann", detrend=False) for signal in signals]
    lines, power = (np.concatenate(parts) for parts in zip(*spectra, strict=True))
    positive = np.sort(lines[lines > 0.0])
    lowest = positive[min(thresholds.LOWEST_BAND_LINES, len(positive)) - 1]
    band = np.ceil(thresholds.BANDS_PER_OCTAVE * np.log2(np.maximum(lines / lowest, 1.0))).astype(int)
    count = np.bincount(band)
    frequency, mean = (np.bincount(band, weights)[count > 0] / count[count > 0] for weights in (lines, power))
    return frequency, mean


def _inverse_root(spectrum: Array) -> Array:
    largest = float(spectrum.max(initial=0.0))
    if largest == 0.0:
        return np.zeros_like(spectrum)
    return 1.0 / np.sqrt(np.maximum(spectrum, thresholds.LEAST_DENSITY * largest))


def whitened(p: Whitener, residual: ModelResidual, dt: float) -> Array:
    """(m, 2) effort and current in standard deviations of a repeat's noise, every `KEPT`-th sample.

    The filter runs over the signal and its mirror image (a cosine transform), so that neither end rings into the other.
    """
    filters = _filters(p, len(residual.effort), dt)
    return np.stack([_filtered(signal, gain) for signal, gain in zip(residual, filters, strict=True)], axis=1)


def _filtered(signal: Array, gain: Array | None) -> Array:
    kept = len(signal[:: thresholds.KEPT])
    if gain is None or not signal.any():
        return np.zeros(kept)
    mirrored = np.concatenate([signal, signal[: len(signal) - len(gain) - 1 : -1]])
    with np.errstate(over="ignore", invalid="ignore"):  # a simulation that diverged stays diverged
        filtered: Array = fft.idct(fft.dct(mirrored) * gain)[: len(signal) : thresholds.KEPT]
    return filtered


@functools.lru_cache(maxsize=256)
def _filters(p: Whitener, count: int, dt: float) -> tuple[Array | None, Array | None]:
    """Gains for effort and current at the lines of a transform of `count` rows, padded to a length that is fast."""
    rows = fft.next_fast_len(count, real=True)
    effort, current = gains(p, np.arange(rows) / (2.0 * dt * rows), dt)
    return effort if effort.any() else None, current if current.any() else None


def gains(p: Whitener, lines: Array, dt: float) -> tuple[Array, Array]:
    """Gains for effort and current at the frequencies `lines` (f,) Hz, for signals of the control period `dt` (s)."""
    limit = thresholds.BAND / dt
    edge = np.clip((limit - lines) / (thresholds.BAND_EDGE * limit), 0.0, 1.0)  # falls to zero at the end of the band
    shape = math.sqrt(dt / thresholds.BAND) * edge  # a density of one over the band becomes a variance of one
    effort = np.interp(lines, p.frequency, p.effort) * shape / roll_off(lines, dt)
    return effort, np.interp(lines, p.frequency, p.current) * shape


def unjudged(session: Session) -> list[str]:
    """What to say where much of the effort lies at frequencies at which a missing effort weighs little."""
    edge = thresholds.ROLL_OFF / session.dt
    driven = [log for log in session.logs if log.commanded or log.current is not None]
    spectra = [periodogram(log.driving[log.valid], 1.0 / session.dt) for log in driven]
    above, whole = np.sum([(power[lines > edge].sum(), power.sum()) for lines, power in spectra], axis=0)
    if not above > thresholds.UNJUDGED * whole:
        return []
    return [
        f"{percent(float(above / whole))} of the current's variance lies above {edge:.3g} Hz, where rows every "
        f"{duration(session.dt)} tell little of a missing effort: what repeats there, such as cogging at speed, is "
        "hardly judged; record a slower motion, or faster"
    ]


def roll_off(lines: NDArray[np.floating[Any]], dt: float) -> Array:
    """Factor (f,) by which the weight of an effort falls at the frequencies `lines` (f,) Hz."""
    attenuation: Array = np.hypot(1.0, lines * dt / thresholds.ROLL_OFF)
    return attenuation
