"""Stepped sines in a record that does not say what was excited: stretches of one frequency and amplitude.

The excitation's rising zero crossings give its periods, each as long as it is, so that 1 Hz and 100 Hz need no common
window.  Consecutive periods of one length and one size are a dwell.  Its frequency is then refined by the turn of the
fitted sine's phase from its first to its second half; a sweep turns further within a half than noise does, and is no
dwell.
"""

import itertools

import numpy as np

from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture
from stagectl.trajectories import Span


def dwells(capture: Capture) -> list[Span]:
    """The stepped sines of a record, in their order; none where they do not carry most of its excitation."""
    signal = _excitation(capture)
    signal = signal - np.median(signal)
    found = []
    for run in _runs(signal):  # the last period may end in the next dwell
        dwell = _dwell(signal, run, capture.dt) or _dwell(signal, run[:-1], capture.dt)
        found += [dwell] if dwell else []
    carried = sum(0.5 * dwell.amplitude**2 * (dwell.end - dwell.start) for dwell in found)
    power = float(signal @ signal) * capture.dt
    return found if carried >= thresholds.DWELL_POWER * power else []


def injected(capture: Capture) -> bool:
    """Whether the record holds a current that was added to its command."""
    return capture.excitation is not None and bool(np.ptp(capture.excitation) > thresholds.LEAST_EXCITATION)


def _excitation(capture: Capture) -> Array:
    """The injected current where there is one, else the current."""
    return capture.excitation if capture.excitation is not None and injected(capture) else capture.current


def _crossings(signal: Array) -> Array:
    """Instants (rows, with fractions) at which the signal rises through zero, from far below to far above it."""
    noise = float(np.median(np.abs(np.diff(signal, 2)))) / 1.65  # of second differences of white noise
    far = max(thresholds.DWELL_NOISE * noise, thresholds.DWELL_FLOOR * float(np.abs(signal).max()))
    side = np.zeros(len(signal), dtype=np.int8)
    side[signal > far], side[signal < -far] = 1, -1
    outside = np.flatnonzero(side)
    turns = np.flatnonzero((side[outside[:-1]] < 0) & (side[outside[1:]] > 0))
    return np.array([_zero(signal, int(outside[k]), int(outside[k + 1])) for k in turns], dtype=np.float64)


def _zero(signal: Array, below: int, above: int) -> float:
    """Where a straight line through the rows from `below` to `above` is zero."""
    rows = np.arange(below, above + 1)
    middle, level = 0.5 * (below + above), float(np.mean(signal[below : above + 1]))
    slope = float((rows - middle) @ signal[below : above + 1]) / float((rows - middle) @ (rows - middle))
    return min(max(middle - level / slope, below), above) if slope > 0.0 else middle


def _runs(signal: Array) -> list[Array]:
    """Crossings (p + 1,) of consecutive periods that agree in length and in size."""
    crossings = _crossings(signal)
    if len(crossings) <= thresholds.DWELL_PERIODS:
        return []
    sizes = [float(np.ptp(signal[round(a) : max(round(b), round(a) + 2)])) for a, b in itertools.pairwise(crossings)]
    lengths = np.diff(crossings)
    runs: list[Array] = []
    begin = 0
    for k in range(1, len(lengths) + 1):
        if k < len(lengths) and _agree(lengths[begin : k + 1], sizes[begin : k + 1]):
            continue
        if k - begin >= thresholds.DWELL_PERIODS:
            runs.append(crossings[begin : k + 1])
        begin = k
    return runs


def _agree(lengths: Array, sizes: list[float]) -> bool:
    """Whether the last period is like those before it."""
    usual, size = float(np.median(lengths[:-1])), float(np.median(sizes[:-1]))
    same_length = abs(lengths[-1] - usual) <= thresholds.DWELL_LENGTH * usual + thresholds.DWELL_ROWS
    return bool(same_length and abs(sizes[-1] - size) <= thresholds.DWELL_SIZE * size)


def _dwell(signal: Array, crossings: Array, dt: float) -> Span | None:
    """The settled part of a run, where one frequency explains it."""
    settling = max(1, round(thresholds.DWELL_SETTLING * (len(crossings) - 1)))
    first, last = int(np.ceil(crossings[settling])), int(crossings[-1])
    frequency = (len(crossings) - 1) / float(crossings[-1] - crossings[0])  # a row
    if last - first < thresholds.SINE_SAMPLES:
        return None
    part = signal[first:last]
    for _ in range(3):
        turn, sine, left = _fitted(part, frequency)
        frequency += turn
    bent = abs(_bend(part, frequency))
    if left > thresholds.DWELL_LEFT * float(np.var(part)) or bent > thresholds.DWELL_BEND:
        return None
    return Span(first * dt, last * dt, "sine", abs(sine), (frequency / dt,))


def _phasor(part: Array, frequency: float, offset: int) -> tuple[complex, float]:
    """The sine of a `frequency` (a row) in a part that begins at row `offset`, and the variance that is left."""
    turn = 2.0 * np.pi * frequency * (offset + np.arange(len(part)))
    basis = np.column_stack([np.ones(len(part)), np.cos(turn), np.sin(turn)])
    values, *_ = np.linalg.lstsq(basis, part, rcond=None)
    return complex(values[1], -values[2]), float(np.var(part - basis @ values))


def _fitted(part: Array, frequency: float) -> tuple[float, complex, float]:
    """By how much the frequency (a row) is too low, the sine, and the variance that is left."""
    sine, left = _phasor(part, frequency, 0)
    half = len(part) // 2
    early, late = _phasor(part[:half], frequency, 0)[0], _phasor(part[half:], frequency, half)[0]
    return float(np.angle(late * np.conj(early))) / (np.pi * len(part)), sine, left


def _bend(part: Array, frequency: float) -> float:
    """By how much (rad) the phase of the middle third leaves the mean of the outer ones: that of a sweep does."""
    thirds = np.array_split(np.arange(len(part)), 3)
    early, middle, late = (_phasor(part[rows], frequency, int(rows[0]))[0] for rows in thirds)
    return float(np.angle(middle**2 * np.conj(early) * np.conj(late)))
