"""Compensators made from a friction law, whichever method has identified it: one curve, three ways to hold it.

The curve is the force over the displacement since a full reversal, at speed: without Stribeck's rise and without the
bristle's own damping, which a curve over displacement cannot hold.  GMS takes Stribeck's rise over from the law.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import optimize

from stagectl.compensation.constants import (
    CURVE_ROWS,
    EXPONENTS,
    FROM_FULL_SLIP,
    REACHED,
    ROWS_FROM,
    SPRING_EXPONENT,
    SPRING_STEP,
)
from stagectl.compensation.legs import Array
from stagectl.kernels import friction, friction_memory, friction_path
from stagectl.kernels.plant import Friction


def block(form: str, p: Friction) -> dict[str, Any]:
    """The compensator `form` of the friction `p`, as a block of a stage file (SI).

    Raises KeyError where `form` is none of `table`, `gms` and `rheology`.
    """
    return {"form": form, **_MADE[form](p)}


def reversal_curve(p: Friction, since: Array) -> Array:
    """Force (m,) N m | N at the displacements `since` (m,) rad | m a full reversal."""
    weight, rate = np.asarray(p.operators.weight), np.asarray(p.operators.rate)
    force = np.minimum(np.outer(since, rate) - 1.0, 1.0) @ weight
    if p.bristle.coulomb == 0.0:
        return np.asarray(force)
    law = p.bristle._replace(damping=0.0, stribeck=friction.Stribeck())
    back = -FROM_FULL_SLIP * law.coulomb / law.stiffness
    columns = np.empty((len(since) + 2, 2))
    friction_path.bristle(law, np.concatenate([[0.0, back], back + since]), 1.0, columns)
    return np.asarray(force + columns[2:, 0])


def _coulomb(p: Friction) -> float:
    return float(np.sum(p.operators.weight)) + p.bristle.coulomb


def _rows(p: Friction) -> Array:
    """Displacements (m,) at which the curve bends: those of the operators, and rows of even ratio for a bristle."""
    carrying = np.asarray(p.operators.weight) > 0.0
    rows = 2.0 * np.asarray(p.operators.slip)[carrying]
    if p.bristle.coulomb > 0.0:
        length = p.bristle.coulomb / p.bristle.stiffness
        tried = length * np.geomspace(ROWS_FROM, FROM_FULL_SLIP, 20 * CURVE_ROWS)
        done = tried[np.searchsorted(reversal_curve(p, tried[:-1]), (2.0 * REACHED - 1.0) * _coulomb(p))]
        rows = np.concatenate([rows, np.geomspace(ROWS_FROM * length, done, CURVE_ROWS)])
    return np.concatenate([[0.0], np.unique(rows)])


def _table(p: Friction) -> dict[str, list[float]]:
    """Rows of the curve; it ends at T_c, where a law only approaches it."""
    since = _rows(p)
    force = reversal_curve(p, since)
    force[0], force[-1] = -_coulomb(p), _coulomb(p)
    return {"displacement": since.tolist(), "force": force.tolist()}


def _gms(p: Friction) -> dict[str, Any]:
    """The operators as they are; a bristle as operators that bend the curve at the rows of its table."""
    bundle, rise = p.operators, p.stribeck
    if p.bristle.coulomb > 0.0:  # from rest the curve is half that of a full reversal, over half the displacement
        since, force = (np.array(column) for column in _table(p).values())
        bundle, rise = through(0.5 * since, 0.5 * (force - force[0])), p.bristle.stribeck
    elements = [(float(w), float(s)) for w, s in zip(bundle.weight, bundle.slip, strict=True) if w > 0.0]
    weights, slips = zip(*elements, strict=True)
    made: dict[str, Any] = {"weight": list(weights), "slip": list(slips)}
    return {**made, "stribeck": rise._asdict()} if rise.rise > 0.0 else made


def through(displacement: Array, force: Array) -> friction.StopOperators:
    """Stop operators whose curve from rest goes through these points (m,), as far as it bends down only."""
    slopes = np.diff(force) / np.diff(displacement)
    weight = np.maximum(slopes - np.append(slopes[1:], 0.0), 0.0) * displacement[1:]
    whole = float(np.sum(weight))
    return friction.bundle(weight * (force[-1] / whole) if whole > 0.0 else weight, displacement[1:])


def _rheology(p: Friction) -> dict[str, Any]:
    """Range and exponent by least squares on the curve; a curve over displacement does not tell the creep."""
    since, coulomb = _rows(p), _coulomb(p)
    since = np.unique(np.concatenate([since, np.linspace(0.0, since[-1], CURVE_ROWS)]))
    curve = reversal_curve(p, since)
    start = np.array([np.log(since[-1]), SPRING_EXPONENT])
    bounds = ([np.log(since[1]), EXPONENTS[0]], [np.log(10.0 * since[-1]), EXPONENTS[1]])

    def missing(x: Array) -> Array:
        return _spring(coulomb, x, since) - curve

    fit = optimize.least_squares(missing, start, bounds=bounds, diff_step=[SPRING_STEP] * len(start))
    return {"coulomb": coulomb, "range": float(np.exp(fit.x[0])), "exponent": float(fit.x[1])}


def _spring(coulomb: float, x: Array, since: Array) -> Array:
    """The rheology model's force (m,) at the displacements `since` a full reversal; `x` = (ln range, exponent)."""
    law = friction_memory.Rheology(coulomb, float(np.exp(x[0])), float(x[1]))
    path, out = np.concatenate([[0.0, -10.0 * law.range], since - 10.0 * law.range]), np.empty((len(since) + 2, 2))
    friction_path.rheology(law, path, 1.0, out)
    return np.asarray(out[2:, 0])


_MADE: dict[str, Callable[[Friction], dict[str, Any]]] = {"table": _table, "gms": _gms, "rheology": _rheology}
