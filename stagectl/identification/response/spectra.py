"""Spectra of the excited span of a capture: velocity, current and instrument, one spectrum a period.

While the axis follows a motion, the motion's velocity is subtracted and the spectra are of two periods under a Hann
window, half overlapping, so that the motion does not leak into the lines.

Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2012, chapters 2 and 4.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal
from stagectl.identification.response.sampling_correction import Complex, velocity


class Spectra(NamedTuple):
    """One span's spectra (periods, m), and how strong the lines are that were not excited."""

    velocity: Complex
    current: Complex
    instrument: Complex
    distortion: float
    relay: complex
    dependence: float  # by how much the spectra's dependence raises the variance of their mean


def reference_velocity(capture: Capture, edges: NDArray[np.int64]) -> Array | None:
    """Velocity of the motion that the axis follows in the span, (n,) of the whole capture; None where it is at rest."""
    if capture.reference is None or not np.ptp(capture.reference[edges[0] : edges[-1]]) > 0.0:
        return None
    return np.asarray(np.gradient(capture.reference, capture.dt), dtype=np.float64)


def keeps_moving(capture: Capture, edges: NDArray[np.int64]) -> bool:
    """Whether the axis kept moving, so that the excitation did not reverse its friction."""
    sign = np.sign(velocity(capture)[edges[0] : edges[-1]])
    if max(float(np.mean(sign > 0.0)), float(np.mean(sign < 0.0))) >= thresholds.STEADY_SIGN:
        return True
    reference = reference_velocity(capture, edges)
    if reference is None:
        return False
    return float(np.mean(sign == np.sign(reference[edges[0] : edges[-1]]))) >= thresholds.FOLLOWING_SIGN


def _segments(capture: Capture, edges: NDArray[np.int64]) -> list[tuple[int, int, Array]]:
    """First row, end and window of each spectrum: single periods, or two at a time where a motion goes on."""
    if len(edges) < 3 or reference_velocity(capture, edges) is None:
        return [(a, b, np.ones(b - a)) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]
    pairs = zip(edges[:-2].tolist(), edges[2:].tolist(), strict=True)
    return [(a, b, signal.windows.hann(b - a, sym=False)) for a, b in pairs]


def base_frequency(frequency: Array) -> float:
    """Greatest frequency of which all are multiples (Hz), by Euclid's rule."""
    common = float(frequency[0])
    for other in frequency[1:].tolist():
        a, b = common, other
        while b > 1e-4 * common:
            a, b = b, abs(a - round(a / b) * b)
        common = a
    return common


def signals(capture: Capture, edges: NDArray[np.int64]) -> Array:
    """Velocity, current, instrument (n, 3); the velocity without the motion and without its drift over the span."""
    speed, reference = velocity(capture), reference_velocity(capture, edges)
    if reference is not None:
        speed = speed - reference
    if len(edges) > 2:  # the periods' means hold no excitation, so a line through them is drift and nothing else
        middle = 0.5 * (edges[1:] + edges[:-1])
        means = [float(np.mean(speed[a:b])) for a, b in itertools.pairwise(edges.tolist())]
        slope, _ = np.polyfit(middle, means, 1)
        speed = speed - slope * (np.arange(len(speed)) - middle[0])
    instrument = capture.current if capture.excitation is None else capture.excitation
    return np.column_stack([speed, capture.current, instrument])


def sine(capture: Capture, edges: NDArray[np.int64], frequency: Array) -> Spectra:
    """One frequency by least squares with its harmonics, so that a period need not be whole samples."""
    columns, segments = signals(capture, edges), _segments(capture, edges)
    shortest = len(min(segments, key=lambda segment: len(segment[2]))[2])
    count = max(1, min(thresholds.HARMONICS, int(0.4 / (capture.dt * frequency[0])), (shortest - 6) // 6))
    spectra = []
    for a, b, window in segments:
        turn = 2.0 * np.pi * frequency[0] * capture.dt * np.arange(a, b)[:, None] * np.arange(1, count + 1)
        basis = np.hstack([np.ones((b - a, 1)), np.cos(turn), np.sin(turn)])
        weighted = basis.T * window
        # Nearly orthogonal, so the normal equations suffice.
        fit = np.linalg.solve(weighted @ basis, weighted @ columns[a:b])
        spectra.append(fit[1 : count + 1] - 1j * fit[count + 1 :])
    lines = np.array(spectra)  # (segments, harmonics, columns)
    mean = np.mean(lines[:, :, 0], axis=0)
    third = float(abs(mean[2] / mean[0])) if count >= 3 and mean[0] != 0.0 else math.nan
    dependence = 1.0 if np.all(segments[0][2] == 1.0) else thresholds.HANN_OVERLAP
    speed = velocity(capture)
    drift = np.array([float(np.mean(speed[a:b])) for a, b, _ in segments])
    return Spectra(lines[:, :1, 0], lines[:, :1, 1], lines[:, :1, 2], third, _relay(lines[:, :, 0], drift), dependence)


def _relay(harmonics: Complex, drift: Array) -> complex:
    """Fundamental of the sign of a velocity with `harmonics` (segments, k) and means `drift` (segments,), averaged.

    The velocity's own fundamental has phase zero.  Near standstill the velocity is not a sine: its sign changes early
    or late, which turns the fundamental.  While the axis drifts, as after a sine that began at full size, its sign
    changes less, which makes the fundamental small.
    """
    turn = np.exp(2j * np.pi * np.arange(4096)[:, None] / 4096.0 * np.arange(1, harmonics.shape[1] + 1))
    parts = [
        2.0 * np.mean(np.sign(np.real(turn @ line) + mean) * np.conj(turn[:, 0])) * np.conj(line[0]) / abs(line[0])
        for line, mean in zip(harmonics, drift, strict=True)
        if line[0] != 0.0
    ]
    return complex(np.mean(parts)) if parts else 4.0 / math.pi


def multisine(capture: Capture, edges: NDArray[np.int64], frequency: Array) -> Spectra:
    """All lines of a period by the discrete Fourier transform; even lines of an odd multisine are distortion."""
    period, base = np.diff(edges), base_frequency(frequency)
    samples = 1.0 / (base * capture.dt)
    if np.ptp(period) > 0 or abs(samples - period[0]) > 1e-3:
        raise IdentificationError(
            f"the multisine's period is {samples:.6g} samples; must be a whole number: take a base "
            f"that is a multiple of the sampling time, {capture.dt:g} s",
            Refusal.SAMPLING,
            value=samples,
        )
    columns, segments = signals(capture, edges), _segments(capture, edges)
    windows = segments[0][2][:, None]
    blocks = np.array([columns[a:b] * windows for a, b, _ in segments])
    transformed = 2.0 / np.sum(windows) * np.fft.rfft(blocks, axis=1)
    lines, step = np.rint(frequency / base).astype(np.int64), blocks.shape[1] // int(period[0])
    even = np.arange(2 * (int(lines[0]) // 2) or 2, int(lines[-1]) + 1, 2)
    distortion = math.nan
    if np.all(lines % 2 == 1) and len(even):
        mean = np.abs(np.mean(transformed[:, :, 0], axis=0))
        distortion = float(np.sqrt(np.mean(mean[even * step] ** 2) / np.mean(mean[lines * step] ** 2)))
    excited = transformed[:, lines * step]
    dependence = 1.0 if step == 1 else thresholds.HANN_OVERLAP
    return Spectra(excited[:, :, 0], excited[:, :, 1], excited[:, :, 2], distortion, 4.0 / math.pi, dependence)
