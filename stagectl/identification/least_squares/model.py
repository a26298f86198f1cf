"""The regression's columns, and the parameters that are reported from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stagectl.identification.capture import Array
from stagectl.identification.filtering import FilteredMotion

ALWAYS = ("inertia", "viscous", "coulomb", "offset")


class Estimate(NamedTuple):
    """A parameter and how well the record determines it."""

    value: float
    deviation: float  # standard deviation, for the residual as it is
    white: float  # the same, had the residual been white


class RegressionModel(NamedTuple):
    """Which columns the regression has beyond the usual four."""

    gravity: bool = False
    directions: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Reported parameters, the usual four first."""
        both = ("viscous_forward", "viscous_backward", "coulomb_forward", "coulomb_backward")
        return (
            *ALWAYS,
            *(both if self.directions else ()),
            *(("gravity_sine", "gravity_cosine") if self.gravity else ()),
        )

    def columns(self, motion: FilteredMotion) -> Array:
        """Columns (n, k) of the regression."""
        v, sign = motion.velocity, np.sign(motion.velocity)
        if self.directions:
            forward = v > 0.0
            friction = [v * forward, v * ~forward, forward.astype(float), -(v < 0.0).astype(float)]
        else:
            friction = [v, sign, np.ones(len(v))]
        gravity = [np.sin(motion.position), np.cos(motion.position)] if self.gravity else []
        return np.column_stack([motion.acceleration, *friction, *gravity])

    def reported(self) -> Array:
        """Matrix from the regression's parameters to those of `names`; of directions, mean and half difference."""
        if not self.directions:
            return np.eye(6 if self.gravity else 4)
        rows = [[1, 0, 0, 0, 0], [0, 0.5, 0.5, 0, 0], [0, 0, 0, 0.5, 0.5], [0, 0, 0, 0.5, -0.5], *np.eye(5)[1:]]
        matrix = np.zeros((8 + 2 * self.gravity, 5 + 2 * self.gravity))
        matrix[:8, :5] = rows
        matrix[8:, 5:] = np.eye(2 * self.gravity)
        return matrix


def reported_estimates(
    model: RegressionModel, values: Array, robust: Array, white: Array
) -> tuple[dict[str, Estimate], Array]:
    """The reported parameters by name, and the correlation (4, 4) of the usual four.

    `values` (k,) are the regression's parameters, `robust` and `white` (k, k) their two covariances.
    """
    matrix = model.reported()
    deviation, white_deviation = (np.sqrt(np.diag(matrix @ cov @ matrix.T)) for cov in (robust, white))
    numbers = zip(model.names, (matrix @ values).tolist(), deviation.tolist(), white_deviation.tolist(), strict=True)
    usual = (matrix @ robust @ matrix.T)[:4, :4]
    return {name: Estimate(*rest) for name, *rest in numbers}, usual / np.outer(deviation[:4], deviation[:4])
