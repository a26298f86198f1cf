"""Friction laws along a path, with parameters theta that are not linear; `refinement` searches for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

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


def prior(forces: int, number: int, coulomb: float) -> tuple[Array, Array]:
    """Mean and standard deviation of a law's `number` weights: those of friction of unit size, and the others."""
    mean, deviation = np.zeros(number), np.full(number, thresholds.LAW_EXTRA * coulomb)
    mean[:forces], deviation[:forces] = coulomb / forces, thresholds.LAW_WEIGHT * coulomb / forces
    return mean, deviation
