"""Lines of a frequency response from current to velocity, each with its variance: the measurement, before any model.

A periodic excitation over P whole periods gives a spectrum a period; with the injected current E as the instrument

    H = mean(W E*) / mean(I E*)            e_p = W_p - H I_p
    var H = sum |e_p|^2 / (P (P - 1) |mean(I E*)|^2 / mean|E|^2)
    coherence = |mean(W E*)|^2 / (mean|W|^2 mean|E|^2), or that of I with E where it is less

which is the joint input-output estimate, right in closed loop, too: what the loop does with its noise does not
repeat with E.  Without E the current takes its place.  While the axis follows a motion, the motion's velocity is taken
off and the spectra are of two periods under a Hann window, half overlapping, so that the motion does not leak into the
lines.  A record of unknown excitation is treated by Welch's method.

The lines are corrected for what the sampling does, see `response_sampling`.

Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2012, chapters 2 and 4.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.response.sampling import LEAST_CURRENT, Complex, check, sampled, velocity

COHERENT = 0.9  # least coherence of a line that is used
SEGMENTS = 12  # of Welch's method, at least, half overlapping
LEAST_SAMPLES = 12  # of a stretch that a sine is fitted to, and six more for each harmonic
HARMONICS = 9  # of a sine that are fitted with it, so that the friction's own do not leak into it
STEADY_SIGN = 0.999  # least share of the velocities in one direction of an axis that is kept moving
FOLLOWING = 0.95  # the same, in the direction of a reference that moves to and fro
OVERLAP = 11.0 / 9.0  # variance of a mean over half overlapping Hann segments, times their number


class Curve(NamedTuple):
    """Lines (m,) taken in one condition."""

    name: str
    kind: str  # sine, multisine, or welch where the excitation is not known
    amplitude: float  # A, half of peak to peak; Welch: sqrt(2) times the rms
    moving: bool  # the axis never reversed
    frequency: Array  # Hz
    response: Complex  # velocity over current, rad/(s A) | m/(s A), sampling corrected
    deviation: Array  # standard deviation of the complex response, same unit; NaN with one period
    coherence: Array  # NaN with one period
    velocity: Array  # rad/s | m/s, amplitude of each line
    relay: Complex  # fundamental of the velocity's sign, the velocity's own as phase zero: 4/pi for a pure sine
    periods: int  # least number that a line was averaged over: of periods, or of stretches of several short ones
    distortion: float  # third harmonic of a sine, even lines of an odd multisine, relative to the response; or NaN

    @property
    def sound(self) -> NDArray[np.bool_]:
        """Lines whose coherence is not poor; with one period nobody knows, and all are taken."""
        return np.isnan(self.coherence) | (self.coherence >= threshold(self.periods))


class _Spectra(NamedTuple):
    """One span's spectra (periods, m), and how strongly the lines answer that were not excited."""

    velocity: Complex
    current: Complex
    instrument: Complex
    distortion: float
    relay: complex
    dependence: float  # by how much the spectra's dependence raises the variance of their mean


def threshold(averages: int) -> float:
    """Coherence below which a line is poor: 0.9, or what chance gives one of 20 lines without any signal."""
    return float(max(COHERENT, 1.0 - 0.05 ** (1.0 / max(averages - 1, 1))))


def curves(capture: Capture, file: StageFile) -> tuple[list[Curve], list[str]]:
    """All lines of one capture, a curve for each excited span, and what is doubtful about them."""
    check(capture)
    if not (spans := capture.meta.get("excitation")):
        return _unknown(capture, file)
    notes: list[str] = []
    found: list[Curve] = []
    for span in spans:
        try:
            found.append(_span(capture, span, file))
        except IdentificationError as error:
            notes.append(str(error))
    if not found:
        raise IdentificationError(f"{capture.name}: no excited span can be used: {'; '.join(notes)}")
    return found, notes


