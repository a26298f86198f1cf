"""Friction laws with parameters that are not linear, refined on a motion by variable projection.

::

    Kt i(t - tau) = J a + D v + b + ripple + sum_j w_j c_j(theta; x, v)        theta and tau are searched for

A law that fits needs no error of form; the dense columns of `friction_columns` hold what the best law leaves.  The
refined law enters the linear model as its columns and their changes with each of theta (the tangent), so that the
intervals hold what theta leaves open.

Source: variable projection, G. Golub, V. Pereyra, SIAM J. Numerical Analysis 10(2), 1973.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize
from scipy.linalg import cho_factor, cho_solve

from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous import elasto_plastic
from stagectl.identification.simultaneous.friction_columns import Path, Shapes
from stagectl.kernels import friction, friction_bristle, friction_path

SHAPE = 2.0  # exponent of Stribeck's curve: Gaussian


class Law(NamedTuple):
    """One law: its columns along a path, and what is searched for."""

    words: str
    forces: Callable[[Shapes], int]  # number of columns that are friction of unit size; those after are damping
    searched: tuple[str, ...]  # kinds of theta, by their bounds in `bounds`
    columns: Callable[[Path, Sequence[float], Shapes], Array]  # (n, k) at theta


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
    free: Array  # (n, f)
    gram: Array  # (f, f) of `free`
    forces: Callable[[float], Array]  # delay (s) -> (n,)
    mean: Array  # (f,) of the free columns before the data
    deviation: Array  # (f,)
    coulomb: float  # N m | N, about
    delay: tuple[float, float]  # mean and deviation before the data, s; deviation 0: given


def bounds(kind: str, s: Shapes) -> tuple[float, float]:
    """Admissible values of a searched parameter."""
    return {
        "range": (float(s.slip[0]) / 2.0, 2.0 * float(s.slip[-1])),
        "exponent": (0.3, 3.0),
        "rise": (1e-3, 1.0),
        "stribeck": (thresholds.SLOWEST_STRIBECK * s.fastest, thresholds.FASTEST_STRIBECK * s.fastest),
        "elastic": (0.05, 0.95),
        "smoothing": (thresholds.LEAST_SMOOTHING * s.fastest, thresholds.MOST_SMOOTHING * s.fastest),
    }[kind]


def _bundle(p: Path, slips: Array, curve: friction.Stribeck) -> Array:
    out = np.empty((len(p.position), len(slips)))
    friction_path.operators(friction.Gms(friction.bundle(np.ones(len(slips)), slips), curve), p.position, p.dt, out)
    return out


def _slips(s: Shapes) -> Array:
    return np.asarray(np.geomspace(s.slip[0], s.slip[-1], thresholds.GMS_OPERATORS))


def _gms(p: Path, theta: Sequence[float], s: Shapes) -> Array:
    return _bundle(p, _slips(s), friction.Stribeck(theta[0], theta[1], SHAPE))


def _dahl(p: Path, theta: Sequence[float], s: Shapes) -> Array:
    out = np.empty((len(p.position), 2))
    friction_path.bristle(friction_bristle.Bristle(1.0, 1.0 / theta[0], theta[1]), p.position, p.dt, out)
    return out[:, :1]


def _lugre(p: Path, theta: Sequence[float], s: Shapes) -> Array:
    out = np.empty((len(p.position), 2))
    curve = friction.Stribeck(theta[1], theta[2], SHAPE)
    friction_path.bristle(friction_bristle.Bristle(1.0, 1.0 / theta[0], 1.0, 0.0, curve), p.position, p.dt, out)
    return _damped(out, s)


def _elastoplastic(p: Path, theta: Sequence[float], s: Shapes) -> Array:
    out = np.empty((len(p.position), 2))
    elasto_plastic.run(p.position, p.dt, tuple(float(value) for value in theta), out)
    return _damped(out, s)


def _damped(out: Array, s: Shapes) -> Array:
    """Force of unit size and rate (n, 2) with the rate in units of a slow speed."""
    return np.asarray(out / np.array([1.0, thresholds.DAMPING_SPEED * s.fastest]), dtype=np.float64)


def _static(p: Path, theta: Sequence[float], s: Shapes) -> Array:
    side = np.tanh(p.velocity / theta[0])
    return np.column_stack([side, side * np.exp(-((p.velocity / theta[1]) ** SHAPE))])


def _single(s: Shapes) -> int:
    return 1


LAWS: dict[str, Law] = {
    "maxwell-slip": Law(
        "Maxwell slip", lambda s: len(s.slip), (), lambda p, theta, s: _bundle(p, s.slip, friction.Stribeck())
    ),
    "gms": Law("GMS", lambda s: thresholds.GMS_OPERATORS, ("rise", "stribeck"), _gms),
    "dahl": Law("Dahl", _single, ("range", "exponent"), _dahl),
    "lugre": Law("LuGre", _single, ("range", "rise", "stribeck"), _lugre),
    "elasto-plastic": Law("elasto-plastic", _single, ("range", "rise", "stribeck", "elastic"), _elastoplastic),
    "stribeck": Law("Stribeck", _single, ("smoothing", "stribeck"), _static),
}


def columns(law: Law, paths: Sequence[Path], theta: Sequence[float], s: Shapes) -> Array:
    """Windowed columns (rows, k) of all captures."""
    return np.vstack([p.smoothed(np.ascontiguousarray(law.columns(p, theta, s).T)).T for p in paths])


def tangent(law: Law, refined: Refined, paths: Sequence[Path], s: Shapes) -> Array:
    """Columns (rows, t): how the law's force changes with the logarithm of each of theta."""
    step, changes = thresholds.SENSITIVITY_STEP, []
    for place in range(len(refined.theta)):
        ends = []
        for factor in (step, 1.0 / step):
            theta = refined.theta.copy()
            theta[place] *= factor
            ends.append(columns(law, paths, theta.tolist(), s) @ refined.weights)
        changes.append((ends[0] - ends[1]) / (2.0 * math.log(step)))
    return np.array(changes).T.reshape(sum(p.rows.number for p in paths), len(changes))


