"""The method `least-squares`: each capture is solved by itself, and the estimates are pooled.

With covariances ``C_k`` the estimates ``x_k`` combine to ``x = (sum C_k^-1)^-1 sum C_k^-1 x_k``.
"""

from __future__ import annotations

import math

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array, Capture, each
from stagectl.identification.least_squares.model import RegressionModel, reported_estimates
from stagectl.identification.least_squares.regression import RegressionResult, least_squares
from stagectl.identification.result import IdentificationResult, Parameter, Progress
from stagectl.identification.thresholds import NORMAL_95


def identify(
    captures: list[Capture],
    file: StageFile,
    progress: Progress = lambda done, total: None,
    gravity: bool = False,
    directions: bool = False,
) -> IdentificationResult:
    """Inertia, viscous and Coulomb friction and offset; the force is the force constant times the current.

    `gravity` adds terms in the sine and cosine of the position, `directions` a friction for each direction.  Raises
    IdentificationError where a capture does not determine the parameters.
    """
    model = RegressionModel(gravity, directions)
    constant = file.motor.force_constant
    results = list(each(captures, lambda capture: _solved(capture, constant, model), progress))
    values, covariance = pooled(results)
    estimates, correlation = reported_estimates(model, values, covariance, covariance)
    parameters = {
        name: Parameter.named(name, file.axis.kind, estimate.value, NORMAL_95 * estimate.deviation)
        for name, estimate in estimates.items()
    }
    details = {
        "force_residual_percent": math.sqrt(np.mean([result.residual_percent**2 for result in results])),
        "correlation": correlation.tolist(),
        "condition": max(result.condition for result in results),
    }
    changes = {f"mechanics.{name}": parameters[name].value for name in ("inertia", "viscous")}
    notes = dict.fromkeys(note for result in results for note in result.notes)  # each once
    return IdentificationResult(parameters, details=details, notes=tuple(notes), changes=changes)


def _solved(capture: Capture, force_constant: float, model: RegressionModel) -> RegressionResult:
    return least_squares(capture.position, force_constant * capture.current, capture.dt, model)


def pooled(results: list[RegressionResult]) -> tuple[Array, Array]:
    """Parameters (k,) of the regression and their covariance (k, k), from all `results` together."""
    if len(results) == 1:
        return results[0].solution
    weights = [np.linalg.inv(result.solution[1]) for result in results]
    covariance = np.asarray(np.linalg.inv(np.sum(weights, axis=0)), dtype=np.float64)
    total = np.sum([w @ result.solution[0] for w, result in zip(weights, results, strict=True)], axis=0)
    return covariance @ total, covariance
