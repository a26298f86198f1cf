"""Segments of a reference: displacement from where they begin, one value a row, the beginning left out."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl_studies.machine.machine import Floats

PERIOD = 0.0005  # s


def rows(seconds: float) -> int:
    """Rows of a duration."""
    return max(round(seconds / PERIOD), 1)


def smooth(u: NDArray[np.floating[Any]]) -> Floats:
    """From 0 to 1 with two continuous derivatives."""
    w = np.clip(np.asarray(u, dtype=np.float64), 0.0, 1.0)
    return np.asarray(w * w * w * (10.0 + w * (6.0 * w - 15.0)))


def rest(seconds: float) -> Floats:
    """Standstill."""
    return np.zeros(rows(seconds))


def move(distance: float, seconds: float) -> Floats:
    """From rest to rest with minimum jerk."""
    n = rows(seconds)
    return distance * smooth(np.arange(1, n + 1) / n)


def sine(amplitude: float, frequency: float, cycles: float, phase: float = 0.0) -> Floats:
    """Whole cycles at full amplitude, one more to begin and one to end."""
    n = rows((cycles + 2.0) / frequency)
    cycle = np.arange(1, n + 1) * PERIOD * frequency
    envelope = smooth(cycle) * smooth(n * PERIOD * frequency - cycle)
    return np.asarray(amplitude * envelope * np.sin(2.0 * np.pi * cycle + phase))


def speeds(steps: Sequence[tuple[float, float]], ramp: float) -> Floats:
    """Constant speeds (speed, seconds) one after the other, smooth ramps between them, rest at both ends."""
    pieces, before = [], 0.0
    for speed, seconds in [*steps, (0.0, 0.0)]:
        n = rows(ramp)
        pieces.append(before + (speed - before) * smooth(np.arange(1, n + 1) / n))
        pieces.append(np.full(rows(seconds) if seconds > 0.0 else 0, speed))
        before = speed
    v = np.concatenate([np.zeros(1), *pieces])
    return np.asarray(np.cumsum(0.5 * (v[1:] + v[:-1])) * PERIOD)


def joined(start: float, segments: Sequence[Floats]) -> Floats:
    """Reference from segments; 12 decimals, as the record holds it."""
    position, out = start, [np.array([start])]
    for segment in segments:
        out.append(position + segment)
        position = float(out[-1][-1])
    return np.round(np.concatenate(out), 12)


def turned(size: float, seconds: float) -> list[Floats]:
    """A preconditioning reversal: out and back, a short rest."""
    return [rest(0.05), move(size, seconds), move(-size, seconds), rest(0.1)]


def multisine(
    n: int, lowest: float, highest: float, lines: int, rms: float, random: np.random.Generator
) -> Floats:  # fmt: skip
    """Odd harmonics of 1 Hz with random phases, spread over the logarithm of frequency, faded in and out, (n,) A."""
    wanted = np.geomspace(lowest, highest, lines)
    odd = np.unique(2.0 * np.round((wanted - 1.0) / 2.0) + 1.0)
    t = np.arange(n) * PERIOD
    phases = random.uniform(0.0, 2.0 * np.pi, odd.size)
    wave = np.sin(2.0 * np.pi * np.outer(t, odd) + phases).sum(axis=1) * rms * np.sqrt(2.0 / odd.size)
    return np.asarray(wave * smooth(t / 0.1) * smooth((t[-1] - t) / 0.1))