def _span(capture: Capture, span: dict[str, Any], file: StageFile) -> Curve:
    frequency = np.array(span["frequencies"], dtype=np.float64)
    frequency = frequency[frequency < 0.4 / capture.dt]
    if not len(frequency):
        raise IdentificationError(
            f"{capture.name}: {span['frequencies'][0]:g} Hz and more was excited; a sampling time of {capture.dt:g} s "
            f"shows lines below {0.4 / capture.dt:g} Hz: excite lower, or sample faster"
        )
    period = 1.0 / _common(frequency)
    first = math.ceil(span["start"] / capture.dt - 1e-6)
    available = min(span["end"], float(capture.time[-1])) - first * capture.dt
    periods = int(available / period + 1e-6)
    if periods < 1:
        raise IdentificationError(
            f"{capture.name}: {max(available, 0.0):.4g} s are left of the excitation from {span['start']:g} s on; "
            f"must be at least one period, {period:g} s: record longer"
        )
    if len(frequency) == 1:  # a period of a few samples does not tell its sine from the mean
        together = min(periods, math.ceil(LEAST_SAMPLES * capture.dt / period))
        period, periods = period * together, periods // together
    edges = first + np.rint(np.arange(periods + 1) * period / capture.dt).astype(np.int64)
    fitted = _sine if len(frequency) == 1 else _multisine
    spectra = fitted(capture, edges, frequency)
    return _curve(capture, span, (frequency, spectra, _moving(capture, edges)), file)


def _reference(capture: Capture, edges: NDArray[np.int64]) -> Array | None:
    """Velocity of the motion that the axis follows during the span, (n,) of the whole capture; None where it stands."""
    if capture.reference is None or not np.ptp(capture.reference[edges[0] : edges[-1]]) > 0.0:
        return None
    return np.asarray(np.gradient(capture.reference, capture.dt), dtype=np.float64)


def _moving(capture: Capture, edges: NDArray[np.int64]) -> bool:
    """Whether the axis kept moving, so that the excitation did not reverse its friction."""
    moved = np.sign(velocity(capture)[edges[0] : edges[-1]])
    if max(float(np.mean(moved > 0.0)), float(np.mean(moved < 0.0))) >= STEADY_SIGN:
        return True
    asked = _reference(capture, edges)
    return asked is not None and float(np.mean(moved == np.sign(asked[edges[0] : edges[-1]]))) >= FOLLOWING


def _segments(capture: Capture, edges: NDArray[np.int64]) -> list[tuple[int, int, Array]]:
    """First row, end and window of each spectrum: single periods, or two at a time where a motion goes on."""
    if len(edges) < 3 or _reference(capture, edges) is None:
        return [(a, b, np.ones(b - a)) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]
    pairs = zip(edges[:-2].tolist(), edges[2:].tolist(), strict=True)
    return [(a, b, signal.windows.hann(b - a, sym=False)) for a, b in pairs]


def _common(frequency: Array) -> float:
    """Greatest frequency of which all are multiples (Hz), by Euclid's rule."""
    common = float(frequency[0])
    for other in frequency[1:].tolist():
        a, b = common, other
        while b > 1e-4 * common:
            a, b = b, abs(a - round(a / b) * b)
        common = a
    return common


def _columns(capture: Capture, edges: NDArray[np.int64]) -> Array:
    """Velocity, current, instrument (n, 3); the velocity without the motion and without the drift over the span."""
    speed, asked = velocity(capture), _reference(capture, edges)
    if asked is not None:
        speed = speed - asked
    if len(edges) > 2:  # the periods' means hold no excitation, so a line through them is drift and nothing else
        middle = 0.5 * (edges[1:] + edges[:-1])
        means = [float(np.mean(speed[a:b])) for a, b in itertools.pairwise(edges.tolist())]
        slope, _ = np.polyfit(middle, means, 1)
        speed = speed - slope * (np.arange(len(speed)) - middle[0])
    instrument = capture.current if capture.excitation is None else capture.excitation
    return np.column_stack([speed, capture.current, instrument])