def acceleration(refined: Refined, path: Path, force: Array, s: Shapes) -> Array:
    """Acceleration (n,) along a path under a `force` (n,) N m | N that acts at the same instants."""
    inertia, viscous, offset = refined.free[:3]
    friction_force = LAWS[refined.name].columns(path, refined.theta.tolist(), s) @ refined.weights
    return np.asarray((force - viscous * path.velocity - offset - friction_force) / inertia)


def refined(at: Setting) -> list[Refined]:
    """Every law at its best parameters, the best law first."""
    return _ranked(_refined(name, at, _starts(name, at)) for name in LAWS)


def refined_again(at: Setting, before: list[Refined]) -> list[Refined]:
    """The most probable laws, from where they were `before`, on paths that have changed a little."""
    return _ranked(_refined(law.name, at, [_coordinates(law, at)]) for law in before[: thresholds.LAW_RIVALS])


def _ranked(found: Iterable[Refined]) -> list[Refined]:
    return sorted(found, key=lambda law: law.criterion)


def _coordinates(law: Refined, at: Setting) -> Array:
    late = (law.delay - at.delay[0]) / at.delay[1] if at.delay[1] else 0.0
    return np.append(np.log(law.theta), late)


class _Solved(NamedTuple):
    weights: Array
    residual: Array  # (n,)
    penalty: Array  # of the priors
    volume: float  # log determinant of what is known after the data, over that before

    def square(self, noise: float) -> float:
        """Sum of squares of residual and priors, for a residual of this standard deviation."""
        return float(self.residual @ self.residual) / noise**2 + float(self.penalty @ self.penalty)


def _along(law: Law, at: Setting) -> Callable[[Array], Array]:
    """The law's columns (rows, k) at ``log theta``; kept, as a change of the delay alone leaves them as they are."""

    @functools.lru_cache(maxsize=2 + len(law.searched))
    def kept(logarithms: tuple[float, ...]) -> Array:
        return columns(law, at.paths, np.exp(logarithms).tolist(), at.shapes)

    return lambda logarithms: kept(tuple(logarithms.tolist()))


