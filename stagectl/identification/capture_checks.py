"""Captures that look wrong: an axis that did not move, units by a factor of a thousand, a clipped current.

The stage file's own figures are the measure: its limits, its encoder, and its model, whose force is compared with the
captured one as recorded and after each mistake that people make.  Nominal values may be wrong by a factor of three
without anything being said.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from stagectl.config.stage_file import Setup
from stagectl.identification.capture import Array, Capture
from stagectl.kernels import stage
from stagectl.number_format import duration, length
from stagectl.units import LINEAR

BEYOND = 1.5  # of a limit: more than any overshoot
FITS, DIFFERS = 0.5, 0.8  # share of the force that the model leaves unexplained: right units, wrong units
BETTER = 0.45  # times what is left unexplained as recorded: a factor of 1000 is not found by chance
SLOW = 0.02  # cycles a sample: what lies below is the motion, above is noise
MOST_ROWS = 50_000  # looked at; longer captures are averaged in blocks
ONE_SIDE = 0.5  # of the largest current: a limit on the other side may be lower
LEAST_RUN = 5  # equal rows in a row at the largest current
LEAST_SHARE = 0.005  # of the rows
JUMP = 10.0  # times what 99 % of the rows move by
FROZEN, PUSHED = 0.05, 0.3  # of the rows: position without any change, and there a current that moves the axis
FROZEN_FRICTION = 2.0  # times the stage file's sliding friction
LEAST_RISE = 0.01  # of the largest current, in the last fifth
CORNER = 0.38  # rise in the last tenth over that in the last fifth: a flank has 0.5, a rounded top 0.25

TURN = "positive current must move towards positive positions: turn the sign in the log, or go on with --doubtful"


class Mistake(NamedTuple):
    """What would bring a capture into line: factors for its columns."""

    time: float
    position: float
    current: float
    words: str


MISTAKES = (
    Mistake(1e-3, 1.0, 1.0, "the times are in ms (divide them by 1000)"),
    Mistake(1e3, 1.0, 1.0, "the times are a thousand times too small"),
    Mistake(1.0, 1e-3, 1.0, "the positions are a thousand times too large"),
    Mistake(1.0, 1e3, 1.0, "the positions are a thousand times too small"),
    Mistake(1.0, math.pi / 180.0, 1.0, "the positions are in degrees"),
    Mistake(1.0, 1.0, 1e-3, "the currents are in mA (divide them by 1000)"),
    Mistake(1.0, 1.0, 1e3, "the currents are a thousand times too small"),
    Mistake(1.0, 1.0, -1.0, "the current has the opposite sign"),
)
FAR = 30.0  # from the stage file's value, either way
# Powers of ten that a wrong unit puts on J ~ i t^2/x, D ~ i t/x and friction ~ i.
_DECADES = (
    ("positions a thousand times too large", {"inertia": -3, "viscous": -3, "coulomb": 0}),
    ("positions a thousand times too small", {"inertia": 3, "viscous": 3, "coulomb": 0}),
    ("times a thousand times too large", {"inertia": 6, "viscous": 3, "coulomb": 0}),
    ("times a thousand times too small", {"inertia": -6, "viscous": -3, "coulomb": 0}),
    ("currents a thousand times too large", {"inertia": 3, "viscous": 3, "coulomb": 3}),
    ("currents a thousand times too small", {"inertia": -3, "viscous": -3, "coulomb": -3}),
)
ADVICE = "name the unit in the column's header or in --columns (position=3:mm), or go on with --doubtful"


def suspicions(capture: Capture, setup: Setup) -> list[str]:
    """What looks wrong so that the capture should not be used, in words; an empty list where nothing does."""
    if not _moves(capture):
        span = float(np.ptp(capture.position))
        unit = "m" if setup.file.axis.kind == LINEAR else "rad"
        return [
            f"the axis did not move: its positions span {span:.3g} {unit}, the encoder's step is "
            f"{capture.encoder_step:.3g} {unit}; record a motion"
        ]
    if float(np.ptp(capture.current)) == 0.0:
        return [
            f"{capture.current_column} is {capture.current[0]:g} A throughout, so it drove no motion; choose another "
            "column with --current, or record the current"
        ]
    motion = _motion(capture)
    found = [*_beyond_limits(capture, motion, setup), *_flat(capture, setup), *_frozen(capture, setup)]
    mistake = likely_mistake(motion, setup)
    if mistake is not None:
        advice = TURN if mistake.current < 0.0 else ADVICE
        found.append(f"the force fits the stage file's model if {mistake.words}, and does not as it is: {advice}")
    elif found and "flat" not in found[-1] and "frozen" not in found[-1]:
        found[-1] += f": {ADVICE}"
    return found or _jumps(capture, setup)


def remarks(capture: Capture) -> list[str]:
    """What is doubtful, but may well be right."""
    step, coarse = capture.encoder_step, _position_step(capture.position)
    if step > 0.0 and coarse > 30.0 * step:
        return [
            f"positions come in steps of {coarse:.3g}, the encoder's is {step:.3g}: the log lost digits, or its unit "
            "is not the one that it names"
        ]
    return []


def implausible(values: Mapping[str, float], setup: Setup) -> list[str]:
    """What a method found that is far from the stage file, and the wrong unit that would explain it."""
    nominal = {
        "inertia": setup.stage.mechanics.inertia,
        "viscous": setup.stage.mechanics.viscous,
        "coulomb": stage.sliding(setup.stage.friction),
    }
    ratios = {name: values[name] / size for name, size in nominal.items() if size > 0.0 and name in values}
    far = {name: ratio for name, ratio in ratios.items() if ratio <= 0.0 or not 1.0 / FAR < ratio < FAR}
    if not far:
        return []
    words = [f"{name} is {values[name]:.3g}, {nominal[name]:.3g} in the stage file" for name in far]
    powers = {name: round(math.log10(ratio)) for name, ratio in ratios.items() if ratio > 0.0}
    causes = [what for what, shape in _DECADES if all(abs(shape[n] - power) <= 1 for n, power in powers.items())]
    cause = f" ({' or '.join(causes)})" if causes and len(powers) == len(ratios) else ""
    return [f"{'; '.join(words)}: not the same machine, or a wrong unit{cause}"]


def _moves(capture: Capture) -> bool:
    return float(np.ptp(capture.position)) > 2.5 * capture.encoder_step


class _Motion(NamedTuple):
    """Columns (n,) through one low-pass."""

    velocity: Array
    acceleration: Array
    current: Array


def _motion(capture: Capture) -> _Motion:
    """Averaged in blocks to at most MOST_ROWS, then low-passed; the ends are left out."""
    block = 1 + len(capture.position) // MOST_ROWS
    rows = len(capture.position) // block
    edge = min(round(1.0 / SLOW), rows // 8)
    inside = slice(edge, rows - edge)
    sos = signal.butter(2, 2.0 * SLOW, output="sos")
    x, i = (
        np.asarray(signal.sosfiltfilt(sos, column[: rows * block].reshape(rows, block).mean(axis=1)), dtype=np.float64)
        for column in (capture.position, capture.current)
    )
    v = np.gradient(x, block * capture.dt)
    return _Motion(v[inside], np.gradient(v, block * capture.dt)[inside], i[inside])


def _jumps(capture: Capture, setup: Setup) -> list[str]:
    """A step between two rows that no motion makes: a row misread, or rows lost that the times do not show."""
    steps = np.abs(np.diff(capture.position))
    row, usual = int(np.argmax(steps)), float(np.quantile(steps, 0.99))
    if steps[row] <= max(JUMP * usual, BEYOND * setup.file.limits.speed * capture.dt):
        return []
    axis = setup.file.axis
    size = length(axis.travel_per_unit * float(steps[row]), axis.travel_unit)
    return [
        f"its position jumps by {size} within {duration(capture.dt)} at "
        f"{capture.time[row]:.6g} s: a value misread, or rows lost that the times do not show; cut the log there"
    ]


def _frozen(capture: Capture, setup: Setup) -> list[str]:
    """The position stands still to the last bit while a current flows that moves the axis: an encoder that has died."""
    edges = np.flatnonzero(np.diff(capture.position) != 0.0)
    ends = np.concatenate([[-1], edges, [len(capture.position) - 1]])
    longest = int(np.argmax(np.diff(ends)))
    first, last = int(ends[longest]) + 1, int(ends[longest + 1]) + 1
    p, still = setup.stage, capture.current[first:last]
    least = FROZEN_FRICTION * stage.sliding(p.friction) / p.motor.force_constant
    pushed = float(np.mean(np.abs(still - still.mean()) > least)) if len(still) else 0.0
    if last - first < FROZEN * len(capture.position) or pushed < PUSHED:
        return []
    return [
        f"its position is frozen from {capture.time[first]:.6g} s on, for {duration((last - first) * capture.dt)}, "
        f"while the current swings by up to {float(np.abs(still - still.mean()).max()):.3g} A: the encoder or its log "
        "stopped; cut the log there"
    ]


def _beyond_limits(capture: Capture, motion: _Motion, setup: Setup) -> list[str]:
    limits, axis = setup.file.limits, setup.file.axis
    unit, scale = axis.travel_unit, axis.travel_per_unit
    width = limits.travel[1] - limits.travel[0]
    fastest = float(np.abs(motion.velocity).max())
    peak, largest = float(np.abs(capture.current).max()), setup.file.drive.current_limit
    checks = (
        (float(np.ptp(capture.position)), width, scale, unit, "its positions span", "limits.travel is"),
        (fastest, limits.speed, scale, f"{unit}/s", "its largest speed is", "limits.speed is"),
        (peak, largest, 1.0, "A", "its largest current is", "drive.current_limit is"),
    )
    return [
        f"{words} {factor * value:.3g} {name}, {limit_words} {factor * limit:.3g} {name}"
        for value, limit, factor, name, words, limit_words in checks
        if value > BEYOND * limit
    ]


def likely_mistake(motion: _Motion, setup: Setup) -> Mistake | None:
    """The mistake without which the force would fit the stage file's model; None where none is likely."""
    as_recorded = _unexplained(motion, setup, Mistake(1.0, 1.0, 1.0, ""))
    share, best = min(((_unexplained(motion, setup, one), one) for one in MISTAKES), key=lambda pair: pair[0])
    blind = as_recorded > DIFFERS and share < FITS
    return best if blind or share < min(FITS, BETTER * as_recorded) else None


