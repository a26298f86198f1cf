"""Friction laws refined on a motion by variable projection.

::

    Kt i(t - tau) = J a + D v + b + ripple + sum_j w_j c_j(theta; x, v)        theta, tau and J are searched for

A law that fits needs no error of form; the dense columns of `friction_columns` hold what the best law leaves.  The
refined law enters the linear model as its columns and their changes with each of theta (the tangent), so that the
intervals hold what theta leaves open.

What is least is the residual over J: the error of the acceleration that force and friction predict.  Noise that moved
the axis is in the acceleration, and least squares with J among their weights would make it smaller (`evidence`).

Source: variable projection, G. Golub, V. Pereyra, SIAM J. Numerical Analysis 10(2), 1973.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize
from scipy.linalg import cho_factor, cho_solve

from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous.friction_columns import Path, Shapes
from stagectl.identification.simultaneous.laws import LAWS, Law, bounds, columns, prior
from stagectl.identification.simultaneous.whitening import Whitening


class Refined(NamedTuple):
    """A law at its best theta, and what it leaves."""

    name: str
    theta: Array
    weights: Array  # of its columns, N m | N
    free: Array  # weights of the columns without friction
    delay: float  # s
    criterion: float  # minus twice the log evidence: the lower, the better


class Setting(NamedTuple):
    """What every law is refined on: rows of the motion without friction, and the forces at any delay."""

    paths: list[Path]
    shapes: Shapes
    whitening: Whitening
    acceleration: Array  # (n,), whitened like `free` and `forces`
    free: Array  # (n, f)
    gram: Array  # (f, f) of `free`
    forces: Callable[[float], Array]  # delay (s) -> (n,)
    mean: Array  # (f,) of the free columns before the data
    deviation: Array  # (f,)
    coulomb: float  # N m | N, about
    delay: tuple[float, float]  # mean and deviation before the data, s; deviation 0: given
    inertia: float  # kg m^2 | kg, before the data
    doubt: float  # standard deviation of its logarithm
    begin: float  # in these deviations, where a search of the inertia begins
    sensed: float  # variance of the residual that is the current sensor's, (N m)^2 | N^2
    noise: float  # standard deviation of the residual that a search assumes, N m | N

    def inertia_at(self, u: Array) -> float:
        """Inertia at these coordinates."""
        return self.inertia * math.exp(self.doubt * float(u[-1]))


def tangent(force: Callable[[Array], Array], theta: Array, rows: int) -> Array:
    """Columns (rows, t): how a law's force (rows,) changes with the logarithm of each of theta (t,)."""
    step, changes = thresholds.SENSITIVITY_STEP, []
    for factors in 1.0 + (step - 1.0) * np.eye(len(theta)):
        changes.append((force(theta * factors) - force(theta / factors)) / (2.0 * math.log(step)))
    return np.array(changes).T.reshape(rows, len(theta))


def acceleration(refined: Refined, path: Path, force: Array, s: Shapes) -> Array:
    """Acceleration (n,) along a path under a `force` (n,) N m | N that acts at the same instants."""
    inertia, viscous, offset = refined.free[:3]
    friction_force = LAWS[refined.name].columns(path, refined.theta.tolist(), s) @ refined.weights
    return np.asarray((force - viscous * path.velocity - offset - friction_force) / inertia)


def refined(at: Setting) -> list[Refined]:
    """Every law at its best parameters, the best law first."""
    return _ranked(_refined(name, at, _starts(name, at)) for name in LAWS)


def refined_again(at: Setting, before: list[Refined]) -> list[Refined]:
    """The most probable laws with the noise as it is, from where they were `before`."""
    return _ranked(_refined(law.name, at, [_coordinates(law, at)]) for law in before[: thresholds.LAW_RIVALS])


def residual(law: Refined, at: Setting) -> Array:
    """What a law leaves (n,) of a setting that is not whitened."""
    force = at.forces(law.delay) - law.free[0] * at.acceleration - at.free @ law.free[1:]
    return np.asarray(force - columns(LAWS[law.name], at.paths, law.theta.tolist(), at.shapes) @ law.weights)


def _ranked(found: Iterable[Refined]) -> list[Refined]:
    return sorted(found, key=lambda law: law.criterion)


def _coordinates(law: Refined, at: Setting) -> Array:
    late = (law.delay - at.delay[0]) / at.delay[1] if at.delay[1] else 0.0
    heavy = math.log(law.free[0] / at.inertia) / at.doubt
    return np.concatenate([np.log(law.theta), [late, heavy]])


class _Solved(NamedTuple):
    weights: Array
    residual: Array  # (n,), whitened
    penalty: Array  # of the priors
    volume: float  # log determinant of what is known after the data, over that before


def _along(law: Law, at: Setting) -> Callable[[Array], Array]:
    """The law's columns (rows, k) at ``log theta``; kept, as delay and inertia leave them as they are."""

    @functools.lru_cache(maxsize=2 + len(law.searched))
    def kept(logarithms: tuple[float, ...]) -> Array:
        return at.whitening(columns(law, at.paths, np.exp(logarithms).tolist(), at.shapes))

    return lambda logarithms: kept(tuple(logarithms.tolist()))


