"""Least squares over several captures: one answer from all.

Each capture is solved by itself; with covariances ``C_k`` the answers ``x_k`` combine to the least-squares one,
``x = (sum C_k^-1)^-1 sum C_k^-1 x_k``.
"""

from __future__ import annotations

import math
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import StageFile
from stagectl.identification import least_squares as method
from stagectl.identification.capture import Capture, IdentificationError
from stagectl.identification.found import Found, Parameter
from stagectl.kernels.stage import Mechanics
from stagectl.units import quantity_of

# Parameters, and the field of the mechanics that has the same unit: Coulomb friction is an effort, as the bias is.
NAMES = {"inertia": "inertia", "viscous": "viscous", "coulomb": "bias", "offset": "bias"}
SURE = 1.959964  # standard deviations either way hold 95 %


def identify(captures: list[Capture], file: StageFile, progress: Any = None) -> Found:
    """Inertia, viscous and Coulomb friction and offset; the force is the force constant times the current.

    Raises IdentificationError where a capture does not tell the parameters.
    """
    results = []
    for number, capture in enumerate(captures):
        results.append(_solved(capture, file))
        if progress is not None:
            progress(number + 1, len(captures))
    values, covariance = _combined(results)
    deviations = np.sqrt(np.diag(covariance))
    found = units(file)
    parameters = {
        name: Parameter(value, value - SURE * sd, value + SURE * sd, found[name])
        for name, value, sd in zip(NAMES, values.tolist(), deviations.tolist(), strict=True)
    }
    details = {
        "force_residual_percent": math.sqrt(np.mean([one.residual_percent**2 for one in results])),
        "correlation": (covariance / np.outer(deviations, deviations)).tolist(),
        "condition": max(one.condition for one in results),
    }
    named = {"mechanics.inertia": "inertia", "mechanics.viscous": "viscous"}
    return Found(parameters, details=details, changes={key: parameters[name].value for key, name in named.items()})


def units(file: StageFile) -> dict[str, str]:
    """SI unit of each parameter on this axis."""
    hints = get_type_hints(Mechanics, include_extras=True)
    found = {name: quantity_of(hints[field]) for name, field in NAMES.items()}
    return {name: quantity.unit_for(file.axis.kind) for name, quantity in found.items() if quantity is not None}


def _solved(capture: Capture, file: StageFile) -> method.Result:
    try:
        return method.least_squares(capture.time, capture.position, file.motor.force_constant * capture.current)
    except (IdentificationError, method.IdentificationError) as error:
        raise IdentificationError(f"{capture.name}: {error}") from error


def _combined(results: list[method.Result]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values (4,) and their covariance (4, 4)."""
    values = [np.array([estimate.value for estimate in result[:4]]) for result in results]
    spread = [np.array([estimate.deviation for estimate in result[:4]]) for result in results]
    covariances = [
        np.asarray(np.outer(sd, sd) * result.correlation, dtype=np.float64)
        for sd, result in zip(spread, results, strict=True)
    ]
    if len(results) == 1:
        return values[0], covariances[0]
    weights = [np.linalg.inv(covariance) for covariance in covariances]
    covariance = np.asarray(np.linalg.inv(np.sum(weights, axis=0)), dtype=np.float64)
    return covariance @ np.sum([w @ x for w, x in zip(weights, values, strict=True)], axis=0), covariance