def _unexplained(motion: _Motion, setup: Setup, wrong: Mistake) -> float:
    """Share of the captured force that the stage file's model does not give, after a correction."""
    p = setup.stage
    v = motion.velocity * (wrong.position / wrong.time)
    a = motion.acceleration * (wrong.position / wrong.time**2)
    coulomb = stage.sliding(p.friction)
    slow = 1e-3 * float(np.abs(v).max())
    model = p.mechanics.inertia * a + p.mechanics.viscous * v + coulomb * v / (np.abs(v) + slow)
    force = p.motor.force_constant * wrong.current * motion.current
    difference = (force - force.mean()) - (model - model.mean())
    size = float(np.linalg.norm(force - force.mean()))
    return float(np.linalg.norm(difference)) / size if size > 0.0 else math.inf


def _flat(capture: Capture, setup: Setup) -> list[str]:
    rows = clipped(capture.current)
    if not len(rows):
        return []
    largest = float(np.abs(capture.current).max())
    known = "law" in capture.meta and capture.current_column != "command"
    if known and largest >= 0.999 * setup.file.drive.current_limit:
        return []  # the drive's own limit, in a current that it measured or commanded behind it
    level = abs(float(capture.current[rows[0]]))
    return [
        f"the current is clipped: flat at {level:.4g} A in {len(rows)} of {len(capture.current)} rows, the first at "
        f"{capture.time[rows[0]]:.6g} s; what drove the motion there is not known: record with a smaller amplitude, or "
        "go on with --doubtful if the current was really flat"
    ]