def _scatter(at: Setting, u: Array, noise: float) -> float:
    """Standard deviation of the residual where it is `noise` at the inertia before the data.

    What moves the axis, or is in its acceleration, grows with the inertia; what the current's sensor adds does not.
    """
    sensed = min(at.sensed, noise**2)
    return math.sqrt(sensed + (noise**2 - sensed) * (at.inertia_at(u) / at.inertia) ** 2)


def _noise(at: Setting, u: Array, residual: Array) -> float:
    """What `_scatter` makes the rms of this residual."""
    square = float(np.mean(residual**2))
    sensed = min(at.sensed, square)
    return math.sqrt(sensed + (square - sensed) * (at.inertia / at.inertia_at(u)) ** 2)


def _solved(law: Law, at: Setting, u: Array, noise: float, along: Callable[[Array], Array]) -> _Solved:
    """Weights at ``u = (log theta, delay in deviations, log inertia in deviations)``."""
    own, scatter = along(u[:-2]), _scatter(at, u, noise)
    force = at.forces(at.delay[0] + at.delay[1] * u[-2]) - at.inertia_at(u) * at.acceleration
    before = prior(law.forces, own.shape[1], at.coulomb)
    mean, deviation = np.r_[at.mean, before[0]], np.r_[at.deviation, before[1]]
    cross = at.free.T @ own
    gram = np.block([[at.gram, cross], [cross.T, own.T @ own]])
    right = np.r_[at.free.T @ force, own.T @ force]
    factor = cho_factor(gram / scatter**2 + np.diag(deviation**-2.0))
    weights = cho_solve(factor, right / scatter**2 + mean / deviation**2)
    free, friction_weights = np.split(weights, [len(at.mean)])
    residual = force - at.free @ free - own @ friction_weights
    volume = 2.0 * float(np.log(np.diag(factor[0])).sum() + np.log(deviation).sum())
    cross = np.r_[at.free.T @ at.acceleration, own.T @ at.acceleration] / scatter
    left = float(at.acceleration @ at.acceleration) - float(cross @ cho_solve(factor, cross))
    doubt = at.doubt * at.inertia_at(u) / scatter
    return _Solved(weights, residual, (weights - mean) / deviation, volume + math.log1p(doubt**2 * left))


def _edges(law: Law, at: Setting) -> tuple[Array, Array]:
    """Bounds of ``u = (log theta, delay in deviations, log inertia in deviations)``."""
    low, high = np.log(np.array([bounds(kind, at.shapes) for kind in law.searched]).reshape(-1, 2)).T
    span, wide = thresholds.DELAY_SPAN if at.delay[1] else 1e-9, thresholds.INERTIA_SPAN
    return np.r_[low, -span, -wide], np.r_[high, span, wide]


def _starts(name: str, at: Setting) -> list[Array]:
    """The best points of a grid over a law's parameters."""
    law = LAWS[name]
    low, high = _edges(law, at)
    points = itertools.product(*(thresholds.LAW_GRID[kind] for kind in law.searched))
    grid = [np.r_[(low + (high - low) * [*shares, 0.5, 0.5])[:-1], at.begin] for shares in points]
    misfit = _misfit(law, at, _along(law, at))
    return sorted(grid, key=lambda u: float(np.sum(misfit(u) ** 2)))[: thresholds.LAW_STARTS]


def _misfit(law: Law, at: Setting, along: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Residual and priors in standard deviations, at ``u``."""

    def misfit(u: Array) -> Array:
        found = _solved(law, at, u, at.noise, along)
        return np.concatenate([found.residual / _scatter(at, u, at.noise), found.penalty, u[-2:]])

    return misfit


def _refined(name: str, at: Setting, starts: list[Array]) -> Refined:
    law = LAWS[name]
    along = _along(law, at)
    misfit = _misfit(law, at, along)
    low, high = _edges(law, at)

    def searched(start: Array) -> Any:
        return optimize.least_squares(
            misfit,
            np.clip(start, low, high),
            bounds=(low - 1e-9, high + 1e-9),
            diff_step=np.full(len(low), thresholds.LAW_DERIVATIVE),
            max_nfev=thresholds.LAW_STEPS,
            x_scale="jac",
        )

    u = min((searched(start) for start in starts), key=lambda fit: float(fit.cost)).x
    rough = _solved(law, at, u, at.noise, along).residual
    found = _solved(law, at, u, math.sqrt(thresholds.WINDOW_CORRELATION) * _noise(at, u, rough), along)
    free, weights = np.split(found.weights, [at.free.shape[1]])
    delay = at.delay[0] + at.delay[1] * float(u[-2])
    criterion = _criterion(found, at, u)
    return Refined(name, np.exp(u[:-2]), weights, np.r_[at.inertia_at(u), free], delay, criterion)


def _criterion(found: _Solved, at: Setting, u: Array) -> float:
    """Minus twice the log evidence: the weights by their prior, what is searched for by Schwarz' term."""
    independent = len(found.residual) / thresholds.WINDOW_CORRELATION
    fit = 2.0 * independent * math.log(_noise(at, u, found.residual)) + float(found.penalty @ found.penalty)
    return fit + float(u[-2:] @ u[-2:]) + found.volume + (len(u) - 1) * math.log(independent)
