"""Logs of other programs as recordings: CSV and MATLAB files, the EMPS benchmark's among them, folders of captures.

An imported recording has the columns of its log and no others; code that needs a missing one raises an error.
"""

import hashlib
import time as clock
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.kernels import rollout
from stagectl.number_format import duration
from stagectl.problem import ProblemKind, absent
from stagectl.recording import capture_attachments, csv_logs, mat_logs
from stagectl.recording.columns import Array, Log, Stated, without
from stagectl.recording.constants import ROWS_TO_USE
from stagectl.recording.content import stranger
from stagectl.recording.csv_layout import is_table
from stagectl.recording.hdf5 import Recording, RecordingError, check_target, open_recording, save
from stagectl.recording.metadata import STAMP, versions
from stagectl.recording.repair import repaired
from stagectl.recording.scales import NOTHING_KNOWN, Known, Scales, read_values, scales_of_nominal
from stagectl.recording.wrong_units import by_rows

# How a file of another kind becomes one that can be imported, in Python.
_MAT = "; to turn it: `scipy.io.savemat('{1}.mat', "
_CSV = "; to turn it: `pandas."
_ARROW = "; to turn it: `pyarrow.csv.write_csv(pyarrow.FORMAT.read_table('{0}'), '{1}.csv')`"
_TURNED = {
    ".npz": _MAT + "dict(numpy.load('{0}')))`",
    ".npy": _MAT + "dict(data=numpy.load('{0}')))`",
    ".parquet": _ARROW.replace("FORMAT", "parquet"),
    ".feather": _ARROW.replace("FORMAT", "feather"),
    ".json": _CSV + "read_json('{0}').to_csv('{1}.csv', index=False)`",
    ".pkl": _CSV + "read_pickle('{0}').to_csv('{1}.csv', index=False)`",
}


class SourceLog(NamedTuple):
    """A log to read."""

    path: Path
    stated: Stated
    about: Mapping[str, Any]  # what a folder of captures says of it, for the recording's meta


def read(
    path: Path,
    setup: Setup | None = None,
    columns: Mapping[str, str] | None = None,
    scales: Scales | None = None,
    known: Known = NOTHING_KNOWN,
) -> list[Recording]:
    """The recordings in a file or folder; `setup` is the stage it was recorded on, for its scales.

    `columns` says which column or variable is which, where names do not: ``{"position": "qm:mm"}``; with them, `scales`
    may stand in for a stage.  What is `known` is taken where the log has no stage.

    Raises RecordingError, with file and row, where it cannot be understood.
    """
    stated = Stated(setup, columns, scales, known)
    logs = captures(path, stated) if path.is_dir() else [SourceLog(path, stated, {})]
    return [read_log(log) for log in logs]


def read_log(source: SourceLog) -> Recording:
    """The recording in one log.  Raises RecordingError, with file and row, where it cannot be understood."""
    path, stated, about = source
    if not path.is_file():
        raise RecordingError(f"{path}: {absent(path)}", path, ProblemKind.FILE)
    kind = path.suffix.lower()
    if is_text_log(path):
        log = csv_logs.read(path, stated, dict(about))
    elif kind == ".mat":
        log = mat_logs.read(path, stated)
    else:
        raise RecordingError(_no_log(path, kind), path, ProblemKind.SHAPE)
    log = log._replace(about={**log.about, **about})
    return _clocked(_recording(_with_beside(log, about.get("capture", {}))), stated.setup)


def is_text_log(path: Path) -> bool:
    """Whether a file is a table as text: by its ending, or by what it holds."""
    kind = path.suffix.lower()
    return kind == ".csv" or (kind not in (".mat", ".h5", ".yaml", ".yml", *_TURNED) and is_table(path))


def _no_log(path: Path, kind: str) -> str:
    """Why a file of this `kind`, its ending, is not read as a log, and what to do."""
    if kind in (".yaml", ".yml"):
        return f"{path} {_yaml_file(path)}"
    if kind == ".h5":
        open_recording(path, ("time",))  # says what the file is where it is none
        return f"{path} is a recording already, and needs no import: give it to the next command as it is"
    turned = _TURNED.get(kind, "").format(path, path.with_suffix(""))
    if not turned and (what := stranger(path)):
        return f"{path} {what}"
    return (
        f"{path} cannot be imported; these can: a text table (.csv, .txt) with a header of quantities "
        "and units (time_s,position_mm,...) or with --columns, .mat, and a folder with captures.yaml"
        f"{turned}"
    )


