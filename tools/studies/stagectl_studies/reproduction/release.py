"""The axis held at standstill, and its free vibration when the holding force is removed.

Rolling friction in presliding is a spring with hysteresis: released from a standstill, the axis springs back and
swings about its new place.  The frequency is the slope of the swings' zero crossings over their number.  A centre that
is slightly off does not matter, as it moves the crossings up and down alternately.

Source: the friction paper of the linear slider, section 2.2, Figs. 4 and 5.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import stats

from stagectl.compensation.legs import Array
from stagectl.identification.capture import IdentificationError, Refusal
from stagectl.identification.result import Parameter

FEWEST = 4  # crossings: three half swings
LEAST_SWING = 0.05  # of the first swing: smaller ones are not counted
LEAST_STEPS = 4.0  # encoder steps
REST = 0.2  # share of the record, at its end, that gives the centre
STANDING = 0.05  # s after a stop, in which the loop settles
BLOCKS = 4  # parts of a standstill; the scatter of their means gives the interval of the force
SURE = 0.975


class Release(NamedTuple):
    """The free vibration after the force has been set to zero."""

    frequency: Parameter  # Hz
    travel: float  # rad | m, the farthest the axis got from where it was let go
    offset: float  # rad | m, from where it was let go to where it swings about; signed
    crossings: Array  # (k,) s after the release


def released(time: Array, position: Array, opened: float, encoder_step: float = 0.0) -> Release:
    """Vibration of `position` (n,) rad | m over `time` (n,) s after the force ended at `opened` (s).

    Raises IdentificationError where the axis does not swing, or the record ends too early.
    """
    after = time >= opened - 1e-9
    t, x = time[after] - opened, position[after]
    if len(t) < 20:
        raise IdentificationError(
            f"the record ends {len(t)} samples after the release at {opened:g} s; must have at least 20: watch longer",
            Refusal.TOO_SHORT,
            value=len(t),
            admissible="[20, inf)",
        )
    centre = float(np.mean(x[-max(int(REST * len(x)), 10) :]))
    crossings = _crossings(t, x - centre, LEAST_STEPS * encoder_step)
    if len(crossings) < FEWEST:
        raise IdentificationError(
            f"{len(crossings)} swings after the release at {opened:g} s, travel {np.max(np.abs(x - x[0])):.3g} (axis "
            f"units); must be at least {FEWEST}: let it go while the loop holds it against friction, and watch longer",
            Refusal.NO_SWING,
            value=len(crossings),
            admissible=f"[{FEWEST}, inf)",
        )
    travel = float(np.max(np.abs(x - x[0])))
    return Release(_frequency(crossings), travel, centre - float(x[0]), crossings)


def _crossings(t: Array, swing: Array, noise: float) -> Array:
    """Zero crossings (k,) s of `swing`, as long as it swings beyond `noise` and LEAST_SWING of its first."""
    at = np.flatnonzero(np.sign(swing[1:]) * np.sign(swing[:-1]) < 0.0)
    if not len(at):
        return np.zeros(0)
    peaks = [float(np.max(np.abs(part))) for part in np.split(swing, at + 1)]
    least = max(noise, LEAST_SWING * peaks[1])
    small = np.flatnonzero(np.array(peaks[1:-1]) < least)
    at = at[: small[0] + 1 if len(small) else len(at)]
    a, b = swing[at], swing[at + 1]
    return np.asarray(t[at] + (t[at + 1] - t[at]) * a / (a - b), dtype=np.float64)


def _frequency(crossings: Array) -> Parameter:
    """Half the inverse slope of the crossings over their number, with its 95 % interval."""
    line = stats.linregress(np.arange(len(crossings)), crossings)
    slope = float(line.slope)
    half = float(stats.t.ppf(SURE, len(crossings) - 2)) * float(line.stderr)
    longest, shortest = slope + half, max(slope - half, 1e-9)
    return Parameter(0.5 / slope, 0.5 / longest, 0.5 / shortest, "Hz")


def holding(time: Array, velocity: Array, force: Array, unit: str = "N") -> Parameter:
    """Mean force that keeps the axis standing between two motions or behind one, with its 95 % interval.

    `velocity` (n,) is the reference's, exactly zero in a dwell; forces of opposite dwells count by their size.
    Raises IdentificationError where no standstill behind a motion is longer than the loop takes to settle.
    """
    means = [
        abs(float(np.mean(block)))
        for rows in _dwells(time, velocity)
        for block in np.array_split(force[rows], BLOCKS)
        if len(block)
    ]
    if not means:
        raise IdentificationError(
            f"no standstill behind a motion is longer than {STANDING * 1e3:g} ms; record a trapezoid with a dwell of "
            "0.1 s or more",
            Refusal.TOO_SHORT,
            admissible=f"({STANDING:g}, inf)",
        )
    mean = float(np.mean(means))
    half = float(stats.t.ppf(SURE, len(means) - 1) * np.std(means, ddof=1) / math.sqrt(len(means)))
    return Parameter(mean, mean - half, mean + half, unit)


def _dwells(time: Array, velocity: Array) -> list[slice]:
    """Rows of each standstill behind a motion, without the first STANDING seconds."""
    standing = np.concatenate([[0], (np.asarray(velocity) == 0.0).astype(np.int64), [0]])
    edges = np.diff(standing)
    rows = []
    for first, end in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
        begin = int(np.searchsorted(time, time[first] + STANDING))
        if first > 0 and end - begin > BLOCKS:
            rows.append(slice(begin, int(end)))
    return rows
