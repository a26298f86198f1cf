"""Friction laws along a path, with parameters theta that are not linear; `refinement` searches for them."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous.friction_columns import Path, Shapes
from stagectl.kernels import friction, friction_bristle, friction_path
from stagectl.kernels.jit import kernel

SHAPE = 2.0  # exponent of Stribeck's curve: Gaussian


class Law(NamedTuple):
    """One law: its columns along a path, and what is searched for."""

    words: str
    forces: int  # number of columns that are friction of unit size; those after are damping
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


def bundle_columns(position: Array, dt: float, slips: Sequence[float] | Array, curve: friction.Stribeck) -> Array:
    """Elements (n, j) of unit weight along positions (n,) that are `dt` (s) apart."""
    out = np.empty((len(position), len(slips)))
    friction_path.operators(friction.Gms(friction.bundle(np.ones(len(slips)), slips), curve), position, dt, out)
    return out


def bristle_columns(position: Array, dt: float, p: friction_bristle.Bristle) -> Array:
    """Force without damping, and rate of the deflection (n, 2), along positions (n,) that are `dt` (s) apart."""
    out = np.empty((len(position), 2))
    friction_path.bristle(p, position, dt, out)
    return out


def lugre(theta: Sequence[float]) -> friction_bristle.Bristle:
    """LuGre of unit friction with this range, rise and speed."""
    return friction_bristle.Bristle(1.0, 1.0 / theta[0], 1.0, 0.0, friction.Stribeck(theta[1], theta[2], SHAPE))


def _gms(p: Path, theta: Sequence[float], s: Shapes) -> Array:
    slips = np.geomspace(s.slip[0], s.slip[-1], thresholds.GMS_OPERATORS)
    return bundle_columns(p.position, p.dt, slips, friction.Stribeck(theta[0], theta[1], SHAPE))


def _dahl(p: Path, theta: Sequence[float], s: Shapes) -> Array:
    return bristle_columns(p.position, p.dt, friction_bristle.Bristle(1.0, 1.0 / theta[0], theta[1]))[:, :1]


def _lugre(p: Path, theta: Sequence[float], s: Shapes) -> Array:
    return _damped(bristle_columns(p.position, p.dt, lugre(theta)), s)


def _elastoplastic(p: Path, theta: Sequence[float], s: Shapes) -> Array:
    out = np.empty((len(p.position), 2))
    _bent_and_slipped(p.position, p.dt, tuple(float(value) for value in theta), out)
    return _damped(out, s)


@kernel
def _plastic_share(z: float, dx: float, first: float, last: float) -> float:
    """Share of a move that is slip: 0 up to the deflection `first`, 1 from `last` on."""
    if z * dx <= 0.0 or abs(z) <= first:
        return 0.0
    if abs(z) >= last:
        return 1.0
    return 0.5 + 0.5 * math.sin(math.pi * (abs(z) - 0.5 * (last + first)) / (last - first))


@kernel
def _deflected(z: float, dx: float, last: float, share: float) -> float:
    """Deflection after a move `dx` with the share of slip held: exact."""
    if share == 0.0:
        return z + dx
    end = math.copysign(last / share, dx)
    return end + (z - end) * math.exp(-abs(dx / end))


@kernel
def _bent_and_slipped(x: Any, dt: float, theta: Any, out: Any) -> None:
    """Fill `out` (n, 2) by the elasto-plastic law: force of unit size, and rate of the deflection.

    A bristle that only bends up to a share of its deflection, and then slips; the midpoint rule in the share of slip::

        dz/dt = v - alpha(z, v) |v| z / z_max(v)        alpha rises from 0 at `elastic` z_c to 1 at z_max

    Source: P. Dupont, V. Hayward, B. Armstrong, F. Altpeter, IEEE Trans. Automatic Control 47(5), 2002.
    """
    span, rise, speed, elastic = theta
    z = 0.0
    out[0, 0], out[0, 1] = 0.0, 0.0
    for k in range(1, len(x)):
        dx, before = x[k] - x[k - 1], z
        if dx != 0.0:
            last = span * (1.0 + rise * math.exp(-((dx / dt / speed) ** 2)))
            share = _plastic_share(z, dx, elastic * span, last)
            middle = _deflected(z, 0.5 * dx, last, share)
            z = _deflected(z, dx, last, _plastic_share(middle, dx, elastic * span, last))
        out[k, 0], out[k, 1] = z / span, (z - before) / dt


def _damped(out: Array, s: Shapes) -> Array:
    """Force of unit size and rate (n, 2) with the rate in units of a slow speed."""
    return np.asarray(out / np.array([1.0, thresholds.DAMPING_SPEED * s.fastest]), dtype=np.float64)


def _static(p: Path, theta: Sequence[float], s: Shapes) -> Array:
    side = np.tanh(p.velocity / theta[0])
    return np.column_stack([side, side * np.exp(-((p.velocity / theta[1]) ** SHAPE))])


LAWS: dict[str, Law] = {
    "maxwell-slip": Law(
        "Maxwell slip",
        thresholds.SLIPS,
        (),
        lambda p, theta, s: bundle_columns(p.position, p.dt, s.slip, friction.Stribeck()),
    ),
    "gms": Law("GMS", thresholds.GMS_OPERATORS, ("rise", "stribeck"), _gms),
    "dahl": Law("Dahl", 1, ("range", "exponent"), _dahl),
    "lugre": Law("LuGre", 1, ("range", "rise", "stribeck"), _lugre),
    "elasto-plastic": Law("elasto-plastic", 1, ("range", "rise", "stribeck", "elastic"), _elastoplastic),
    "stribeck": Law("Stribeck", 1, ("smoothing", "stribeck"), _static),
}


def columns(law: Law, paths: Sequence[Path], theta: Sequence[float], s: Shapes) -> Array:
    """Windowed columns (rows, k) of all captures."""
    return np.vstack([p.smoothed(np.ascontiguousarray(law.columns(p, theta, s).T)).T for p in paths])


def prior(forces: int, number: int, coulomb: float) -> tuple[Array, Array]:
    """Mean and standard deviation of a law's `number` weights: those of friction of unit size, and the others."""
    mean, deviation = np.zeros(number), np.full(number, thresholds.LAW_EXTRA * coulomb)
    mean[:forces], deviation[:forces] = coulomb / forces, thresholds.LAW_WEIGHT * coulomb / forces
    return mean, deviation
