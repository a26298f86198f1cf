"""Excitation currents: what an experiment adds to the command, and the spans in which they are steady.

Each is a NamedTuple with ``at(t)`` (n,) A, ``duration`` (s) and ``spans``: steady parts of whole
periods, each with the frequencies in it, which is what a frequency response is taken over.
"""

from itertools import accumulate
from typing import Annotated, NamedTuple

import numpy as np
import numpy.typing as npt

from stagectl.trajectories.bounds import ROUNDING
from stagectl.trajectories.motion import Array
from stagectl.trajectories.periodic import Multisine, Sine
from stagectl.units import Quantity

_AMPLITUDE = Quantity("A", "(0, 1e4]", "half of peak to peak")


class Span(NamedTuple):
    """A steady part of an excitation: whole periods of known frequencies."""

    start: float  # s
    end: float  # s
    kind: str  # sine or multisine
    amplitude: float  # A
    frequencies: tuple[float, ...]  # Hz


class CurrentSine(NamedTuple):
    """``amplitude sin(2 pi frequency (t - t_ramp))``, faded in and out over `ramp` periods each."""

    amplitude: Annotated[float, _AMPLITUDE]
    frequency: Annotated[float, Quantity("Hz", "[1e-4, 1e4]", "frequency of the current")]
    periods: Annotated[float, Quantity("", "(0, 1e7]", "steady periods between the ramps")]
    ramp: Annotated[float, Quantity("", "[0.1, 1000]", "periods over which it rises, and again falls")] = 1.0

    @property
    def duration(self) -> float:
        """Whole excitation, both ramps included (s)."""
        return self._shape.duration

    @property
    def steady(self) -> tuple[float, float]:
        """The periods at full amplitude (s)."""
        return self._shape.steady

    @property
    def spans(self) -> tuple[Span, ...]:
        """The whole ones of them."""
        span = Span(*self.steady, "sine", self.amplitude, (self.frequency,))
        return _whole(span, self.periods, 1.0 / self.frequency)

    def at(self, t: npt.ArrayLike) -> Array:
        """Current (n,) A at the times `t` (n,) s; 0 before and after."""
        return self._shape.at(t).position

    @property
    def _shape(self) -> Sine:
        return Sine(self.amplitude, self.frequency, self.periods, self.ramp)


class CurrentMultisine(NamedTuple):
    """Odd random-phase multisine of equal lines at odd multiples of ``1/base`` in [low, high], under a window."""

    amplitude: Annotated[float, Quantity("A", "(0, 1e4]", "largest excursion, half of peak to peak")]
    low: Annotated[float, Quantity("Hz", "[1e-4, 1e4]", "lowest frequency of the band")]
    high: Annotated[float, Quantity("Hz", "[1e-4, 1e4]", "highest frequency of the band")]
    base: Annotated[float, Quantity("s", "[1e-3, 1e3]", "period; the lines are 2/base apart")]
    periods: Annotated[float, Quantity("", "(0, 1e7]", "steady periods between the ramps")] = 2.0
    ramp: Annotated[float, Quantity("", "[0.01, 1000]", "periods it rises over, and again falls")] = 0.25
    seed: Annotated[int, Quantity("", "[0, 2147483647]", "seed of the phases")] = 1

    @property
    def duration(self) -> float:
        """Whole excitation, both ramps included (s)."""
        return self.shape.duration

    @property
    def steady(self) -> tuple[float, float]:
        """The periods at full amplitude (s)."""
        return self.shape.steady

    @property
    def spans(self) -> tuple[Span, ...]:
        """The whole ones of them."""
        lines = tuple(float(line) / self.base for line in self.shape.lines)
        return _whole(Span(*self.steady, "multisine", self.amplitude, lines), self.periods, self.base)

    def at(self, t: npt.ArrayLike) -> Array:
        """Current (n,) A at the times `t` (n,) s; 0 before and after."""
        return self.shape.at(t).position

    @property
    def shape(self) -> Multisine:
        """The same shape, as a motion: its checks and its lines hold here, too."""
        return Multisine(self.amplitude, self.low, self.high, self.base, self.periods, self.ramp, self.seed, "position")


class CurrentSweep(NamedTuple):
    """Stepped sine: at each frequency in turn some periods to settle, then whole ones to measure."""

    amplitude: Annotated[float, _AMPLITUDE]
    frequencies: Annotated[tuple[float, ...], Quantity("Hz", "[1e-4, 1e4]", "frequencies in their order")]
    periods: Annotated[int, Quantity("", "[1, 1000000]", "periods measured at each frequency")] = 5
    settle: Annotated[int, Quantity("", "[0, 1000000]", "periods before them, at each frequency")] = 3

    @property
    def duration(self) -> float:
        """All frequencies (s)."""
        return self._starts[-1]

    @property
    def spans(self) -> tuple[Span, ...]:
        """The measured periods of each frequency."""
        starts = zip(self._starts, self.frequencies, strict=False)
        return tuple(
            Span(start + self.settle / f, start + (self.settle + self.periods) / f, "sine", self.amplitude, (f,))
            for start, f in starts
        )

    def at(self, t: npt.ArrayLike) -> Array:
        """Current (n,) A at the times `t` (n,) s; every sine begins at zero, as the last one ended."""
        t, starts = np.asarray(t, dtype=np.float64), np.array(self._starts)
        inside = (t >= 0.0) & (t < starts[-1])
        step = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(self.frequencies) - 1)
        turns = np.array(self.frequencies)[step] * (t - starts[step])
        return np.where(inside, self.amplitude * np.sin(2.0 * np.pi * turns), 0.0)

    @property
    def _starts(self) -> list[float]:
        """Start of each frequency, and the end of the last one (s)."""
        return list(accumulate(((self.settle + self.periods) / f for f in self.frequencies), initial=0.0))


Current = CurrentSine | CurrentMultisine | CurrentSweep

CURRENTS: dict[str, type[Current]] = {
    "current_sine": CurrentSine,
    "current_multisine": CurrentMultisine,
    "current_sweep": CurrentSweep,
}


def _whole(span: Span, periods: float, period: float) -> tuple[Span, ...]:
    """`span` with its end after the whole ones of its `periods`; none where it has no whole one."""
    whole = int(periods + ROUNDING)
    return (span._replace(end=span.start + whole * period),) if whole else ()
