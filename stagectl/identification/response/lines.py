"""Lines of a frequency response from current to velocity, each with its variance: the measurement, before any model.

A periodic excitation over P whole periods gives one spectrum a period; with the injected current E as the instrument

    H = mean(W E*) / mean(I E*)            e_p = W_p - H I_p
    var H = sum |e_p|^2 / (P (P - 1) |mean(I E*)|^2 / mean|E|^2)
    coherence = |mean(W E*)|^2 / (mean|W|^2 mean|E|^2), or that of I with E where it is less

which is the joint input-output estimate.  It is right in closed loop, too: what the loop does with its noise does not
repeat with E.  Without E the current is used instead.  A record of unknown excitation is treated by Welch's method.

The lines are corrected for the sampling (`sampling_correction`).

Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2012, chapters 2 and 4.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal, check_excited
from stagectl.identification.response.dwells import dwells, injected
from stagectl.identification.response.sampling_correction import Complex, sampling_correction
from stagectl.identification.response.spectra import Spectra, base_frequency, keeps_moving, multisine, signals, sine
from stagectl.identification.result import Note, Topic


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
        """Lines whose coherence is not poor; with one period it is not known, and all lines count as sound."""
        return np.isnan(self.coherence) | (self.coherence >= coherence_threshold(self.periods))


def coherence_threshold(averages: int) -> float:
    """Coherence below which a line is poor: 0.9, or what chance gives one of 20 lines without any signal."""
    return float(max(thresholds.COHERENT, 1.0 - 0.05 ** (1.0 / max(averages - 1, 1))))


def curves(capture: Capture, file: StageFile) -> tuple[list[Curve], list[str]]:
    """All lines of one capture, a curve for each excited span, and notes on what is doubtful about them.

    Raises IdentificationError where no span can be used.
    """
    check_excited(capture)
    notes: list[str] = []
    if not (spans := capture.meta.get("excitation")):
        capture, notes = _stepped(capture)
        if not (spans := capture.meta.get("excitation")):
            return _welch(capture, file)
    measured: list[Curve] = []
    for span in spans:
        try:
            measured.append(_span(capture, span, file))
        except IdentificationError as error:
            notes.append(Note(Topic.LEFT_OUT, f"{capture.name}: {error}"))
            reason = error.reason
    if not measured:
        raise IdentificationError(f"no excited span can be used: {'; '.join(notes)}", reason)
    return measured, notes


def _stepped(capture: Capture) -> tuple[Capture, list[str]]:
    """The capture with the stepped sines that its data show; as it is where they show none."""
    if not (stepped := dwells(capture)):
        return capture, []
    if not injected(capture):  # then the motion is all that excites, and stays in the velocity
        capture = capture._replace(excitation=None, reference=None)
    lines = sorted(dwell.frequencies[0] for dwell in stepped)
    text = (
        f"{capture.name} does not say what was excited: its current shows {len(stepped)} stretches of one frequency "
        f"each, {lines[0]:.3g} to {lines[-1]:.3g} Hz, and each is fitted by a sine with its harmonics"
    )
    # Conditions are told apart by their amplitude.
    spans = [{**dwell._asdict(), "amplitude": float(f"{dwell.amplitude:.2g}")} for dwell in stepped]
    return capture._replace(meta={**capture.meta, "excitation": spans}), [Note(Topic.METHOD, text)]


def _span(capture: Capture, span: dict[str, Any], file: StageFile) -> Curve:
    frequency = np.array(span["frequencies"], dtype=np.float64)
    highest = thresholds.HIGHEST_LINE / capture.dt
    frequency = frequency[frequency < highest]
    if not len(frequency):
        lowest = float(span["frequencies"][0])
        text = (
            f"{lowest:g} Hz and more was excited; a sampling time of {capture.dt:g} s "
            f"shows lines below {highest:g} Hz: excite lower, or sample faster"
        )
        raise IdentificationError(text, Refusal.SAMPLING, value=lowest, unit="Hz", admissible=f"(0, {highest:g})")
    period = 1.0 / base_frequency(frequency)
    first = math.ceil(span["start"] / capture.dt - 1e-6)
    available = min(span["end"], float(capture.time[-1])) - first * capture.dt
    periods = int(available / period + 1e-6)
    if periods < 1:
        text = (
            f"{max(available, 0.0):.4g} s are left of the excitation from {span['start']:g} s on; "
            f"must be at least one period, {period:g} s: record longer"
        )
        raise IdentificationError(text, Refusal.TOO_SHORT, value=available, unit="s", admissible=f"[{period:g}, inf)")
    if len(frequency) == 1:  # in a period of a few samples a sine cannot be separated from the mean
        together = min(periods, math.ceil(thresholds.SINE_SAMPLES * capture.dt / period))
        period, periods = period * together, periods // together
    edges = first + np.rint(np.arange(periods + 1) * period / capture.dt).astype(np.int64)
    spectra = (sine if len(frequency) == 1 else multisine)(capture, edges, frequency)
    return _curve(capture, span, (frequency, spectra, keeps_moving(capture, edges)), file)


def _curve(capture: Capture, span: dict[str, Any], measured: tuple[Array, Spectra, bool], file: StageFile) -> Curve:
    frequency, (speed, current, instrument, distortion, relay, dependence), moving = measured
    periods = len(speed)
    across, through = np.mean(speed * instrument.conj(), axis=0), np.mean(current * instrument.conj(), axis=0)
    power = np.mean(np.abs(instrument) ** 2, axis=0)
    if not np.all(np.abs(through) > thresholds.LEAST_EXCITATION**2):
        missing = float(frequency[int(np.argmin(np.abs(through)))])
        text = (
            f"the current between {span['start']:g} and {span['end']:g} s holds no {missing:g} Hz, "
            "which was excited according to the record: was the drive enabled?"
        )
        raise IdentificationError(text, Refusal.NO_EXCITATION, value=missing, unit="Hz")
    response = across / through
    coherence, deviation = np.full((2, len(frequency)), math.nan)
    if periods > 1:
        scatter = np.sum(np.abs(speed - response * current) ** 2, axis=0) * dependence / (periods * (periods - 1))
        deviation = np.sqrt(scatter * power) / np.abs(through)
        # Within a loop's bandwidth the velocity follows E while nearly no current is left to compare it with.
        output, action = (np.mean(np.abs(column) ** 2, axis=0) * power for column in (speed, current))
        coherence = np.minimum(np.abs(across) ** 2 / output, np.abs(through) ** 2 / action)
    factor = sampling_correction(frequency, capture, file)
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


def _welch(capture: Capture, file: StageFile) -> tuple[list[Curve], list[str]]:
    """Welch's method, with the injected current as the instrument where there is one."""
    rate, length = 1.0 / capture.dt, 2 * (len(capture.time) // (thresholds.WELCH_SEGMENTS + 1))
    follows = capture.reference is not None and bool(np.ptp(capture.reference) > 0.0)
    known = injected(capture)
    if not known:
        capture = capture._replace(excitation=None, reference=None)
    edges = np.array([0, len(capture.time)])
    speed, current, instrument = signals(capture, edges).T
    frequency, power = signal.welch(instrument, rate, nperseg=length)
    _, across = signal.csd(instrument, speed, rate, nperseg=length)
    _, through = signal.csd(instrument, current, rate, nperseg=length)
    _, output = signal.welch(speed, rate, nperseg=length)
    _, action = signal.welch(current, rate, nperseg=length)
    with np.errstate(divide="ignore", invalid="ignore"):
        response = across / through
        coherence = np.minimum(np.abs(across) ** 2 / (power * output), np.abs(through) ** 2 / (power * action))
    # A bin next to a line shows the line's response at a wrong frequency; of a flat spectrum nearly all bins stay.
    excited = power > thresholds.WELCH_NEIGHBOUR * ndimage.maximum_filter1d(power, 5)
    excited &= power > thresholds.WELCH_FLOOR * np.max(power)
    excited &= (frequency >= thresholds.WELCH_LOWEST * rate / length) & (frequency < thresholds.HIGHEST_LINE * rate)
    response, coherence, frequency = response[excited], coherence[excited], frequency[excited]
    averages = thresholds.WELCH_SEGMENTS * 9 // 11  # half overlapping Hann segments count 9/11 of independent ones
    factor = sampling_correction(frequency, capture, file)
    deviation = np.abs(response * factor) * np.sqrt(np.maximum(1.0 - coherence, 0.0) / (coherence * averages))
    width = 1.5 * rate / length  # noise bandwidth of the Hann window
    amplitude = math.sqrt(2.0) * float(np.std(instrument))
    lines = (frequency, response * factor, deviation, coherence, np.sqrt(2.0 * width * output[excited]))
    relay = np.full(len(frequency), 4.0 / math.pi, dtype=np.complex128)
    moving = keeps_moving(capture, edges)
    curve = Curve(capture.name, "welch", amplitude, moving, *lines, relay, averages, math.nan)
    return [curve], _welch_notes(capture.name, averages, rate / length, follows and not known)


def _welch_notes(name: str, averages: int, spacing: float, loop_noise: bool) -> list[str]:
    notes: list[str] = [
        Note(
            Topic.METHOD,
            f"{name} does not say what was excited: treated by Welch's method, {averages} averages, lines "
            f"{spacing:.3g} Hz apart; the amplitude is sqrt(2) times the rms. Leakage between them biases the lowest "
            "ones and is in no interval; excitations of this program are recorded with their lines and need no window",
        )
    ]
    if loop_noise:
        text = (
            f"{name} was taken in closed loop without an injected current: noise that the loop feeds back biases the "
            "response towards the inverse of the controller; inject a current (type: excited)"
        )
        notes.append(Note(Topic.REFERENCE, text))
    return notes