def _sine(capture: Capture, edges: NDArray[np.int64], frequency: Array) -> _Spectra:
    """One frequency by least squares with its harmonics, so that a period need not be whole samples."""
    columns, segments = _columns(capture, edges), _segments(capture, edges)
    shortest = len(min(segments, key=lambda one: len(one[2]))[2])
    count = max(1, min(HARMONICS, int(0.4 / (capture.dt * frequency[0])), (shortest - 6) // 6))
    spectra = []
    for a, b, window in segments:
        turn = 2.0 * np.pi * frequency[0] * capture.dt * np.arange(a, b)[:, None] * np.arange(1, count + 1)
        basis = np.hstack([np.ones((b - a, 1)), np.cos(turn), np.sin(turn)])
        weighted = basis.T * window
        fit = np.linalg.solve(weighted @ basis, weighted @ columns[a:b])  # nearly orthogonal: no need for more
        spectra.append(fit[1 : count + 1] - 1j * fit[count + 1 :])
    lines = np.array(spectra)  # (segments, harmonics, columns)
    mean = np.mean(lines[:, :, 0], axis=0)
    third = float(abs(mean[2] / mean[0])) if count >= 3 and mean[0] != 0.0 else math.nan
    dependence = 1.0 if np.all(segments[0][2] == 1.0) else OVERLAP
    return _Spectra(lines[:, :1, 0], lines[:, :1, 1], lines[:, :1, 2], third, _relay(mean), dependence)


def _relay(harmonics: Complex) -> complex:
    """What a friction that knows only the velocity's sign makes of a velocity with these harmonics (k,).

    Near standstill the velocity is no sine: its sign changes early or late, and the fundamental turns.
    """
    turn = 2j * np.pi * np.arange(4096)[:, None] / 4096.0 * np.arange(1, len(harmonics) + 1)
    sign = np.sign(np.real(np.exp(turn) @ harmonics))
    fundamental = 2.0 * np.mean(sign * np.exp(-turn[:, 0])) * np.conj(harmonics[0])
    return complex(fundamental / abs(harmonics[0])) if harmonics[0] != 0.0 else 4.0 / math.pi


def _multisine(capture: Capture, edges: NDArray[np.int64], frequency: Array) -> _Spectra:
    """All lines of a period by the discrete Fourier transform; even lines of an odd multisine are distortion."""
    period, base = np.diff(edges), _common(frequency)
    if np.ptp(period) > 0 or abs(1.0 / (base * capture.dt) - period[0]) > 1e-3:
        raise IdentificationError(
            f"{capture.name}: the multisine's period is {1.0 / (base * capture.dt):.6g} samples; must be a whole "
            f"number: take a base that is a multiple of the sampling time, {capture.dt:g} s"
        )
    columns, segments = _columns(capture, edges), _segments(capture, edges)
    windows = segments[0][2][:, None]
    blocks = np.array([columns[a:b] * windows for a, b, _ in segments])
    transformed = 2.0 / np.sum(windows) * np.fft.rfft(blocks, axis=1)
    lines, step = np.rint(frequency / base).astype(np.int64), blocks.shape[1] // int(period[0])
    even = np.arange(2 * (int(lines[0]) // 2) or 2, int(lines[-1]) + 1, 2)
    distortion = math.nan
    if np.all(lines % 2 == 1) and len(even):
        mean = np.abs(np.mean(transformed[:, :, 0], axis=0))
        distortion = float(np.sqrt(np.mean(mean[even * step] ** 2) / np.mean(mean[lines * step] ** 2)))
    chosen = transformed[:, lines * step]
    dependence = 1.0 if step == 1 else OVERLAP
    return _Spectra(chosen[:, :, 0], chosen[:, :, 1], chosen[:, :, 2], distortion, 4.0 / math.pi, dependence)


def _curve(capture: Capture, span: dict[str, Any], taken: tuple[Array, _Spectra, bool], file: StageFile) -> Curve:
    frequency, (speed, current, instrument, distortion, relay, dependence), moving = taken
    periods = len(speed)
    across, through = np.mean(speed * instrument.conj(), axis=0), np.mean(current * instrument.conj(), axis=0)
    power = np.mean(np.abs(instrument) ** 2, axis=0)
    if not np.all(np.abs(through) > LEAST_CURRENT**2):
        raise IdentificationError(
            f"{capture.name}: the current between {span['start']:g} and {span['end']:g} s holds no "
            f"{frequency[int(np.argmin(np.abs(through)))]:g} Hz, which the record says was excited: was the drive "
            "enabled?"
        )
    response = across / through
    coherence, deviation = np.full((2, len(frequency)), math.nan)
    if periods > 1:
        scatter = np.sum(np.abs(speed - response * current) ** 2, axis=0) * dependence / (periods * (periods - 1))
        deviation = np.sqrt(scatter * power) / np.abs(through)
        # Within a loop's bandwidth the velocity follows E while nearly no current is left to compare it with.
        output, action = (np.mean(np.abs(column) ** 2, axis=0) * power for column in (speed, current))
        coherence = np.minimum(np.abs(across) ** 2 / output, np.abs(through) ** 2 / action)
    factor = sampled(frequency, capture, file)
    x = 2.0 * np.pi * frequency * capture.dt
    return Curve(
        capture.name,
        str(span["kind"]),
        float(span["amplitude"]),
        moving,
        frequency,
        response * factor,
        deviation * np.abs(factor),
        coherence,
        np.abs(np.mean(speed, axis=0)) * x / np.sin(x),
        np.full(len(frequency), relay, dtype=np.complex128),
        periods,
        distortion,
    )


def _unknown(capture: Capture, file: StageFile) -> tuple[list[Curve], list[str]]:
    """Welch's method, with the injected current as the instrument where there is one."""
    rate, length = 1.0 / capture.dt, 2 * (len(capture.time) // (SEGMENTS + 1))
    injected = capture.excitation is not None and bool(np.ptp(capture.excitation) > LEAST_CURRENT)
    follows = capture.reference is not None and bool(np.ptp(capture.reference) > 0.0)
    if not injected:  # then the motion is all that excites, and stays in the velocity
        capture = capture._replace(excitation=None, reference=None)
    edges = np.array([0, len(capture.time)])
    speed, current, instrument = _columns(capture, edges).T
    frequency, power = signal.welch(instrument, rate, nperseg=length)
    _, across = signal.csd(instrument, speed, rate, nperseg=length)
    _, through = signal.csd(instrument, current, rate, nperseg=length)
    _, output = signal.welch(speed, rate, nperseg=length)
    _, action = signal.welch(current, rate, nperseg=length)
    with np.errstate(divide="ignore", invalid="ignore"):
        response = across / through
        coherence = np.minimum(np.abs(across) ** 2 / (power * output), np.abs(through) ** 2 / (power * action))
    # A bin beside a line shows the line's response at a wrong frequency; of a flat spectrum nearly all bins stay.
    excited = power > 0.3 * ndimage.maximum_filter1d(power, 5)
    excited &= (power > 1e-4 * np.max(power)) & (frequency >= 4.0 * rate / length) & (frequency < 0.4 * rate)
    response, coherence, frequency = response[excited], coherence[excited], frequency[excited]
    averages = SEGMENTS * 9 // 11  # half overlapping Hann segments are worth 9/11 of independent ones
    factor = sampled(frequency, capture, file)
    deviation = np.abs(response * factor) * np.sqrt(np.maximum(1.0 - coherence, 0.0) / (coherence * averages))
    width = 1.5 * rate / length  # noise bandwidth of the Hann window
    amplitude = math.sqrt(2.0) * float(np.std(instrument))
    lines = (frequency, response * factor, deviation, coherence, np.sqrt(2.0 * width * output[excited]))
    relay = np.full(len(frequency), 4.0 / math.pi, dtype=np.complex128)
    notes = [
        f"{capture.name} does not say what was excited: treated by Welch's method, {averages} averages, lines "
        f"{rate / length:.3g} Hz apart; the amplitude is sqrt(2) times the rms. Leakage between them biases the lowest "
        "ones and is in no interval; excitations of this program are recorded with their lines, and need no window"
    ]
    if follows and not injected:
        notes.append(
            f"{capture.name} was taken in closed loop without an injected current: noise that the loop feeds back "
            "biases the response towards the inverse of the controller; inject a current (type: excited)"
        )
    return [Curve(capture.name, "welch", amplitude, _moving(capture, edges), *lines, relay, averages, math.nan)], notes
