"""What a session is read from: our recordings, folders of captures, single logs; each log as it is in its file."""

import datetime
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.gap.logs.nominal_values import unknown_key
from stagectl.gap.logs.session import Array, LogError
from stagectl.kernels.law import Setpoint
from stagectl.problem import Problem, ProblemKind
from stagectl.recording.hdf5 import Recording
from stagectl.recording.in_memory import given_twice
from stagectl.recording.opening import own_recordings, recordings_at
from stagectl.recording.scales import read_values, scales_of_nominal
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
_ENTRY = ("file", "experiment", "repeat", "use", "start_s", "injection", "setpoints")  # keys in captures.yaml


class RawLog(NamedTuple):
    """One log as it is in its file, in the units of the axis."""

    recording: Recording
    name: str
    experiment: str
    repeat: int | None
    held_out: bool
    start: float | None  # s, session clock
    time: Array  # (m,) s, from 0
    columns: dict[str, Array]  # (m,) each, by our names; only those that hold numbers
    setpoints: Array | None  # (m, 8), where they were recorded

    @property
    def ours(self) -> bool:
        """Whether it is a recording of stagectl, which carries its stage file and its law."""
        return "law" in self.recording.meta


class Description(NamedTuple):
    """What a user says of logs that do not say it themselves."""

    columns: Mapping[str, str] | None = None  # of a log: see `recording.columns.choices`
    stage: Mapping[str, Any] | None = None  # the block `stage` of a nominal.yaml
    blocks: Mapping[str, Mapping[str, Any]] = MappingProxyType({})  # its others
    notes: tuple[str, ...] = ()  # on them


def read_logs(paths: Sequence[Path], setup: Setup | None, said: Description) -> list[RawLog]:
    """All logs of `paths`: folders of captures or of our recordings, recordings, CSV and MAT files.

    Raises LogError or RecordingError with the path and the reason.
    """
    recordings = [recording for path in paths for recording in _opened(path, setup, said)]
    if not recordings:
        raise LogError("none", (), "no log was given; give a folder of captures, recordings, or a log")
    logs = [_log(recording) for recording in recordings]
    names = [log.name for log in logs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise LogError("duplicate", (twice,), given_twice(twice))
    return _on_one_clock(logs)


def _opened(path: Path, setup: Setup | None, said: Description) -> list[Recording]:
    if own_recordings(path):
        return recordings_at(path, setup)
    beside = path.parent / "nominal.yaml"
    nominal = (
        {"stage": dict(said.stage), **said.blocks} if said.stage else read_values(beside) if beside.is_file() else {}
    )
    recordings = recordings_at(path, setup, said.columns, scales_of_nominal(nominal, beside) if nominal else None)
    listed = (path / "captures.yaml").is_file()
    for recording in recordings if nominal and not listed else ():
        recording.meta["nominal"] = {**recording.meta.get("nominal", {}), **nominal}
    return recordings


def _log(recording: Recording) -> RawLog:
    entry: dict[str, Any] = recording.meta.get("capture") or {}
    there = recording.samples.dtype.names or ()
    if not len(recording.samples):
        raise LogError("empty", (recording.path.name,), f"{recording.path} holds no rows: record it again")
    columns = {name: np.ascontiguousarray(recording.column(ours)) for name, ours in COLUMNS.items() if ours in there}
    columns = {name: column for name, column in columns.items() if np.any(np.isfinite(column))}
    known = set(Setpoint._fields) <= set(there)
    if known:
        columns["injection"] = columns["injection"] + recording.column("learned")
    setpoints = np.stack([recording.column(name) for name in Setpoint._fields], axis=1) if known else None
    _put_in_place(recording, columns, setpoints)
    time = recording.column("time")
    return RawLog(
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


def _put_in_place(recording: Recording, columns: dict[str, Array], setpoints: Array | None) -> None:
    """Positions as the drive counts them: those of a run count from its start, and cogging does not."""
    origin = recording.meta.get("origin", 0.0)
    if not np.isfinite(origin) or origin == 0.0:
        return
    for name in ("position", "reference"):
        if name in columns:
            columns[name] = columns[name] + origin
    if setpoints is not None:
        setpoints[:, [Setpoint._fields.index(name) for name in ("reference", "target")]] += origin


def unknown_keys(log: RawLog) -> list[str]:
    """A note on each key of a log's entry in captures.yaml that has no effect."""
    entry = {} if log.ours else log.recording.meta.get("capture") or {}
    strange = [str(key) for key in entry if key not in _ENTRY]
    return [unknown_key(key, key, "its entry in captures.yaml", _ENTRY) for key in strange]


def _refused(recording: Recording, key: str, value: Any, rule: str) -> LogError:
    words = f"{recording.path}: {key} = {value} in captures.yaml; {rule}"
    return LogError("entry", (recording.path.name,), words)


def _held_out(recording: Recording, entry: dict[str, Any]) -> bool:
    use = entry.get("use", _USES[0])
    if use not in _USES:
        raise _refused(recording, "use", repr(use), f"must be {' or '.join(_USES)}")
    return bool(use == _USES[1])


def _repeat(recording: Recording, entry: dict[str, Any]) -> int | None:
    number = _number(recording, entry, "repeat")
    if number is not None and number != round(number):
        raise _refused(recording, "repeat", f"{number:g}", "must be a whole number")
    return None if number is None else round(number)


def _number(recording: Recording, entry: dict[str, Any], key: str) -> float | None:
    value = entry.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise _refused(recording, key, repr(value), "must be a number")
    return float(value)


def _on_one_clock(logs: list[RawLog]) -> list[RawLog]:
    """Repeats numbered, and logs that know it on a clock that starts with the first of them."""
    counts: dict[str, int] = {}
    created = _one_after_the_other(logs) or [_created(log) for log in logs]
    first = min((instant for instant in created if instant is not None), default=0.0)
    placed = []
    for log, instant in zip(logs, created, strict=True):
        counts[log.experiment] = counts.get(log.experiment, 0) + 1
        start = instant - first if log.start is None and instant is not None else log.start
        repeat = counts[log.experiment] if log.repeat is None else log.repeat
        placed.append(log._replace(start=start, repeat=repeat))
    return placed


def _one_after_the_other(logs: list[RawLog]) -> Sequence[float | None]:
    """The first time stamps (s) of logs from elsewhere that go on where others have ended: of one clock; else none."""
    first = [log.recording.meta.get("source", {}).get("first_time") for log in logs]
    if len(logs) < 2 or any(start is None for start in first):
        return ()
    spans = sorted((start, start + log.time[-1]) for start, log in zip(first, logs, strict=True))
    return () if any(later < end for (_, end), (later, _) in itertools.pairwise(spans)) else first


def _created(log: RawLog) -> float | None:
    """Wall clock (s) at the beginning of one of our own recordings; the date of an import is not that of its log."""
    if not log.ours:
        return None
    try:
        return datetime.datetime.strptime(log.recording.meta["created"], "%Y-%m-%dT%H:%M:%S%z").timestamp()
    except (KeyError, ValueError) as error:
        reason = f"{log.recording.path} does not hold the date of its recording: {error}"
        raise StageError(Problem(reason, ProblemKind.MISSING, file=log.recording.path)) from error
