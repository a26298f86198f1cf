"""Logs in wrong units or of the wrong sign.

The model's force is compared with the logged one as it is, and after each mistake that two units allow, in both
directions.  Nominal values may be wrong by a factor of three without a complaint.
"""

import itertools
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal

from stagectl.kernels import stage
from stagectl.number_format import duration
from stagectl.recording import constants
from stagectl.recording.scales import Scales
from stagectl.units import factor

Array = NDArray[np.float64]

TURN = "positive current must move towards positive positions: turn the sign in the log, or go on with --doubtful"


def advice(example: str) -> str:
    """What to do about a wrong unit, with the entry of --columns that names the right one."""
    return f"name the unit in the column's header or in --columns ({example}), or go on with --doubtful"


class Mistake(NamedTuple):
    """Factors that would correct a log's columns."""

    time: float
    position: float
    current: float
    words: str
    example: str = ""  # of --columns, with the unit that the column is in

    @property
    def sentence(self) -> str:
        """What is wrong, and what to do."""
        remedy = TURN if self.current < 0.0 else advice(self.example)
        return f"the force fits the model if {self.words}, and does not as it is: {remedy}"

    @property
    def on_parameters(self) -> dict[str, float]:
        """Factors that it puts on what is found: J ~ i t^2/x, D ~ i t/x and friction ~ i."""
        coulomb = 1.0 / self.current
        viscous = coulomb * self.position / self.time
        return {"inertia": viscous / self.time, "viscous": viscous, "coulomb": coulomb}


def _ratios(families: tuple[tuple[str, ...], ...]) -> dict[float, list[tuple[str, str]]]:
    """By the factor that corrects a column: the units that it is in, and those that were named for it."""
    found: dict[float, list[tuple[str, str]]] = {}
    for units in families:
        for real, named in itertools.permutations(units, 2):
            ratio = factor(real, named)
            if abs(math.log(ratio)) > math.log(constants.LEAST_RATIO):
                same = next((known for known in found if abs(known / ratio - 1.0) < constants.SAME_RATIO), ratio)
                found.setdefault(same, []).append((real, named))
    return found


def _size(column: str, ratio: float, pairs: Iterable[tuple[str, str]]) -> str:
    """A mistake in words, by the factor that corrects it and the units that were taken for each other."""
    off = max(ratio, 1.0 / ratio)
    size = f"{off:.{0 if off >= 100.0 else 2}f} times too {'large' if ratio < 1.0 else 'small'}"
    causes = " or ".join(f"in {real} where {named} is named" for real, named in pairs)
    return f"the {column}s are {size} ({causes})"


def by_step(ratio: float, scales: Scales) -> str:
    """The wrong unit by which positions come in `ratio` steps of the encoder; empty where no unit of the axis does."""
    known = {unit: scales.position(unit) for unit in scales.units("position") if unit != "counts"}
    pairs = [
        (real, named)
        for named, real in itertools.permutations(known, 2)
        if abs(ratio * known[real] / known[named] - 1.0) < constants.SAME_STEP
    ]
    return _size("position", 1.0 / ratio, pairs) if pairs else ""


def by_rows(dt: float, period: float) -> str:
    """The wrong unit of time that makes a log's `dt` (s) of the stage's `period` (s); empty where none does."""
    causes = [m.words for m in MISTAKES if m.time != 1.0 and abs(dt * m.time / period - 1.0) < constants.SAME_STEP]
    return next(iter(causes), "")


def by_pace(dt: float) -> str:
    """What to say where rows come every `dt` (s), too rarely to show a motion, by a wrong unit of time; else empty.

    It asks no model: what that lacks, such as gravity, can hide the mistake from `likely_mistake`.
    """
    low, high = constants.USUAL_STEPS
    causes = [m.words for m in MISTAKES if m.time < 1.0 and low <= dt * m.time <= high]
    if dt <= constants.RARE_ROWS or not causes:
        return ""
    remedy = "name the unit of the times in the column's header or in --columns (time=1:ms)"
    return f"rows come every {duration(dt)}, unless {causes[0]}: {remedy}"


def _wrong(column: str) -> list[Mistake]:
    """Every mistake between two units of a `column`: time, position or current."""
    mistakes = []
    for ratio, pairs in _ratios(constants.CONFUSED[column]).items():
        words = _size(column, ratio, pairs)
        factors = {name: ratio if name == column else 1.0 for name in constants.CONFUSED}
        mistakes.append(Mistake(**factors, words=words, example=f"{column}=N:{pairs[0][0]}"))
    return mistakes


MISTAKES = (
    *itertools.chain.from_iterable(map(_wrong, constants.CONFUSED)),
    Mistake(1.0, 1.0, -1.0, "the current has the opposite sign"),
)


class Motion(NamedTuple):
    """Columns (n,) that passed one low-pass."""

    velocity: Array
    acceleration: Array
    current: Array


def motion(position: Array, current: Array, dt: float) -> Motion:
    """Columns averaged in blocks to at most `CHECKED_ROWS` rows, then low-passed, without the ends."""
    block = 1 + len(position) // constants.CHECKED_ROWS
    rows = len(position) // block
    edge = min(round(1.0 / constants.MOTION_BAND), rows // 8)
    inside = slice(edge, rows - edge)
    sos = signal.butter(2, 2.0 * constants.MOTION_BAND, output="sos")
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
    blind = as_recorded > constants.MODEL_DIFFERS and share < constants.MODEL_FITS
    if not blind and share >= min(constants.MODEL_FITS, constants.MUCH_BETTER * as_recorded):
        return None
    as_it_is = _unexplained_at_best(motion, p, Mistake(1.0, 1.0, 1.0, ""))
    return best if _unexplained_at_best(motion, p, best) < constants.MUCH_BETTER * as_it_is else None


def _unexplained(motion: Motion, p: stage.Stage, wrong: Mistake) -> float:
    """Share of the logged force that the model `p` does not give, after a correction."""
    force = p.motor.force_constant * wrong.current * motion.current
    difference = (force - force.mean()) - _parts(motion, p, wrong).sum(axis=1)
    return _share(difference, force)


def _unexplained_at_best(motion: Motion, p: stage.Stage, wrong: Mistake) -> float:
    """The same, with each nominal value as far off as it may be: a wrong inertia is no wrong unit of time."""
    force, off = p.motor.force_constant * wrong.current * motion.current, constants.NOMINAL_OFF
    found = optimize.lsq_linear(_parts(motion, p, wrong), force - force.mean(), (1.0 / off, off))
    return _share(found.fun, force)


def _parts(motion: Motion, p: stage.Stage, wrong: Mistake) -> Array:
    """Forces (n, 3) of inertia, viscous and Coulomb friction after a correction, each without its mean."""
    v = motion.velocity * (wrong.position / wrong.time)
    a = motion.acceleration * (wrong.position / wrong.time**2)
    slow = constants.UNIT_SLOW * float(np.abs(v).max())
    sizes = p.mechanics.inertia, p.mechanics.viscous, stage.sliding(p.friction)
    parts = np.column_stack([size * part for size, part in zip(sizes, (a, v, v / (np.abs(v) + slow)), strict=True)])
    return np.asarray(parts - parts.mean(axis=0))


def _share(difference: Array, force: Array) -> float:
    size = float(np.linalg.norm(force - force.mean()))
    return float(np.linalg.norm(difference)) / size if size > 0.0 else math.inf
