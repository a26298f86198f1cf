"""What a session is read from: our recordings, folders of captures, single logs; each log as it was found."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.gap.logs.session import Array, GapError
from stagectl.kernels.law import Setpoint
from stagectl.recording.hdf5 import Recording, open_recording
from stagectl.units import StageError

COLUMNS = {
    "position": "measured",
    "command": "command",
    "current": "measured_current",
    "reference": "reference",
    "injection": "injection",
    "fault": "fault",
}
_USES = ("diagnose", "held-out")


class Found(NamedTuple):
    """One log as it was found, in the units of the axis."""

    recording: Recording
    name: str
    experiment: str
    repeat: int | None
    held_out: bool
    start: float | None  # s, session clock
    time: Array  # (m,) s, from 0
    columns: dict[str, Array]  # (m,) each, by our names; absent where there is no number
    setpoints: Array | None  # (m, 8), where they were recorded

    @property
    def ours(self) -> bool:
        """Whether it carries its stage file and its law."""
        return "law" in self.recording.meta


def found(paths: Sequence[Path], setup: Setup | None) -> list[Found]:
    """All logs of `paths`: folders of captures or of our recordings, recordings, CSV and MAT files.

    Raises GapError or RecordingError with the path and the reason.
    """
    recordings = [recording for path in paths for recording in _opened(path, setup)]
    if not recordings:
        raise GapError("no log was given; give a folder of captures, recordings, or a log")
    logs = [_log(recording) for recording in recordings]
    names = [log.name for log in logs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise GapError(f"{twice} is there twice; name each log once")
    return _on_one_clock(logs)


def _opened(path: Path, setup: Setup | None) -> list[Recording]:
    if path.is_dir() and not (path / "captures.yaml").is_file():
        inside = sorted(path.glob("*.h5"))
        if not inside:
            raise GapError(f"{path} holds neither captures.yaml nor recordings (*.h5); give a folder that does")
        return [open_recording(one) for one in inside]
    if path.suffix == ".h5":
        return [open_recording(path)]
    from stagectl.recording.imports import read  # with pyarrow, which our own recordings do not need

    return read(path, setup)


def _log(recording: Recording) -> Found:
    entry: dict[str, Any] = recording.meta.get("capture") or {}
    there = recording.samples.dtype.names or ()
    if not len(recording.samples):
        raise GapError(f"{recording.path} holds no rows: record it again")
    columns = {name: np.ascontiguousarray(recording.column(ours)) for name, ours in COLUMNS.items() if ours in there}
    columns = {name: column for name, column in columns.items() if np.any(np.isfinite(column))}
    known = set(Setpoint._fields) <= set(there)
    if known:
        columns["injection"] = columns["injection"] + recording.column("learned")
    setpoints = np.stack([recording.column(name) for name in Setpoint._fields], axis=1) if known else None
    time = recording.column("time")
    return Found(
        recording,
        recording.path.name,
        str(entry.get("experiment", recording.meta.get("trajectory", recording.path.stem))),
        _repeat(recording, entry),
        _held_out(recording, entry),
        _number(recording, entry, "start_s"),
        np.asarray(time - time[0], dtype=np.float64),
        columns,
        setpoints,
    )


def _held_out(recording: Recording, entry: dict[str, Any]) -> bool:
    use = entry.get("use", _USES[0])
    if use not in _USES:
        raise GapError(f"{recording.path}: use = {use!r} in captures.yaml; must be {' or '.join(_USES)}")
    return bool(use == _USES[1])


def _repeat(recording: Recording, entry: dict[str, Any]) -> int | None:
    found = _number(recording, entry, "repeat")
    if found is not None and found != round(found):
        raise GapError(f"{recording.path}: repeat = {found:g} in captures.yaml; must be a whole number")
    return None if found is None else round(found)


def _number(recording: Recording, entry: dict[str, Any], key: str) -> float | None:
    value = entry.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise GapError(f"{recording.path}: {key} = {value!r} in captures.yaml; must be a number")
    return float(value)


def _on_one_clock(logs: list[Found]) -> list[Found]:
    """Repeats numbered, and our own recordings on a clock that starts with the first of them."""
    counted: dict[str, int] = {}
    begun = [_created(log) for log in logs]
    first = min((one for one in begun if one is not None), default=0.0)
    placed = []
    for log, created in zip(logs, begun, strict=True):
        counted[log.experiment] = counted.get(log.experiment, 0) + 1
        start = created - first if log.start is None and created is not None else log.start
        repeat = counted[log.experiment] if log.repeat is None else log.repeat
        placed.append(log._replace(start=start, repeat=repeat))
    return placed


def _created(log: Found) -> float | None:
    """When one of our own recordings began, by the wall clock; the date of an import is not that of its log."""
    if not log.ours:
        return None
    try:
        return datetime.datetime.strptime(log.recording.meta["created"], "%Y-%m-%dT%H:%M:%S%z").timestamp()
    except (KeyError, ValueError) as error:
        raise StageError(f"{log.recording.path} does not say when it was recorded: {error}") from error
