"""Identification over whole captures: which columns it reads, and one answer from several of them.

Each capture is solved by itself; with covariances ``C_k`` the answers ``x_k`` combine to the least-squares one,
``x = (sum C_k^-1)^-1 sum C_k^-1 x_k``.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import StageFile
from stagectl.identification.least_squares import IdentificationError, Result, least_squares
from stagectl.kernels.stage import Mechanics
from stagectl.recording.hdf5 import Recording
from stagectl.units import quantity_of

# Parameters, and the field of the mechanics that has the same unit: Coulomb friction is an effort, as the bias is.
NAMES = {"inertia": "inertia", "viscous": "viscous", "coulomb": "bias", "offset": "bias"}
CURRENTS = ("measured_current", "current", "command")  # the best that there is: in the motor, after, before the limit
SURE = 1.959964  # standard deviations either way hold 95 %


class Solved(NamedTuple):
    """One capture's answer."""

    name: str
    current: str  # the column that stood for the motor's current
    rows: int
    result: Result


def identify(recordings: list[Recording], file: StageFile) -> dict[str, Any]:
    """Inertia, viscous and Coulomb friction and offset from `recordings`, as JSON values.

    The force is the stage file's force constant times the current.  Captures marked held-out are left alone.
    Raises IdentificationError where nothing is left, or a capture does not tell the parameters.
    """
    used = [one for one in recordings if one.meta.get("capture", {}).get("use") != "held-out"]
    if not used:
        raise IdentificationError("every capture is marked `use: held-out`; give at least one to identify from")
    solved = [_solved(one, file) for one in used]
    values, covariance = _combined([one.result for one in solved])
    deviations = np.sqrt(np.diag(covariance))
    found = units(file)
    return {
        "method": "least-squares",
        "stage": file.name,
        "parameters": {
            name: {"value": value, "low": value - SURE * sd, "high": value + SURE * sd, "unit": found[name]}
            for name, value, sd in zip(NAMES, values.tolist(), deviations.tolist(), strict=True)
        },
        "force_residual_percent": math.sqrt(np.mean([one.result.residual_percent**2 for one in solved])),
        "correlation": (covariance / np.outer(deviations, deviations)).tolist(),
        "condition": max(one.result.condition for one in solved),
        "captures": [
            {
                "name": one.name,
                "rows": one.rows,
                "current": one.current,
                "force_residual_percent": one.result.residual_percent,
            }
            for one in solved
        ],
        "held_out": [str(one.path) for one in recordings if one not in used],
    }


def units(file: StageFile) -> dict[str, str]:
    """SI unit of each parameter on this axis."""
    hints = get_type_hints(Mechanics, include_extras=True)
    found = {name: quantity_of(hints[field]) for name, field in NAMES.items()}
    return {name: quantity.unit_for(file.axis.kind) for name, quantity in found.items() if quantity is not None}


def _solved(recording: Recording, file: StageFile) -> Solved:
    kind = recording.meta["axis"]["kind"]
    if kind != file.axis.kind:
        raise IdentificationError(
            f"{recording.path} is of a {kind} axis, {file.name} is {file.axis.kind}; give the stage it was recorded on"
        )
    name = _current(recording)
    force = file.motor.force_constant * recording.column(name)
    try:
        result = least_squares(recording.column("time"), recording.column("measured"), force)
    except IdentificationError as error:
        raise IdentificationError(f"{recording.path}: {error}") from error
    return Solved(str(recording.path), name, len(force), result)


def _current(recording: Recording) -> str:
    for name in CURRENTS:
        if name in (recording.samples.dtype.names or ()) and np.any(np.isfinite(recording.samples[name])):
            return name
    raise IdentificationError(
        f"{recording.path} holds neither a current nor a command, so no force; it has "
        f"{', '.join(recording.samples.dtype.names or ())}"
    )


def _combined(results: list[Result]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
