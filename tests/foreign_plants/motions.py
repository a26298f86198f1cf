"""Ordinary motions: what a machine does in production, scaled to what its motor can do.

A motion is drawn from a random generator and returned as positions (n,) rad at multiples of the period.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tests.foreign_plants.nominal import Nominal

Array = NDArray[np.float64]
RAMP = 0.25  # s, in which periodic motions reach their amplitude


class Extent(NamedTuple):
    """How long a motion lasts, and how much of it is logged at least."""

    duration: float  # s, with the lead-in
    logged: float  # s
    period: float  # s, between two rows


def _periodic(time: Array) -> Array:
    share = np.clip(time / RAMP, 0.0, 1.0)
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2), dtype=np.float64)


def _slowest(logged: float) -> float:
    """Lowest frequency (Hz) of which the log holds a period and a half."""
    return max(0.5, 1.5 / logged)


def sine(rng: Generator, extent: Extent) -> Array:
    """One frequency of 0.5 to 3 Hz."""
    time = np.arange(0.0, extent.duration, extent.period)
    frequency = rng.uniform(_slowest(extent.logged), 3.0)
    return _periodic(time) * np.sin(2.0 * np.pi * (frequency * time + rng.uniform()))


def several_sines(rng: Generator, extent: Extent) -> Array:
    """Three to five frequencies with random phases, the slower ones with larger amplitudes."""
    time = np.arange(0.0, extent.duration, extent.period)
    frequencies = rng.uniform(_slowest(extent.logged), 5.0, rng.integers(3, 6))
    phases = rng.uniform(size=len(frequencies))
    waves = np.sin(2.0 * np.pi * (np.outer(time, frequencies) + phases)) / frequencies
    return np.asarray(_periodic(time) * waves.sum(axis=1), dtype=np.float64)


def chirp(rng: Generator, extent: Extent) -> Array:
    """A sine whose frequency rises; its speed keeps its amplitude."""
    time = np.arange(0.0, extent.duration, extent.period)
    slow, fast = _slowest(extent.logged), rng.uniform(3.0, 5.0)
    frequency = slow + (fast - slow) * time / extent.duration
    return _periodic(time) * np.sin(2.0 * np.pi * np.cumsum(frequency) * extent.period) / frequency


def point_to_point(rng: Generator, extent: Extent) -> Array:
    """Trapezoids of velocity there and back, with strokes of different lengths and a dwell after each."""
    velocity: list[Array] = []
    longest = min(0.25, 0.2 * extent.logged)
    direction, rows = 1.0, round(extent.duration / extent.period)
    while sum(map(len, velocity)) < rows:
        ramp, flat, dwell = rng.uniform((0.08, 0.0, 0.05), (0.15, longest, longest))
        pieces = [max(round(part / extent.period), 1) for part in (ramp, flat, ramp, dwell)]
        up = np.linspace(0.0, 1.0, pieces[0], endpoint=False)
        shape = (up, np.ones(pieces[1]), 1.0 - up, np.zeros(pieces[3]))
        velocity.append(direction * rng.uniform(0.5, 1.0) * np.concatenate(shape))
        direction = -direction
    return np.asarray(np.cumsum(np.concatenate(velocity)[:rows]) * extent.period)


MOTIONS: dict[str, Callable[[Generator, Extent], Array]] = {
    "sine": sine,
    "several-sines": several_sines,
    "point-to-point": point_to_point,
    "chirp": chirp,
}


def scaled(path: Array, period: float, machine: Nominal, effort: float) -> Array:
    """`path` times the factor with which the nominal machine needs `effort` (N m), or reaches a limit."""
    velocity = np.gradient(path, period)
    acceleration = np.gradient(velocity, period)
    moving = np.max(np.abs(machine.inertia * acceleration + machine.viscous * velocity))
    factor = min(
        (effort - machine.coulomb) / moving,
        0.9 * machine.speed / np.max(np.abs(velocity)),
        machine.travel / np.max(np.abs(path)),
    )
    return np.asarray(factor * path, dtype=np.float64)