def _solved(law: Law, at: Setting, u: Array, noise: float, along: Callable[[Array], Array]) -> _Solved:
    """Weights at ``u = (log theta, delay in deviations)``, for a residual of this standard deviation."""
    own = along(u[:-1])
    force = at.forces(at.delay[0] + at.delay[1] * u[-1])
    before = prior(law.forces(at.shapes), own.shape[1], at.coulomb)
    mean, deviation = np.r_[at.mean, before[0]], np.r_[at.deviation, before[1]]
    cross = at.free.T @ own
    gram = np.block([[at.gram, cross], [cross.T, own.T @ own]])
    right = np.r_[at.free.T @ force, own.T @ force]
    factor = cho_factor(gram / noise**2 + np.diag(deviation**-2.0))
    weights = cho_solve(factor, right / noise**2 + mean / deviation**2)
    free, friction_weights = np.split(weights, [len(at.mean)])
    residual = force - at.free @ free - own @ friction_weights
    volume = 2.0 * float(np.log(np.diag(factor[0])).sum() + np.log(deviation).sum())
    return _Solved(weights, residual, (weights - mean) / deviation, volume)


def prior(forces: int, number: int, coulomb: float) -> tuple[Array, Array]:
    """Mean and standard deviation of a law's `number` weights: those of friction of unit size, and the others."""
    mean, deviation = np.zeros(number), np.full(number, thresholds.LAW_EXTRA * coulomb)
    mean[:forces], deviation[:forces] = coulomb / forces, thresholds.LAW_WEIGHT * coulomb / forces
    return mean, deviation


def _edges(law: Law, at: Setting) -> tuple[Array, Array]:
    """Bounds of ``u = (log theta, delay in deviations)``."""
    low, high = np.log(np.array([bounds(kind, at.shapes) for kind in law.searched]).reshape(-1, 2)).T
    span = thresholds.DELAY_SPAN if at.delay[1] else 1e-9
    return np.append(low, -span), np.append(high, span)


def _starts(name: str, at: Setting) -> list[Array]:
    """The best points of a grid over a law's parameters."""
    law = LAWS[name]
    low, high = _edges(law, at)
    points = itertools.product(*(thresholds.LAW_GRID[kind] for kind in law.searched))
    grid = [low + (high - low) * np.array([*shares, 0.5]) for shares in points]
    noise, along = thresholds.ROUGH_NOISE * at.coulomb, _along(law, at)
    return sorted(grid, key=lambda u: _solved(law, at, u, noise, along).square(noise))[: thresholds.LAW_STARTS]


def _refined(name: str, at: Setting, starts: list[Array]) -> Refined:
    law, noise = LAWS[name], thresholds.ROUGH_NOISE * at.coulomb
    along = _along(law, at)
    low, high = _edges(law, at)

    def misfit(u: Array) -> Array:
        found = _solved(law, at, u, noise, along)
        return np.concatenate([found.residual / noise, found.penalty, u[-1:]])

    def searched(start: Array) -> Any:
        return optimize.least_squares(
            misfit,
            np.clip(start, low, high),
            bounds=(low - 1e-9, high + 1e-9),
            diff_step=np.full(len(low), thresholds.LAW_DERIVATIVE),
            max_nfev=thresholds.LAW_STEPS,
            x_scale="jac",
        )

    best = min((searched(start) for start in starts), key=lambda fit: float(fit.cost))
    rough = _solved(law, at, best.x, noise, along).residual
    found = _solved(law, at, best.x, math.sqrt(thresholds.WINDOW_CORRELATION * float(np.mean(rough**2))), along)
    free, weights = np.split(found.weights, [at.free.shape[1]])
    delay = at.delay[0] + at.delay[1] * float(best.x[-1])
    return Refined(name, np.exp(best.x[:-1]), weights, free, delay, _criterion(found, len(best.x)))


def _criterion(found: _Solved, searched: int) -> float:
    """Minus twice the log evidence: the weights by their prior, what is searched for by Schwarz' term."""
    independent = len(found.residual) / thresholds.WINDOW_CORRELATION
    fit = independent * math.log(float(np.mean(found.residual**2))) + float(found.penalty @ found.penalty)
    return fit + found.volume + searched * math.log(independent)
