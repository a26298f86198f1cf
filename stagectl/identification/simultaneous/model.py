"""The equation of motion as a linear model: its columns, what is known of them before the data, and its left sides.

``Kt i(t - tau) = J a + D v + b + ripple + sum_k f_k F_k(x)``, with the friction columns of `friction_columns`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stagectl import gaussian_evidence as gaussian
from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous import friction_columns
from stagectl.identification.simultaneous.regressors import (
    ACCELERATION,
    FREE,
    ONE,
    RIPPLE,
    VELOCITY,
    Part,
    currents,
    motion,
)
from stagectl.units import ROTARY

GROUPS = ("ripple", "operators", "bristles", "stribeck", "lag")
Scales = tuple[float, ...]  # of GROUPS, in units of the Coulomb friction


class DelayPrior(NamedTuple):
    """What is known of the delay before the data; a deviation of zero: it is given."""

    mean: float  # s
    deviation: float  # s

    @property
    def nodes(self) -> Array:
        """Delays that the search begins with."""
        if self.deviation == 0.0:
            return np.array([self.mean])
        span = thresholds.DELAY_SPAN * self.deviation
        return np.asarray(self.mean + np.linspace(-span, span, thresholds.DELAY_NODES), dtype=np.float64)

    def log_density(self, delays: Array) -> Array:
        """Up to a constant."""
        if self.deviation == 0.0:
            return np.zeros(len(delays))
        return np.asarray(-0.5 * ((delays - self.mean) / self.deviation) ** 2, dtype=np.float64)


class Forces(NamedTuple):
    """The left side at several delays, and its products with the columns."""

    delays: Array  # (k,) s
    rows: Array  # (rows, k) N m | N
    right: Array  # (m, k)
    square: Array  # (k,)


class Problem(NamedTuple):
    """Rows of all captures, and what is known before them."""

    parts: list[Part]
    shapes: friction_columns.Shapes
    columns: Array  # (rows, m)
    gram: Array  # (m, m)
    coulomb: float  # N m | N, about
    file: StageFile
    delay: DelayPrior
    acceleration_noise: float = 0.0  # sum of squares that `gram` lacks
    moved_share: float = 0.0  # of the residual's noise that lies in the acceleration

    @property
    def groups(self) -> dict[str, slice]:
        """Places of the groups in all columns."""
        friction = {name: slice(FREE + place.start, FREE + place.stop) for name, place in self.shapes.groups.items()}
        return {"ripple": RIPPLE, **friction}

    def forces(self, delays: Array) -> Forces:
        """Left sides at these delays (k,) s."""
        rows = self.file.motor.force_constant * currents(self.parts, delays)
        return Forces(delays, rows, self.columns.T @ rows, np.sum(rows * rows, axis=0))

    def residual_square(self, theta: Array, forces: Forces, number: int) -> float:
        """Sum of squares of the residual at one of the delays."""
        explained = theta @ self.gram @ theta + self.acceleration_noise * theta[ACCELERATION] ** 2
        return float(forces.square[number] - 2.0 * theta @ forces.right[:, number] + explained)

    def prior(self, scales: Scales) -> gaussian.Prior:
        """Of all columns, with these scales of the groups."""
        mean, deviation = np.zeros(len(self.gram)), np.full(len(self.gram), self.coulomb)
        if self.file.axis.kind != ROTARY:
            scales = (0.0, *scales[1:])
        mechanical = [ACCELERATION, VELOCITY]
        mean[mechanical], deviation[mechanical] = mechanics(self.file)
        for name, scale in zip(GROUPS, scales, strict=True):
            deviation[self.groups[name]] = max(scale, thresholds.NO_SCALE) * self.coulomb
        operators = self.groups["operators"]
        mean[operators] = self.coulomb / (operators.stop - operators.start)
        return gaussian.independent(mean, deviation)


def problem(parts: list[Part], file: StageFile, delay: DelayPrior) -> Problem:
    """Columns of all `parts`."""
    free = [motion(p) for p in parts]
    shapes = friction_columns.shapes(parts, np.vstack(free))
    matrix = np.vstack(
        [
            np.column_stack([rows, friction_columns.columns(p, rows[:, VELOCITY], shapes)])
            for p, rows in zip(parts, free, strict=True)
        ]
    )
    force = file.motor.force_constant * currents(parts, np.array([delay.mean]))[:, 0]
    return Problem(parts, shapes, matrix, matrix.T @ matrix, _coulomb(matrix, force, shapes, file), file, delay)


def _coulomb(matrix: Array, force: Array, shapes: friction_columns.Shapes, file: StageFile) -> float:
    """About the Coulomb friction: one operator next to the stage file's mechanics with their doubt."""
    some = matrix[:, [ACCELERATION, VELOCITY, ONE, FREE + len(shapes.slip) // 2]]
    rms = float(np.sqrt(np.mean(force * force)))
    power = 1.0 / (thresholds.WINDOW_CORRELATION * (thresholds.ROUGH_RESIDUAL * rms) ** 2)
    sums = gaussian.Sums(power * some.T @ some, power * some.T @ force, power * float(force @ force))
    (inertia, viscous), (loose, tight) = mechanics(file)
    prior = gaussian.independent(np.array([inertia, viscous, 0.0, 0.0]), np.array([loose, tight, rms, rms]))
    return max(abs(float(gaussian.posterior(sums, prior).mean[-1])), thresholds.LEAST_FRICTION * rms)


def mechanics(file: StageFile) -> tuple[tuple[float, float], tuple[float, float]]:
    """Inertia and viscous friction of the stage file, and the standard deviations of their doubt."""
    p = file.mechanics
    viscous = thresholds.VISCOUS_DOUBT * p.viscous + thresholds.NATURAL_DAMPING * p.inertia
    return (p.inertia, p.viscous), (thresholds.INERTIA_DOUBT * p.inertia, viscous)
