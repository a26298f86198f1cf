"""The methods by the names that a user types, and the one form in which all of them answer."""

from __future__ import annotations

import importlib
import inspect
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.config.stage_file import Setup
from stagectl.identification.capture import Capture, IdentificationError
from stagectl.identification.result import Characteristic, Found, Progress
from stagectl.units import LINEAR

TIED = 0.95  # correlation, either way


class Method(NamedTuple):
    """Where a method is, and what it is for."""

    module: str  # holds identify(captures, file, progress, ...) -> Found
    words: str


METHODS = {
    "simultaneous": Method(
        "simultaneous.method", "inertia, viscous and rolling friction and delay from any motion with reversals"
    ),
    "frf": Method("response.method", "response from current to velocity, at several amplitudes"),
    "constant-speed": Method("constant_speed", "viscous and Coulomb friction from spans of constant speed"),
    "low-speed": Method("low_speed", "rolling friction from an ultra-slow motion there and back"),
    "zero-crossing": Method("reversal.method", "friction around the reversals of a slider"),
    "least-squares": Method("pooled_estimate", "inertia, viscous and Coulomb friction and offset"),
    "friction-models": Method("friction.method", "every friction model of the family, fitted and compared"),
}


def identify(
    name: str, captures: Sequence[Capture], file: StageFile, progress: Progress, options: Mapping[str, Any]
) -> Found:
    """What a method finds; `options` by the names of its arguments, None and False where they were not given.

    Raises IdentificationError where the method knows no such option, or the captures do not tell its parameters.
    """
    solve = importlib.import_module(f"stagectl.identification.{METHODS[name].module}").identify
    known = inspect.signature(solve).parameters
    given = {option: value for option, value in options.items() if value is not None and value is not False}
    if foreign := [option for option in given if option not in known]:
        own = [f"--{option}" for option in options if option in known]
        raise IdentificationError(
            f"--{foreign[0]} is not an option of {name}; {'it has ' + ', '.join(own) if own else 'leave it out'}"
        )
    found: Found = solve(list(captures), file, progress=progress, **given)
    return found


def chosen(name: str) -> Method:
    """The method of that name; raises IdentificationError naming those that there are."""
    if name not in METHODS:
        raise IdentificationError(
            f"method {name}; must be one of\n"
            + "\n".join(f"  {one}: {method.words}" for one, method in METHODS.items())
        )
    return METHODS[name]


def result(name: str, setup: Setup, captures: Sequence[Capture], found: Found, left: Sequence[str]) -> dict[str, Any]:
    """Everything as JSON values; `left` are the captures that were held out."""
    common = ("force_residual_percent", "correlation", "condition")
    return {
        "method": name,
        "stage": setup.file.name,
        "parameters": {key: _plain(one._asdict()) for key, one in found.parameters.items()},
        "table": _table(found.table, setup) if found.table is not None else None,
        "identifiability": _plain(_identifiability(found)),
        **{key: _plain(found.details[key]) for key in common if key in found.details},
        "captures": [_capture(one) for one in captures],
        "held_out": list(left),
        "notes": [note for note in (*found.notes, *_together(found)) if not any(note in one.notes for one in captures)],
        "changes": _plain(found.changes),
        "details": _plain({key: one for key, one in found.details.items() if key != "identifiability"}),
    }


def _identifiability(found: Found) -> Any:
    """What a method says of it, else the correlations of its parameters."""
    told, matrix = found.details.get("identifiability"), found.details.get("correlation")
    if told is not None or matrix is None or len(matrix) > len(found.parameters):
        return told
    return {"names": list(found.parameters)[: len(matrix)], "correlation": matrix}


def _together(found: Found) -> list[str]:
    """Pairs of parameters whose errors are nearly one, where the method does not say so itself."""
    if "identifiability" in found.details:
        return []
    told = _identifiability(found) or {"names": [], "correlation": []}
    names, matrix = told["names"], told["correlation"]
    pairs = [(names[j], names[k], matrix[j][k]) for j in range(len(names)) for k in range(j)]
    return [
        f"{a} and {b}: tied to each other in this motion (correlation {r:+.2f}), each known no better than the other"
        for a, b, r in pairs
        if abs(r) > TIED
    ]


def _capture(capture: Capture) -> dict[str, Any]:
    return {
        "name": capture.name,
        "rows": len(capture.time),
        "duration": capture.dt * len(capture.time),
        "dt": capture.dt,
        "current": capture.current_column,
        "notes": list(capture.notes),
    }


def _table(table: Characteristic, setup: Setup) -> dict[str, Any]:
    length, force = ("m", "N") if setup.file.axis.kind == LINEAR else ("rad", "N m")
    units = {"displacement": length, "force": force, "weight": force, "slip": length}
    return {**_plain(table._asdict()), "units": units}


def _plain(value: Any) -> Any:
    """As JSON can hold it: a number that is none becomes null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if hasattr(value, "_asdict"):
        return _plain(value._asdict())
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