def _yaml_file(path: Path) -> str:
    """What a YAML file in the place of a log is, by its entries, and what to give instead."""
    values = read_values(path)
    if "type" in values and "axis" not in values:
        return f"is a trajectory and no log; `stagectl simulate STAGE.yaml {path} -o run.h5` makes a recording of it"
    if "captures" in values:
        return f"lists captures and is no log itself; give its folder, {path.parent}"
    return f"is a stage file and cannot be imported; name the logs, and give it as --stage {path}"


def store(recordings: list[Recording], source: Path, output: Path | None) -> list[Path]:
    """Write imported recordings; those of a folder go into a folder."""
    base = output or Path("recordings") / (source.name if source.is_dir() else f"{source.stem}.h5")
    targets = [base / f"{recording.path.stem}.h5" if source.is_dir() else base for recording in recordings]
    for target in targets:
        check_target(target)
    if there := [target for target in targets if target.exists()]:
        reason = f"{there[0]} exists and is left as it is: choose another place with -o"
        raise RecordingError(reason, there[0], ProblemKind.CONFLICT)
    for recording, target in zip(recordings, targets, strict=True):
        with RecordingError.instead_of((OSError,), f"{target} cannot be written", target, ProblemKind.FILE):
            target.parent.mkdir(parents=True, exist_ok=True)
            save(target, recording.meta, recording.samples, recording.ended)
    return targets


def _recording(log: Log) -> Recording:
    stamps = log.columns["time"]
    log = repaired(log)
    time = _checked(log, stamps)
    names = [name for name in rollout.COLUMNS if name in log.columns]
    samples = np.empty(len(time), dtype=[(name, "<f8") for name in names])
    for name in names:
        samples[name] = log.columns.pop(name)  # a long log is in memory once
    first, duration, scales = float(time[0]), float(time[-1] - time[0]), log.scales
    samples["time"] -= first
    with log.path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    meta = {
        "name": log.path.stem,
        "trajectory": log.path.stem,
        "created": clock.strftime(STAMP),
        "axis": {name: getattr(scales, name) for name in ("kind", "travel_per_unit", "travel_unit", "encoder_step")},
        "dt": float(np.median(np.diff(time))),
        "nd": None,
        "nm": None,
        "steady": [0.0, duration],
        "duration": duration,
        "source": {"file": log.path.name, "sha256": digest, "first_time": first},
        "notes": [*log.notes, *without(names)],
        "versions": versions(),
        **log.about,
    }
    return Recording(log.path, meta, samples, True, f"imported from {log.path.name}", 0)


def _clocked(recording: Recording, setup: Setup | None) -> Recording:
    """The same; rows that a wrong unit of time would put on the stage's control periods are noted first."""
    dt = recording.meta["dt"]
    if setup is not None and (cause := by_rows(dt, setup.dt)):
        words = (
            f"doubtful: rows come every {duration(dt)}, and {setup.path} has a period of {duration(setup.dt)}: {cause}"
        )
        recording.meta["notes"].insert(0, words)
    return recording


def _checked(log: Log, stamps: Array) -> Array:
    """The log's time (s), once time and position are sound; `stamps` (s) are those of all rows of the file."""
    time = log.columns["time"]
    if len(time) < 2:
        reason = (
            f"{log.path} has {len(time)} row{'' if len(time) == 1 else 's'}; must have at least 2 to be a recording, "
            f"and {ROWS_TO_USE} to identify or diagnose from it: record it again, or check that it is the whole log"
        )
        raise RecordingError(reason, log.path, ProblemKind.SHAPE)
    for name in ("time", "measured"):
        if not np.all(finite := np.isfinite(log.columns[name])):
            row, own = int(np.argmin(finite)) + 1, log.labels.get(name, name)
            reason = f"{log.path} has no number in {own}, row {row}: give the column, or cut the log there"
            raise RecordingError(reason, log.path, ProblemKind.MISSING, column=own, row=row)
    if np.any(time[1:] <= time[:-1]):
        raise _out_of_order(log, time, stamps)
    return time


