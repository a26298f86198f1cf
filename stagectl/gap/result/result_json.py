"""The diagnosis as JSON, and back: what pages, `gap apply` and `gap next` need.

Traces are left out, as only the page draws them.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.gap.logs.session import GapError
from stagectl.gap.result.diagnosis import VERDICTS, DiagnosisResult
from stagectl.problem import why_unread
from stagectl.replacing import WRITTEN_BY, write_text
from stagectl.typed_json import TypedJsonError, decoded, encoded

NAME = "diagnosis.json"
_LARGEST = 50_000_000  # bytes of a file; a diagnosis has some 100 kB
_KEYS = (
    *("verdict", "sentence", "reason", "effects", "gap", "gaps", "where", "shares", "next_experiment", "unknown"),
    *("doubts", "notes", "cannot_tell", "axis", "seconds", "friction"),
)
_GROUPS: Mapping[str, tuple[str, ...]] = {  # fields of the diagnosis that are one object
    "where": ("blocks", "parts", "impossible", "coordinates", "captures"),
    "axis": ("kind", "travel_per_unit", "travel_unit", "force_constant"),
}

Json = dict[str, Any]


class _Share(NamedTuple):
    """One part of the gap."""

    name: str
    share: float


class NotADiagnosisError(GapError):
    """The file at `path` is not a diagnosis; `place`, `value` and `expected` where one entry is at fault."""

    def __init__(self, path: Path, reason: str, fault: TypedJsonError | None = None) -> None:
        super().__init__(f"{path} {reason}")
        self.path = path
        self.place = fault.place if fault else ""
        self.value: object = fault.value if fault else None
        self.expected = fault.expected if fault else ""


def as_json(result: DiagnosisResult) -> Json:
    """Values that `json` writes; everything in SI and axis units."""
    fields = encoded(result._replace(traces=()), DiagnosisResult)
    fields |= {"shares": [{"name": name, "share": share} for name, share in fields["shares"].items()]}
    groups = {key: {name: fields[name] for name in names} for key, names in _GROUPS.items()}
    return {key: groups.get(key, fields.get(key)) for key in _KEYS}


def save(result: DiagnosisResult, folder: Path) -> Path:
    """Write ``diagnosis.json`` into the folder of the captures; returns the file."""
    path = folder / NAME
    write_text(path, json.dumps(as_json(result), indent=1, allow_nan=False) + "\n")
    return path


def load(place: Path) -> DiagnosisResult:
    """The diagnosis of a folder that `gap diagnose` has been through, or of the JSON file it wrote.

    Raises NotADiagnosisError where there is none.
    """
    path = place / NAME if place.is_dir() else place
    if not path.exists():
        raise NotADiagnosisError(path, f"does not exist: run `stagectl gap diagnose {place}` first")
    if path.stat().st_size > _LARGEST:
        raise NotADiagnosisError(path, f"is larger than {_LARGEST / 1e6:g} MB: it is not a diagnosis")
    try:
        return restored(json.loads(path.read_text(encoding="utf-8")))
    except TypedJsonError as error:
        raise NotADiagnosisError(
            path, f"is not a diagnosis: {error}; run `stagectl gap diagnose` again", error
        ) from error
    except (OSError, ValueError) as error:
        raise NotADiagnosisError(path, f"cannot be read: {why_unread(error)}; {_next(path)}") from error


def _next(path: Path) -> str:
    if path.suffix in (".yaml", ".yml"):
        return "it looks like a stage file: give the folder of the captures first, the stage file last"
    if path.suffix == ".h5":
        return "it looks like a recording: give the folder that `gap diagnose -o` wrote"
    return "run `stagectl gap diagnose` again"


def restored(data: Any) -> DiagnosisResult:
    """The diagnosis that `as_json` wrote as `data`, without its traces; raises TypedJsonError."""
    if not isinstance(data, dict) or data.get("verdict") not in VERDICTS:
        verdict = data.get("verdict") if isinstance(data, dict) else data
        raise TypedJsonError("verdict", verdict, f"one of {', '.join(VERDICTS)}")
    fields: Json = {key: value for key, value in data.items() if key not in (*_GROUPS, *WRITTEN_BY)}
    for key in _GROUPS:
        group = data.get(key)
        if not isinstance(group, dict):
            raise TypedJsonError(key, group, "an object")
        fields |= group
    fields |= {"shares": dict(decoded(data.get("shares"), tuple[_Share, ...], "shares"))}
    result: DiagnosisResult = decoded(fields, DiagnosisResult)
    return result