def clipped(current: Array) -> NDArray[np.intp]:
    """Rows in which `current` (n,) is cut off at its largest or smallest value: repeated there, reached with a corner.

    The flat top of a rounded sine, or of friction that saturates, is reached without one.
    """
    largest = float(np.abs(current).max())
    sides = [end for end in (float(current.max()), float(current.min())) if abs(end) >= ONE_SIDE * largest]
    top = np.any([np.abs(current - end) <= 1e-6 * largest for end in sides], axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], top, [False]]).astype(np.int8)))
    runs = [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= LEAST_RUN]
    rows = np.concatenate([np.arange(a, b) for a, b in runs]) if runs else np.zeros(0, dtype=np.intp)
    if len(rows) < LEAST_SHARE * len(current):
        return np.zeros(0, dtype=np.intp)
    ends = [0, *(b for _, b in runs)]
    apart = [
        (end, a) for end, (a, _) in zip(ends, runs, strict=False) if end == 0 or a - end > 4 * LEAST_RUN
    ]  # noise breaks runs
    corners = [corner for end, a in apart if not math.isnan(corner := _corner(current[end:a], current[a]))]
    return rows if corners and float(np.median(corners)) >= CORNER else np.zeros(0, dtype=np.intp)


def _corner(before: Array, top: float) -> float:
    """How straight the rise of `before` (n,) to the value `top` ends, see CORNER; NaN for a jump."""
    signed, largest, count = before * math.copysign(1.0, top), abs(top), len(before)
    low = np.flatnonzero(signed < 0.5 * largest)
    tenth = (count - int(low[-1])) // 10 if len(low) else 0
    if tenth < 2:
        return math.nan
    width = max(1, tenth // 2)
    late, early = (
        float(np.mean(signed[max(count - n * tenth - width, 0) : count - n * tenth + width])) for n in (1, 2)
    )
    rise = largest - early
    return (largest - late) / rise if rise > LEAST_RISE * largest else 0.0  # it has long been there


def _position_step(position: Array) -> float:
    """The step in which positions come; 0 where they come in none."""
    steps = np.abs(np.diff(position[:20000]))
    steps = steps[steps > 0.0]
    if len(steps) < 10:
        return 0.0
    step = float(steps.min())
    counts = steps / step
    return step if float(np.max(np.abs(counts - np.round(counts)))) < 0.02 else 0.0
