"""The method `least-squares`: each capture is solved by itself, and the estimates are pooled.

With covariances ``C_k`` the estimates ``x_k`` combine to ``x = (sum C_k^-1)^-1 sum C_k^-1 x_k``.
"""

from __future__ import annotations

import math
from typing import get_type_hints

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.least_squares.model import RegressionModel, reported_estimates
from stagectl.identification.least_squares.regression import RegressionResult, least_squares
from stagectl.identification.result import IdentificationResult, Parameter, Progress
from stagectl.identification.thresholds import NORMAL_95
from stagectl.kernels.stage import Mechanics
from stagectl.units import quantity_of


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
    results = []
    for number, capture in enumerate(captures):
        results.append(_solved(capture, file, model))
        progress(number + 1, len(captures))
    values, covariance = pooled(results)
    estimates, correlation = reported_estimates(model, values, covariance, covariance)
    unit = units(file, model)
    parameters = {
        name: Parameter(
            estimate.value,
            estimate.value - NORMAL_95 * estimate.deviation,
            estimate.value + NORMAL_95 * estimate.deviation,
            unit[name],
        )
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


def units(file: StageFile, model: RegressionModel) -> dict[str, str]:
    """SI unit of each parameter on this axis."""
    hints = get_type_hints(Mechanics, include_extras=True)
    quantities = {name: quantity_of(hints[_field(name)]) for name in model.names}
    return {name: quantity.unit_for(file.axis.kind) for name, quantity in quantities.items() if quantity is not None}


def _field(name: str) -> str:
    """Field of the mechanics with the same unit: Coulomb friction and gravity are efforts, as the bias is."""
    kind = name.split("_")[0]
    return kind if kind in ("inertia", "viscous") else "bias"


def _solved(capture: Capture, file: StageFile, model: RegressionModel) -> RegressionResult:
    force = file.motor.force_constant * capture.current
    try:
        return least_squares(capture.time, capture.position, force, model=model)
    except IdentificationError as error:
        raise error.within(capture.name) from error


def pooled(results: list[RegressionResult]) -> tuple[Array, Array]:
    """Parameters (k,) of the regression and their covariance (k, k), from all `results` together."""
    if len(results) == 1:
        return results[0].solution
    weights = [np.linalg.inv(result.solution[1]) for result in results]
    covariance = np.asarray(np.linalg.inv(np.sum(weights, axis=0)), dtype=np.float64)
    total = np.sum([w @ result.solution[0] for w, result in zip(weights, results, strict=True)], axis=0)
    return covariance @ total, covariance
