"""Least squares over several captures: one answer from all.

Each capture is solved by itself; with covariances ``C_k`` the answers ``x_k`` combine to the least-squares one,
``x = (sum C_k^-1)^-1 sum C_k^-1 x_k``.
"""

from __future__ import annotations

import math
from typing import Any, get_type_hints

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.least_squares import Model, Result, estimated, least_squares
from stagectl.identification.result import Found, Parameter
from stagectl.identification.standard_errors import SURE
from stagectl.kernels.stage import Mechanics
from stagectl.units import quantity_of


def identify(
    captures: list[Capture], file: StageFile, progress: Any = None, gravity: bool = False, directions: bool = False
) -> Found:
    """Inertia, viscous and Coulomb friction and offset; the force is the force constant times the current.

    `gravity` adds what depends on the sine and cosine of the position, `directions` lets each direction have friction
    of its own.  Raises IdentificationError where a capture does not tell the parameters.
    """
    model = Model(gravity, directions)
    results = []
    for number, capture in enumerate(captures):
        results.append(_solved(capture, file, model))
        if progress is not None:
            progress(number + 1, len(captures))
    values, covariance = _combined(results)
    estimates, correlation = estimated(model, values, covariance, covariance)
    found = units(file, model)
    parameters = {
        name: Parameter(one.value, one.value - SURE * one.deviation, one.value + SURE * one.deviation, found[name])
        for name, one in estimates.items()
    }
    details = {
        "force_residual_percent": math.sqrt(np.mean([one.residual_percent**2 for one in results])),
        "correlation": correlation.tolist(),
        "condition": max(one.condition for one in results),
    }
    named = {"mechanics.inertia": "inertia", "mechanics.viscous": "viscous"}
    changes = {key: parameters[name].value for key, name in named.items()}
    return Found(parameters, details=details, notes=_notes(results), changes=changes)


def units(file: StageFile, model: Model = Model()) -> dict[str, str]:  # noqa: B008
    """SI unit of each parameter on this axis."""
    hints = get_type_hints(Mechanics, include_extras=True)
    found = {name: quantity_of(hints[_field(name)]) for name in model.names}
    return {name: quantity.unit_for(file.axis.kind) for name, quantity in found.items() if quantity is not None}


def _field(name: str) -> str:
    """Field of the mechanics with the same unit: Coulomb friction and gravity are efforts, as the bias is."""
    kind = name.split("_")[0]
    return kind if kind in ("inertia", "viscous") else "bias"


def _notes(results: list[Result]) -> tuple[str, ...]:
    """Each once, however many captures say it."""
    said = [note for result in results for note in result.notes]
    return tuple(dict.fromkeys(said))


def _solved(capture: Capture, file: StageFile, model: Model) -> Result:
    force = file.motor.force_constant * capture.current
    try:
        return least_squares(capture.time, capture.position, force, model=model)
    except IdentificationError as error:
        raise IdentificationError(f"{capture.name}: {error}") from error


def _combined(results: list[Result]) -> tuple[Array, Array]:
    """Parameters (k,) of the regression and their covariance (k, k)."""
    if len(results) == 1:
        return results[0].solution
    weights = [np.linalg.inv(result.solution[1]) for result in results]
    covariance = np.asarray(np.linalg.inv(np.sum(weights, axis=0)), dtype=np.float64)
    total = np.sum([w @ result.solution[0] for w, result in zip(weights, results, strict=True)], axis=0)
    return covariance @ total, covariance