def _out_of_order(log: Log, time: Array, stamps: Array) -> RecordingError:
    """What to say of a `time` that does not increase, with its rows in the file."""
    at = int(np.argmax(time[1:] <= time[:-1])) + 1
    if time[at] == time[at - 1]:
        first, *_, last = (int(row) + 1 for row in np.flatnonzero(stamps == time[at]))
        count = np.count_nonzero(time[1:] == time[:-1])
        words = f"time {time[at]:.9g} s stands in rows {first} to {last} with different values"
        how_many = f"{count} of {len(time)} rows have the time of the row before"
        remedy = f"keep one row of each time, or log finer stamps; {how_many}"
    else:
        last = int(np.argmax(np.diff(stamps) < 0.0)) + 2
        words = f"time {time[at]:.9g} s in row {last} follows {time[at - 1]:.9g} s"
        remedy = "sort the log, or cut it there"
    reason = f"{log.path}: {words}; times must increase strictly: {remedy}"
    return RecordingError(reason, log.path, ProblemKind.CONFLICT, column=log.labels.get("time", "time"), row=last)


def captures(folder: Path, stated: Stated) -> list[SourceLog]:
    """The logs that captures.yaml lists; the nominal.yaml beside it gives their scales where no stage does.

    Raises RecordingError where an entry names no file.
    """
    beside = folder / "nominal.yaml"
    nominal = read_values(beside) if beside.is_file() else {}
    described = stated._replace(scales=scales_of_nominal(nominal, beside)) if nominal and not stated.setup else stated
    logs = []
    for path, entry in _entries(folder):
        about = {"capture": entry, "trajectory": str(entry.get("experiment", path.stem))}
        if nominal and path.parent == folder:  # read once for all of them
            logs.append(SourceLog(path, described, {**about, "nominal": nominal}))
        else:
            logs.append(SourceLog(path, stated, about))
    return logs


def _entries(folder: Path) -> list[tuple[Path, dict[str, Any]]]:
    """The entries of captures.yaml, and the file of each.  Raises RecordingError where one names none."""
    listed = folder / "captures.yaml"
    if not listed.is_file():
        reason = f"{folder} holds no captures.yaml, so it is no folder of captures: name the logs in it one by one"
        raise RecordingError(reason, folder, ProblemKind.MISSING)
    entries = read_values(listed).get("captures")
    if not isinstance(entries, list) or not entries:
        reason = f"{listed} must hold a list `captures:` with at least one entry"
        raise RecordingError(reason, listed, ProblemKind.SHAPE)
    for number, entry in enumerate(entries):
        if not isinstance(entry, dict) or not isinstance(entry.get("file"), str):
            reason = f"captures[{number}] needs `file:`, the name of its CSV ({listed})"
            raise RecordingError(reason, listed, ProblemKind.MISSING)
        if not (path := folder / entry["file"]).is_file():
            reason = f"captures[{number}].file = {entry['file']}; no such file in {folder}"
            raise RecordingError(reason, path, ProblemKind.FILE)
    return [(folder / entry["file"], entry) for entry in entries]


def _with_beside(log: Log, entry: Mapping[str, Any]) -> Log:
    """The log with the files that captures.yaml names: the current added to its command, its setpoints."""
    paths = {key: log.path.parent / str(entry[key]) for key in ("injection", "setpoints") if entry.get(key) is not None}
    for key, path in paths.items():
        if not path.is_file():
            reason = f"{log.path} has the {key} {entry[key]}; no such file in {log.path.parent}"
            raise RecordingError(reason, path, ProblemKind.FILE)
    columns, time = dict(log.columns), log.columns["time"]
    if "injection" in paths:
        columns["injection"] = capture_attachments.injection(paths["injection"], time)
    if "setpoints" in paths:  # they hold the injection, too, apart from what was learned
        columns |= capture_attachments.setpoints(paths["setpoints"], len(time), log.scales.kind)
    return log._replace(columns=columns)
