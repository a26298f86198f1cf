"""Logs in wrong units or of the wrong sign.

The model's force is compared with the logged one as it is, and after each mistake that people make.  Nominal values
may be wrong by a factor of three without a complaint.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from stagectl.kernels import stage

Array = NDArray[np.float64]

# Chosen; a nominal model may be wrong by a factor of three.
MODEL_FITS, MODEL_DIFFERS = 0.5, 0.8  # share of the force that the model leaves unexplained: right units, wrong units
MUCH_BETTER = 0.45  # times the unexplained share as recorded: a factor of 1000 is not found by chance
MOTION_BAND = 0.02  # cycles a sample: the motion is below, noise above
CHECKED_ROWS = 50_000  # rows that are looked at; longer logs are averaged in blocks

TURN = "positive current must move towards positive positions: turn the sign in the log, or go on with --doubtful"
ADVICE = "name the unit in the column's header or in --columns (position=3:mm), or go on with --doubtful"


class Mistake(NamedTuple):
    """Factors that would correct a log's columns."""

    time: float
    position: float
    current: float
    words: str

    @property
    def sentence(self) -> str:
        """What is wrong, and what to do."""
        advice = TURN if self.current < 0.0 else ADVICE
        return f"the force fits the model if {self.words}, and does not as it is: {advice}"


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


class Motion(NamedTuple):
    """Columns (n,) that passed one low-pass."""

    velocity: Array
    acceleration: Array
    current: Array


def motion(position: Array, current: Array, dt: float) -> Motion:
    """Columns averaged in blocks to at most `CHECKED_ROWS` rows, then low-passed, without the ends."""
    block = 1 + len(position) // CHECKED_ROWS
    rows = len(position) // block
    edge = min(round(1.0 / MOTION_BAND), rows // 8)
    inside = slice(edge, rows - edge)
    sos = signal.butter(2, 2.0 * MOTION_BAND, output="sos")
    x, i = (
        np.asarray(signal.sosfiltfilt(sos, column[: rows * block].reshape(rows, block).mean(axis=1)), dtype=np.float64)
        for column in (position, current)
    )
    v = np.gradient(x, block * dt)
    return Motion(v[inside], np.gradient(v, block * dt)[inside], i[inside])


def likely_mistake(motion: Motion, p: stage.Stage) -> Mistake | None:
    """The mistake without which the force would fit the model `p`; None where none is likely."""
    as_recorded = _unexplained(motion, p, Mistake(1.0, 1.0, 1.0, ""))
    share, best = min(((_unexplained(motion, p, mistake), mistake) for mistake in MISTAKES), key=lambda pair: pair[0])
    blind = as_recorded > MODEL_DIFFERS and share < MODEL_FITS
    return best if blind or share < min(MODEL_FITS, MUCH_BETTER * as_recorded) else None


def _unexplained(motion: Motion, p: stage.Stage, wrong: Mistake) -> float:
    """Share of the logged force that the model `p` does not give, after a correction."""
    v = motion.velocity * (wrong.position / wrong.time)
    a = motion.acceleration * (wrong.position / wrong.time**2)
    coulomb = stage.sliding(p.friction)
    slow = 1e-3 * float(np.abs(v).max())
    model = p.mechanics.inertia * a + p.mechanics.viscous * v + coulomb * v / (np.abs(v) + slow)
    force = p.motor.force_constant * wrong.current * motion.current
    difference = (force - force.mean()) - (model - model.mean())
    size = float(np.linalg.norm(force - force.mean()))
    return float(np.linalg.norm(difference)) / size if size > 0.0 else math.inf
