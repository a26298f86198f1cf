"""The diagnosis as JSON, and back: section 5 of the design, and beside it what `apply` and `next` need.

Left out are the traces, which only the page draws; curves keep every so manieth point.  What is not a number in JSON
(NaN, infinity) is null there, and NaN when it comes back.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stagectl.gap.logs.session import GapError
from stagectl.gap.result.diagnosis import (
    VERDICTS,
    Array,
    Coordinate,
    DiagnosisResult,
    Fields,
    FoundEffect,
    Gap,
    NextExperiment,
    Spans,
    UnknownTerm,
    Value,
)

NAME = "diagnosis.json"
MOST_POINTS = 400  # of a curve
_LARGEST = 50_000_000  # bytes

Json = dict[str, Any]


def as_json(found: DiagnosisResult) -> Json:
    """Values that `json` writes; everything in SI and axis units."""
    blocks = {name: _number(share) for name, share in found.blocks.items()}
    return {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "reason": found.reason,
        "effects": [_effect(one) for one in found.effects],
        "gap": _plain(found.gap),
        "gaps": {name: _plain(one) for name, one in found.gaps.items()},
        "where": {
            "blocks": blocks,
            "impossible": dict(found.impossible),
            "coordinates": [_plain(one) for one in found.coordinates],
            "captures": [_plain(one) for one in found.captures],
        },
        "shares": [{"name": name, "share": _number(share)} for name, share in found.shares],
        "next_experiment": None if found.next_experiment is None else _plain(found.next_experiment),
        "unknown": None if found.unknown is None else _shape(found.unknown),
        "notes": list(found.notes),
        "cannot_tell": list(found.cannot_tell),
        "axis": {"kind": found.kind, "travel_per_unit": found.travel_per_unit, "travel_unit": found.travel_unit},
        "seconds": {name: _number(seconds) for name, seconds in found.seconds},
    }


def _effect(one: FoundEffect) -> Json:
    curve = None if one.curve is None else [_thinned(column) for column in one.curve]
    parameters = {name: _plain(value) for name, value in one.parameters.items()}
    fields = _fields(one.fields)
    return {**_plain(one._replace(parameters={}, curve=None)), "parameters": parameters, "curve": curve, **fields}


def _shape(one: UnknownTerm) -> Json:
    grid, force = _thinned(one.grid), _thinned(one.force)
    return {**_plain(one._replace(grid=np.empty(0), force=np.empty(0))), "grid": grid, "force": force} | _fields(
        one.fields
    )


def _fields(fields: Fields) -> Json:
    return {"fields": {name: _value(setting) for name, setting in fields}}


def _plain(one: Any) -> Json:
    return {name: _value(value) for name, value in one._asdict().items()}


def _value(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [_value(one) for one in value]
    if isinstance(value, np.ndarray):
        return [_number(one) for one in value]
    if isinstance(value, (float, np.floating)):
        return _number(value)
    return value


def _number(value: Any) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


def _thinned(column: Array) -> list[float | None]:
    step = max(1, -(-len(column) // MOST_POINTS))
    return [_number(one) for one in column[::step]]


def save(found: DiagnosisResult, folder: Path) -> Path:
    """Write ``diagnosis.json`` into the folder of the captures; where it stands now."""
    path = folder / NAME
    path.write_text(json.dumps(as_json(found), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return path


def load(place: Path) -> DiagnosisResult:
    """The diagnosis of a folder that `gap diagnose` has been through, or of the JSON file it wrote.

    Raises GapError where there is none, or where it is no diagnosis.
    """
    path = place / NAME if place.is_dir() else place
    if not path.exists():
        raise GapError(f"{path} does not exist: run `stagectl gap diagnose {place}` first")
    try:
        if path.stat().st_size > _LARGEST:
            raise GapError(f"{path} is larger than {_LARGEST / 1e6:g} MB: no diagnosis")
        told = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise GapError(f"{path} cannot be read as JSON: {error}; run `stagectl gap diagnose` again") from error
    try:
        return restored(told)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        words = f"{path} is no diagnosis: {type(error).__name__} at {error}; run `stagectl gap diagnose` again"
        raise GapError(words) from error


def restored(told: Mapping[str, Any]) -> DiagnosisResult:
    """What `as_json` made, as it was, without the traces; raises KeyError, TypeError or ValueError where it was not."""
    if told["verdict"] not in VERDICTS:
        raise ValueError(f"verdict = {told['verdict']!r}; must be one of {', '.join(VERDICTS)}")
    where, axis, unknown, following = told["where"], told["axis"], told["unknown"], told["next_experiment"]
    return DiagnosisResult(
        told["verdict"],
        str(told["sentence"]),
        tuple(_restored_effect(one) for one in told["effects"]),
        _gap(told["gap"]),
        {name: _gap(one) for name, one in told["gaps"].items()},
        dict(where["blocks"]),
        tuple(Coordinate(one["name"], _float(one["share"])) for one in where["coordinates"]),
        tuple(Spans(one["file"], tuple((a, b) for a, b in one["spans"]), one["duration"]) for one in where["captures"]),
        tuple((one["name"], _float(one["share"])) for one in told["shares"]),
        None if following is None else NextExperiment(**{**following, "separates": tuple(following["separates"])}),
        None if unknown is None else _restored_shape(unknown),
        notes=tuple(told["notes"]),
        cannot_tell=tuple(told["cannot_tell"]),
        kind=axis["kind"],
        travel_per_unit=float(axis["travel_per_unit"]),
        travel_unit=axis["travel_unit"],
        seconds=tuple((name, _float(one)) for name, one in told["seconds"].items()),
        reason=str(told["reason"]),
        impossible=tuple(where["impossible"].items()),
    )


def _float(value: Any) -> float:
    return math.nan if value is None else float(value)


def _gap(one: Mapping[str, Any]) -> Gap:
    numbers = {name: _float(value) for name, value in one.items() if name not in ("unit", "predicted")}
    predicted = None if one["predicted"] is None else float(one["predicted"])
    return Gap(**numbers, unit=one["unit"], predicted=predicted)


def _restored_effect(one: Mapping[str, Any]) -> FoundEffect:
    curve = one["curve"]
    made = {
        "alternatives": tuple(one["alternatives"]),
        "probability": _float(one["probability"]),
        "share": _float(one["share"]),
        "parameters": {name: _restored_value(value) for name, value in one["parameters"].items()},
        "fields": _restored_fields(one["fields"]),
        "curve": None if curve is None else tuple(_column(column) for column in curve),
    }
    return FoundEffect(**{**one, **made})


def _restored_value(one: Mapping[str, Any]) -> Value:
    return Value(_float(one["value"]), _float(one["low"]), _float(one["high"]), one["unit"])


def _restored_shape(one: Mapping[str, Any]) -> UnknownTerm:
    grid, force = _column(one["grid"]), _column(one["force"])
    return UnknownTerm(
        one["coordinate"],
        grid,
        force,
        _float(one["predicted"]),
        _restored_fields(one["fields"]),
        one.get("block", "mechanics"),
    )


def _restored_fields(told: Mapping[str, Any]) -> Fields:
    return tuple((name, tuple(value) if isinstance(value, list) else value) for name, value in told.items())


def _column(values: Any) -> Array:
    return np.array([_float(value) for value in values])
