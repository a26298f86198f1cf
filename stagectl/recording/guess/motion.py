"""What a column does in a motion: whether it is the derivative of another, whether it drives the axis.

All columns are taken in blocks, so that noise and encoder steps matter little: positions at the blocks' edges, all
others as their means.
"""

from typing import NamedTuple

import numpy as np

from stagectl.recording import constants
from stagectl.recording.columns import Array


class Blocks(NamedTuple):
    """A log in blocks of equal numbers of rows."""

    size: int  # rows
    duration: Array  # (b,) s


class Drive(NamedTuple):
    """How much of a column the motion explains, as the force that drives it."""

    share: float  # of its variance; 0 to 1
    sign: float  # -1 where it opposes acceleration and velocity


def blocks_of(time: Array) -> Blocks:
    """Blocks of a log with these instants (n,) s."""
    size = max(len(time) // constants.GUESS_BLOCKS, 2)
    return Blocks(size, np.diff(time[::size]))


def mean(blocks: Blocks, column: Array) -> Array:
    """Means (b,) of a column (n,)."""
    count = len(blocks.duration)
    return np.asarray(column[: count * blocks.size].reshape(count, blocks.size).mean(axis=1))


def change(blocks: Blocks, column: Array) -> Array:
    """Changes (b,) of a column (n,) over the blocks."""
    return np.diff(column[:: blocks.size])


def derivative(blocks: Blocks, position: Array, velocity: Array) -> tuple[float, float]:
    """The factor k of ``d position/dt = k velocity``, and the share of the position's changes that it explains."""
    way, speed = change(blocks, position), mean(blocks, velocity) * blocks.duration
    power, total = float(speed @ speed), float(way @ way)
    if power == 0.0 or total == 0.0 or float(np.std(speed)) < constants.SAME_SPEED * float(np.sqrt(np.mean(speed**2))):
        return 0.0, 0.0
    k = float(way @ speed) / power
    left = way - k * speed
    return k, max(1.0 - float(left @ left) / total, 0.0)


def follows(reference: Array, position: Array) -> float:
    """Share of the position's variance that is in the reference, one to one; negative where it is another quantity."""
    spread = float(np.var(position))
    return 1.0 - float(np.var(position - reference)) / spread if spread > 0.0 else 0.0


def drives(blocks: Blocks, speed: Array, column: Array) -> Drive:
    """How far `column` (n,) is inertia, damping and friction of a motion with the blocks' `speed` (b,)."""
    way = np.cumsum(speed * blocks.duration)
    force = _without(way, mean(blocks, column))
    spread = float(force @ force)
    fastest = float(np.abs(speed).max(initial=0.0))
    if spread == 0.0 or fastest == 0.0:
        return Drive(0.0, 1.0)
    acceleration = np.gradient(speed) / np.gradient(np.cumsum(blocks.duration))
    parts = np.column_stack([acceleration, speed, np.tanh(speed / (constants.GUESS_SLOW * fastest))])
    parts = _without(way, parts)
    size = np.linalg.norm(parts, axis=0)
    parts /= np.where(size > 0.0, size, 1.0)
    weights, *_ = np.linalg.lstsq(parts, force, rcond=1e-6)
    explained = parts @ weights
    largest = float(np.abs(weights).max())
    sign = float(np.sign(weights[np.abs(weights) >= 0.5 * largest].sum())) or 1.0
    return Drive(float(explained @ explained) / spread, sign)


def _without(way: Array, columns: Array) -> Array:
    """Columns (b,) or (b, k) without what a smooth function of the position, such as gravity, explains."""
    width = float(np.ptp(way)) or 1.0
    basis = np.polynomial.legendre.legvander(2.0 * (way - way.min()) / width - 1.0, constants.GRAVITY_DEGREE)
    return np.asarray(columns - basis @ np.linalg.lstsq(basis, columns, rcond=1e-9)[0])


def roughness(column: Array) -> float:
    """Size of the second differences, of the column's own spread: small for what is smooth, about 1 for noise."""
    spread = float(np.std(column))
    return float(np.sqrt(np.mean(np.diff(column, 2) ** 2))) / spread if spread > 0.0 else 0.0
