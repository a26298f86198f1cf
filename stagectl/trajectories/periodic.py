"""Periodic motions under a window: steady in the middle, at rest at both ends."""

import functools
import math
import random
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from stagectl.trajectories.bounds import PEAK_HEIGHT, PEAK_POINTS, PEAK_STEPS, ROUNDING
from stagectl.trajectories.motion import Array, Motion, contained, product, window
from stagectl.units import Quantity

Flat = Literal["position", "velocity", "acceleration"]
FLAT: tuple[str, ...] = get_args(Flat)


class Sine(NamedTuple):
    """``amplitude sin(2 pi frequency (t - t_ramp) + phase)``, faded in and out over `ramp` periods each."""

    amplitude: Annotated[float, Quantity("m", "(0, 1e6]", "half of peak to peak")]
    frequency: Annotated[float, Quantity("Hz", "[1e-4, 1e4]", "frequency of the motion")]
    periods: Annotated[float, Quantity("", "(0, 1e7]", "steady periods between the ramps")]
    ramp: Annotated[float, Quantity("", "[0.1, 1000]", "periods over which it rises, and again falls")] = 1.0
    phase: Annotated[float, Quantity("rad", "[-10, 10]", "phase at which the steady periods begin")] = 0.0

    @property
    def duration(self) -> float:
        """Whole run, both ramps included (s)."""
        return (self.periods + 2.0 * self.ramp) / self.frequency

    @property
    def end(self) -> float:
        """Back where it began (m)."""
        return 0.0

    @property
    def steady(self) -> tuple[float, float]:
        """The periods at full amplitude (s)."""
        return self.ramp / self.frequency, (self.ramp + self.periods) / self.frequency

    def at(self, t: npt.ArrayLike) -> Motion:
        """Motion at the times `t` (n,) s."""
        return contained(self._inside, t, self.duration, 0.0)

    def _inside(self, t: Array) -> Motion:
        omega = 2.0 * math.pi * self.frequency
        angle = omega * (t - self.steady[0]) + self.phase
        x = self.amplitude * np.sin(angle)
        carrier = Motion(x, self.amplitude * omega * np.cos(angle), -omega * omega * x)
        return product(window(t, self.ramp / self.frequency, self.duration), carrier)


class Multisine(NamedTuple):
    """Odd random-phase multisine: lines at odd multiples of ``1/base`` in [low, high], under a window.

    Only odd lines are excited, so even lines of a response show even nonlinearities; half a period later the
    motion is its own negative, and its largest excursion is half of peak to peak.

    Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2012, chapter 4.
    """

    amplitude: Annotated[float, Quantity("m", "(0, 1e6]", "largest excursion, half of peak to peak")]
    low: Annotated[float, Quantity("Hz", "[1e-4, 1e4]", "lowest frequency of the band")]
    high: Annotated[float, Quantity("Hz", "[1e-4, 1e4]", "highest frequency of the band")]
    base: Annotated[float, Quantity("s", "[1e-3, 1e3]", "period; the lines are 2/base apart")]
    periods: Annotated[float, Quantity("", "(0, 1e7]", "steady periods between the ramps")] = 2.0
    ramp: Annotated[float, Quantity("", "[0.01, 1000]", "periods it rises over, and again falls")] = 0.25
    seed: Annotated[int, Quantity("", "[0, 2147483647]", "seed of the phases")] = 1
    flat: Annotated[Flat, "spectrum in which the lines are equal"] = "velocity"

    @property
    def duration(self) -> float:
        """Whole run, both ramps included (s)."""
        return (self.periods + 2.0 * self.ramp) * self.base

    @property
    def end(self) -> float:
        """Back where it began (m)."""
        return 0.0

    @property
    def steady(self) -> tuple[float, float]:
        """The periods at full amplitude (s)."""
        return self.ramp * self.base, (self.ramp + self.periods) * self.base

    @property
    def lines(self) -> npt.NDArray[np.int64]:
        """Excited odd multiples of ``1/base``; a line on the edge of the band belongs to it."""
        first, last = math.ceil(self.low * self.base - ROUNDING), math.floor(self.high * self.base + ROUNDING)
        return np.arange(first | 1, last + 1, 2, dtype=np.int64)

    def at(self, t: npt.ArrayLike) -> Motion:
        """Motion at the times `t` (n,) s."""
        return contained(self._inside, t, self.duration, 0.0)

    def _inside(self, t: Array) -> Motion:
        carrier = _sum_of_lines(self, _coefficients(self), t - self.steady[0])
        return product(window(t, self.ramp * self.base, self.duration), carrier)


_ORDER = {"position": 0, "velocity": 1, "acceleration": 2}  # lines fall by k^-order in position


def _phasors(p: Multisine) -> npt.NDArray[np.complex128]:
    """Lines of position before scaling: equal in the `flat` spectrum, phases from `seed`."""
    # random.Random is specified to the bit; numpy's distributions may change from version to version.
    source = random.Random(p.seed)
    phases = np.array([2.0 * math.pi * source.random() for _ in p.lines])
    size = (p.lines / p.lines[0]) ** -float(_ORDER[p.flat])
    return np.asarray(size * np.exp(1j * phases), dtype=np.complex128)


@functools.lru_cache(maxsize=32)
def _coefficients(p: Multisine) -> npt.NDArray[np.complex128]:
    """Lines (m), scaled so that the largest excursion is the amplitude."""
    lines = _phasors(p)
    count = PEAK_POINTS * int(p.lines[-1])
    grid = np.arange(count) * (p.base / count)
    height = np.abs(_sampled(p, lines, len(grid)))
    t = grid[height > PEAK_HEIGHT * height.max()]
    for _ in range(PEAK_STEPS):
        near = _sum_of_lines(p, lines, t)
        # At the flank of a peak the curvature may vanish: never step further than the grid.
        t = t - np.clip(near.velocity / near.acceleration, -grid[1], grid[1])
    peak = max(float(height.max()), float(np.abs(_sum_of_lines(p, lines, t).position).max()))
    return lines * (p.amplitude / peak)


def _sampled(p: Multisine, lines: npt.NDArray[np.complex128], count: int) -> Array:
    """One period at `count` equal steps, by the inverse Fourier transform."""
    spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
    spectrum[p.lines] = -0.5j * count * lines
    return np.fft.irfft(spectrum, count)


def _sum_of_lines(p: Multisine, lines: npt.NDArray[np.complex128], t: Array) -> Motion:
    """``Im sum c_k exp(i k w t)`` and its derivatives, by Horner's rule in ``exp(2 i w t)``."""
    omega = 2.0 * math.pi / p.base * p.lines
    turns = 2.0 * math.pi * np.mod(t / p.base, 1.0)
    terms = np.stack([lines, 1j * omega * lines, -omega * omega * lines], axis=1)
    sums = np.polynomial.polynomial.polyval(np.exp(2j * turns), terms) * np.exp(1j * int(p.lines[0]) * turns)
    x, v, a = sums.imag
    return Motion(x, v, a)
