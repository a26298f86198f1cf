"""Recordings for other programs: CSV, Parquet, MAT, MCAP, a trajectory, or a folder of captures.

Every number keeps all its digits.  Units are in the CSV's header (``reference_rad``), in the Parquet fields'
metadata, and next to the samples in the MAT file.
"""

import json
import re
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from stagectl.extras import arrow
from stagectl.kernels.law import Setpoint
from stagectl.problem import Problem, ProblemKind
from stagectl.recording import export_targets, mcap_log
from stagectl.recording.constants import AT_REST, RUN
from stagectl.recording.hdf5 import Recording, RecordingError, quantities
from stagectl.recording.in_memory import header, units_of
from stagectl.recording.metadata import made_at
from stagectl.recording.nominal_yaml import difference, nominal_of
from stagectl.replacing import check_replaceable, replaced, write_text
from stagectl.trajectories import Recorded

# Columns of a capture folder and ours that they show; the header appends the unit.
CAPTURE = {
    "time": "time",
    "reference": "reference",
    "position": "measured",
    "current_command": "command",
    "current": "measured_current",
}


class Exported(NamedTuple):
    """What was written, and what must be said of it."""

    path: Path
    notes: list[str]


def export(recordings: list[Recording], to: str, path: Path | None) -> list[Exported]:
    """Write `recordings` in the format `to` of FORMATS, each next to its recording where no `path` is given.

    A folder takes all of them together.  Raises RecordingError where the recordings do not fit the format, StageError
    where a file is there that is no export of that format, or that only the recording's name leads to.
    """
    if to not in FORMATS:
        raise RecordingError(Problem("", ProblemKind.VALUE, "format", to, choices=FORMATS))
    for recording in recordings:
        recording.filled("export")
    if to == FOLDER:
        return [write_folder(recordings, path)]
    found = export_targets.targets(recordings, to, path)
    return [_write(to, recording, target) for recording, target in zip(recordings, found, strict=True)]


def _write(to: str, recording: Recording, path: Path) -> Exported:
    if path.resolve() == recording.path.resolve():
        raise RecordingError(f"{path} is the recording itself: choose another file with -o", path, ProblemKind.CONFLICT)
    with RecordingError.instead_of((OSError,), f"{path} cannot be written", path, ProblemKind.FILE):
        path.parent.mkdir(parents=True, exist_ok=True)
        notes = WRITERS[to](recording, path) or []
    return Exported(path, [*notes, *_losses(recording)])


def _losses(recording: Recording) -> list[str]:
    lost = [f"{recording.lost_rows} rows were lost while it was recorded"] if recording.lost_rows else []
    return lost + ([] if recording.complete else [f"not complete: {recording.ended}"])


def units(recording: Recording) -> dict[str, str]:
    """SI unit of every column on this axis."""
    return units_of(recording.samples.dtype.names or (), recording.meta["axis"]["kind"])


