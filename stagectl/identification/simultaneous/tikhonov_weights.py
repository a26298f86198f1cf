"""Weights as even as the data allow: least squares alone gathers the friction in a few elements with gaps between.

Between the gaps the reversal table would have corners that no axis has.  Of all weights that explain the data as well
as the best ones, within what their noise permits, those with the smallest second differences are taken; inertia,
viscous friction, delay and the sum of the weights keep their values.

Source: Tikhonov regularisation with the discrepancy principle, P. C. Hansen, Rank-Deficient and Discrete Ill-Posed
Problems, SIAM 1998.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import optimize

from stagectl.identification.capture import Array
from stagectl.identification.simultaneous.delay_search import Fit, Problem
from stagectl.identification.simultaneous.regressors import FREE

TIED = 1e3  # weight of the sum's condition beside the data
PERMITTED = 10.0  # rise of the cost, in variances of a row
CORRELATED = 3.0  # rows of the window's noise that count as one
HALVINGS = 24


def evened(p: Problem, fit: Fit) -> Array:
    """Weights (j,) as even as the data allow, with the sum of the fit's."""
    sharp = fit.theta[FREE:]
    columns = p.seen[:, FREE:]
    gram = columns.T @ columns
    size = math.sqrt(float(np.trace(gram)) / len(gram))
    gram = gram / (size * size)
    aim = gram @ sharp + columns.T @ fit.residual / (size * size)
    permitted = PERMITTED * CORRELATED * float(np.mean(fit.residual**2)) / (size * size)
    low, high, found = 1e-12, 1e3, sharp
    for _ in range(HALVINGS):
        strength = math.sqrt(low * high)
        tried = _with(gram, aim, float(sharp.sum()), strength)
        if _cost(gram, aim, tried) - _cost(gram, aim, sharp) <= permitted:
            low, found = strength, tried
        else:
            high = strength
    return np.asarray(found * (sharp.sum() / found.sum()), dtype=np.float64)


def _cost(gram: Array, aim: Array, weight: Array) -> float:
    return float(weight @ gram @ weight - 2.0 * aim @ weight)


def _with(gram: Array, aim: Array, total: float, strength: float) -> Array:
    """Weights >= 0 of least cost plus `strength` times their second differences, with the sum `total`."""
    bent = np.diff(np.eye(len(gram)), 2, axis=0)
    whole = gram + strength * bent.T @ bent + TIED + 1e-10 * np.eye(len(gram))
    triangle = np.linalg.cholesky(whole).T
    weight, _ = optimize.nnls(triangle, np.linalg.solve(triangle.T, aim + TIED * total))
    return np.asarray(weight, dtype=np.float64)
