"""Instruments: what a motion in closed loop should have been, which no noise has touched.

In closed loop the controller answers to the noise, so current and position hold the same noise and no least squares
is free of it.  The reference is: the columns ``Z`` made from it know the motion, but not the noise.  Position and
current are projected on them, ``P = Z (Z'Z)^-1 Z'``, and the equation of motion is solved there (two-stage least
squares)::

    minimise |P (y - X theta)|^2        X'P (y - X theta) = 0

Source: P. C. Young, Recursive Estimation and Time-Series Analysis, Springer 2011; A. Janot, P.-O. Vandanjon,
M. Gautier, IEEE Trans. Control Systems Technology 22(1), 2014 (robots).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import linalg

from stagectl.identification.capture import Array, Capture
from stagectl.identification.simultaneous.regressors import FREE, Part, columns

APART = 0.05  # of the stroke, rms, between position and reference
EVERY = 3  # slip whose rate of change is an instrument, too: it tells the delay
RIDGE = 1e-10


class Instruments(NamedTuple):
    """Columns of unit length, and the Cholesky factor of their products."""

    columns: Array  # (rows, m)
    triangle: Array  # (m, m), upper


def follow(capture: Capture) -> bool:
    """Whether the capture holds a reference that its position follows."""
    if capture.reference is None or not np.all(np.isfinite(capture.reference)):
        return False
    error = capture.reference - capture.position
    return float(np.std(error)) <= APART * float(np.ptp(capture.position)) and float(np.ptp(capture.reference)) > 0.0


def instruments(parts: list[Part], slip: Array) -> Instruments:
    """Columns of the reference on the same rows, and those that a change of the delay would add."""
    found = np.vstack([_of(part, slip) for part in parts])
    length = np.sqrt(np.einsum("ij,ij->j", found, found))
    found = found[:, length > 0.0] / length[length > 0.0]
    gram = found.T @ found + RIDGE * np.eye(found.shape[1])
    return Instruments(found, np.asarray(np.linalg.cholesky(gram).T, dtype=np.float64))


def _of(part: Part, slip: Array) -> Array:
    reference = part._replace(capture=part.capture._replace(position=np.asarray(part.capture.reference)))
    rates = columns(reference, slip[::EVERY], 1)
    return np.hstack([columns(reference, slip), rates[:, :1], rates[:, FREE:]])


def seen(p: Instruments, signal: Array) -> Array:
    """Coordinates (m, ...) of `signal` (rows, ...) in the space of the instruments; their squares are its length."""
    found = linalg.solve_triangular(p.triangle, p.columns.T @ signal, trans="T", check_finite=False)
    return np.asarray(found, dtype=np.float64)


def projected(p: Instruments, signal: Array) -> Array:
    """`signal` (rows, ...) as the instruments see it."""
    found = p.columns @ linalg.solve_triangular(p.triangle, seen(p, signal), check_finite=False)
    return np.asarray(found, dtype=np.float64)