def write_columns(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """A CSV file with these columns; each number in the fewest digits that give the same bits again."""
    table = arrow().table({name: np.ascontiguousarray(values) for name, values in columns.items()})
    with replaced(path) as fresh, fresh.open("wb") as file:
        file.write((",".join(columns) + "\n").encode())
        arrow().csv.write_csv(table, file, arrow().csv.WriteOptions(include_header=False))


def write_csv(recording: Recording, path: Path) -> None:
    """All columns as CSV."""
    write_columns(path, {header(name, unit): recording.column(name) for name, unit in units(recording).items()})


def write_parquet(recording: Recording, path: Path) -> None:
    """All columns as Parquet; unit and meaning in each field's metadata, the recording's own under ``stagectl``."""
    known, unit_by_name = quantities(), units(recording)
    fields = [
        arrow().field(name, arrow().float64(), metadata={"unit": unit, "meaning": known[name].meaning})
        for name, unit in unit_by_name.items()
    ]
    schema = arrow().schema(fields, metadata={"stagectl": json.dumps(recording.meta)})
    table = arrow().table([recording.column(name) for name in unit_by_name], schema=schema)
    with replaced(path) as fresh:
        arrow().parquet.write_table(table, fresh)


def write_mat(recording: Recording, path: Path) -> None:
    """A MATLAB file: struct ``samples`` of columns, struct ``units`` with the same names, ``meta`` as JSON."""
    from scipy.io import savemat

    unit_by_name = units(recording)
    content = {
        "samples": {name: recording.column(name) for name in unit_by_name},
        "units": unit_by_name,
        "meta": json.dumps(recording.meta),
    }
    with replaced(path) as fresh:
        savemat(str(fresh), content, appendmat=False, oned_as="column")


def write_mcap(recording: Recording, path: Path) -> None:
    """All columns as MCAP, for Foxglove and PlotJuggler."""
    mcap_log.write(recording, path, described(units(recording)))


def described(unit_by_name: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Of each column, by name and unit: its name with the unit, and what it means."""
    known = quantities()
    return {name: (header(name, unit), known[name].meaning) for name, unit in unit_by_name.items()}


def write_trajectory(recording: Recording, path: Path) -> list[str]:
    """The reference as a trajectory file of ``type: csv``, its samples in a CSV next to it."""
    time, reference = recording.column("time"), recording.column("reference")
    curve = Recorded(time, reference)
    fastest = AT_REST * float(np.abs(np.gradient(reference, time)).max(initial=0.0))
    ends = {"run_up": abs(curve.initial_velocity) > fastest, "run_out": abs(curve.final_velocity) > fastest}
    table, unit = path.with_name(f"{path.stem}-samples.csv"), units(recording)
    check_replaceable(table, f"time_s,{header('reference', unit['reference'])}\n" if path.is_file() else "")
    write_columns(table, {header(name, unit[name]): recording.column(name) for name in ("time", "reference")})
    lines = [f"# The reference of {recording.path.name} ({recording.meta['name']}).", "type: csv"]
    lines += [f"file: {json.dumps(table.name)}"]
    lines += [f"{name}: {RUN:g} s   # the record is in motion here" for name, moving in ends.items() if moving]
    write_text(path, "\n".join(lines) + "\n")
    added = " and ".join(name for name, moving in ends.items() if moving)
    return [f"the record is in motion at its ends: {added} of {RUN:g} s added around it"] if added else []


WRITERS: dict[str, Callable[[Recording, Path], list[str] | None]] = {  # what must be said of it, if anything
    "csv": write_csv,
    "parquet": write_parquet,
    "mat": write_mat,
    "mcap": write_mcap,
    "trajectory": write_trajectory,
}
FOLDER = "folder"
FORMATS = (*WRITERS, FOLDER)


def write_folder(recordings: list[Recording], path: Path | None) -> Exported:
    """A folder of captures: captures.yaml, nominal.yaml and one CSV a recording; next to the first without a `path`.

    Raises RecordingError where the recordings are not of one stage and one controller, StageError where the folder
    holds such files that stagectl has not written.
    """
    folder, entries = path or recordings[0].path.with_suffix(""), _captures(recordings)
    export_targets.check_folder(folder, [entry["file"] for entry in entries], path is not None)
    nominal = nominal_of(recordings[0])
    for other in recordings[1:]:
        if differs := difference(nominal, nominal_of(other)):
            reason = (
                f"{other.path} differs from {recordings[0].path} in {differs}; the captures of a folder share "
                "one nominal.yaml: export them to folders of their own"
            )
            raise RecordingError(reason, other.path, ProblemKind.CONFLICT, column=differs.split(" ")[0])
    captures, notes = [], []
    with RecordingError.instead_of((OSError,), f"{folder} cannot be written", folder, ProblemKind.FILE):
        folder.mkdir(parents=True, exist_ok=True)
        for capture, recording in zip(entries, recordings, strict=True):
            notes += [f"{capture['file']}: {note}" for note in _write_capture(recording, folder / capture["file"])]
            captures.append({**capture, **_beside(recording, folder / capture["file"])})
        _dump(folder / export_targets.CAPTURES, {"captures": captures})
        _dump(folder / export_targets.NOMINAL, nominal)
    return Exported(folder, notes)


def _beside(recording: Recording, path: Path) -> dict[str, Any]:
    """Keys of captures.yaml for what its CSV has no column for; the added current goes into a separate CSV."""
    names, rows = recording.samples.dtype.names or (), _kept(recording)
    keys: dict[str, Any] = {}
    added = sum((recording.column(name)[rows] for name in ("learned", "injection") if name in names), np.zeros(1))
    if np.any(added):
        table = export_targets.beside(path, "injection")
        write_columns(table, {"time_s": recording.column("time")[rows], "injection_A": added})
        keys["injection"] = table.name
    if set(Setpoint._fields) <= set(names):
        table, unit = export_targets.beside(path, "setpoints"), units(recording)
        write_columns(table, {header(name, unit[name]): recording.column(name)[rows] for name in Setpoint._fields})
        keys["setpoints"] = table.name
    return keys


def _kept(recording: Recording) -> slice:
    """The rows that a folder takes: not those at the end whose feedforward depends on a reference beyond it.

    A motion that was cut short has such rows, and a recording of a service.
    """
    meta, time = recording.meta, recording.column("time")
    whole = "law" not in meta or ("trajectory" in meta["files"] and time[-1] >= meta["duration"])
    return slice(None, None if whole else -min(meta["nd"] + 4, len(time) - 1) or None)


def _write_capture(recording: Recording, path: Path) -> list[str]:
    unit, columns, notes = units(recording), {}, _losses(recording)
    rows = _kept(recording)
    if rows.stop:
        notes.append(f"its last {-rows.stop} rows are left out: what they looked ahead to is not in the recording")
    for name, ours in CAPTURE.items():
        if ours in unit and not np.all(np.isnan(recording.column(ours))):
            columns[header(name, unit[ours])] = recording.column(ours)[rows]
        else:
            notes.append(f"there is no {name}")
    write_columns(path, columns)
    return notes


def _captures(recordings: list[Recording]) -> list[dict[str, Any]]:
    """Entries of captures.yaml; the session's clock starts with the first recording."""
    repeats: Counter[str] = Counter()
    entries = []
    for recording in recordings:
        known: dict[str, Any] = dict(recording.meta.get("capture", {}))
        name = re.sub(r"[^\w.+-]", "_", str(known.get("experiment", recording.meta["trajectory"])))  # of a file, too
        repeats[name] += 1
        entry = {"file": f"{name}-{repeats[name]}.csv", "experiment": name, "repeat": repeats[name], "use": "diagnose"}
        if "law" in recording.meta:  # the date of an import is not that of its capture
            entry["start_s"] = made_at(recording.meta) - min(made_at(each.meta) for each in recordings)
        entry.update({key: known[key] for key in ("repeat", "use", "start_s") if key in known})
        entries.append(entry)
    return entries


def _dump(path: Path, values: Any) -> None:
    text = yaml.safe_dump(values, sort_keys=False, width=120, allow_unicode=True, default_flow_style=None)
    write_text(path, f"{export_targets.WRITTEN}\n{text}")
