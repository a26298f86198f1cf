"""Logs of other programs as recordings: the EMPS benchmark's MAT file, CSV files, folders of captures.

A recording from elsewhere has the columns that the log has, no others: what asks for one that is missing says so.
"""

from __future__ import annotations

import csv
import hashlib
import re
import time as clock
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow
import pyarrow.csv
from numpy.typing import NDArray
from scipy.io import loadmat

from stagectl.config.stage_file import Setup
from stagectl.kernels import rollout
from stagectl.recording.exports import header
from stagectl.recording.hdf5 import Recording, RecordingError, open_recording, quantities, save
from stagectl.recording.meta import versions
from stagectl.recording.nominal import Scales, read_values, scales_of_nominal, scales_of_stage
from stagectl.units import LINEAR, ROTARY, StageError, factor

Array = NDArray[np.float64]

# What a column's name means, without its unit, and the column of ours it becomes.
_LENGTHS = {"reference": "reference", "position": "measured"}
_CURRENTS = {
    **dict.fromkeys(("current_command", "force_command", "torque_command", "voltage_command"), "command"),
    **dict.fromkeys(("current", "force", "torque"), "measured_current"),
}
_HEADER = re.compile(rf"({'|'.join(['time', *_LENGTHS, *_CURRENTS])})_([A-Za-z]+)")
_WITHOUT = {
    "reference": "no reference: neither a tracking error nor a trajectory can be told from it",
    "command": "no command: what the controller asked for is not known",
    "measured_current": "no measured current: where a current is needed, the command stands in",
}
_EMPS = {"t": "time", "qg": "reference", "qm": "measured", "vir": "command"}
_EMPS_STEP = 5e-8  # m a count, of the motor's encoder seen at the load


class _Log(NamedTuple):
    """A log that has been read, in the units of the axis."""

    path: Path
    scales: Scales
    columns: dict[str, Array]
    notes: list[str]
    about: dict[str, Any]  # further entries of the recording's meta


def read(path: Path, setup: Setup | None = None) -> list[Recording]:
    """The recordings in a file or folder; `setup` is the stage it was recorded on, for its scales.

    Raises RecordingError, with file and row, where it cannot be understood.
    """
    if path.is_dir():
        return _folder(path, setup)
    if not path.is_file():
        raise RecordingError(f"{path}: no such file or folder")
    reader = {".csv": _csv, ".mat": _mat}.get(path.suffix.lower())
    if reader is None:
        raise RecordingError(
            f"{path} is of no kind that can be imported; these are .csv with a header of quantities and units "
            "(time_s,position_mm,...), the EMPS benchmark's .mat, and a folder with captures.yaml"
        )
    return [_recording(reader(path, setup, {}))]


def captures(path: Path, setup: Setup | None = None) -> list[Recording]:
    """Like `read`, and our own recordings as they are."""
    return [open_recording(path)] if path.suffix == ".h5" else read(path, setup)


def store(recordings: list[Recording], source: Path, output: Path | None) -> list[Path]:
    """Write imported recordings; those of a folder go into a folder."""
    base = output or Path("recordings") / (source.name if source.is_dir() else f"{source.stem}.h5")
    targets = [base / f"{one.path.stem}.h5" if source.is_dir() else base for one in recordings]
    if there := [target for target in targets if target.exists()]:
        raise RecordingError(f"{there[0]} exists and is left as it is: choose another place with -o")
    for recording, target in zip(recordings, targets, strict=True):
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            save(target, recording.meta, recording.samples, recording.ended)
        except OSError as error:
            raise RecordingError(f"{target} cannot be written: {error.strerror or error}") from error
    return targets


def _recording(log: _Log) -> Recording:
    time = _checked(log)
    names = [name for name in rollout.COLUMNS if name in log.columns]
    samples = np.empty(len(time), dtype=[(name, "<f8") for name in names])
    for name in names:
        samples[name] = log.columns[name]
    samples["time"] = time - time[0]
    missing = [words for name, words in _WITHOUT.items() if name not in names]
    duration, scales = float(time[-1] - time[0]), log.scales
    meta = {
        "name": log.path.stem,
        "trajectory": log.path.stem,
        "created": clock.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "axis": {name: getattr(scales, name) for name in ("kind", "travel_per_unit", "travel_unit", "encoder_step")},
        "dt": float(np.median(np.diff(time))),
        "nd": None,
        "nm": None,
        "steady": [0.0, duration],
        "duration": duration,
        "source": {"file": log.path.name, "sha256": hashlib.sha256(log.path.read_bytes()).hexdigest()},
        "notes": [*log.notes, *missing],
        "versions": versions(),
        **log.about,
    }
    return Recording(log.path, meta, samples, True, f"imported from {log.path.name}", 0)


def _checked(log: _Log) -> Array:
    """The log's time (s), once time and position are sound."""
    time = log.columns["time"]
    if len(time) < 2:
        raise RecordingError(f"{log.path} has {len(time)} rows; must have at least 2")
    for name in ("time", "measured"):
        if not np.all(finite := np.isfinite(log.columns[name])):
            raise RecordingError(f"{log.path} has no {name} in row {int(np.argmin(finite)) + 1}: cut the log there")
    if np.any(backwards := np.diff(time) <= 0.0):
        row = int(np.argmax(backwards)) + 1
        raise RecordingError(
            f"{log.path}: time {time[row]:.9g} s in row {row + 1} follows {time[row - 1]:.9g} s; times must increase "
            "strictly: remove repeated rows or sort the log"
        )
    return time


def _mat(path: Path, setup: Setup | None, _about: dict[str, Any]) -> _Log:
    """The benchmark's file: an amplifier of 1 A/V is taken, so that its volts are our amperes."""
    found = _mat_variables(path)
    if "t" not in found or "qm" not in found:
        raise RecordingError(
            f"{path} holds {', '.join(sorted(found)) or 'nothing'}; the EMPS layout is t, qg, qm, vir, gtau"
        )
    columns = {ours: found[name].ravel().astype(np.float64) for name, ours in _EMPS.items() if name in found}
    if len({len(column) for column in columns.values()}) > 1:
        raise RecordingError(f"{path}: t, qg, qm and vir differ in length")
    gain = float(found["gtau"].ravel()[0]) if "gtau" in found and found["gtau"].size else 0.0
    scales = scales_of_stage(setup, 1.0) if setup else Scales(LINEAR, 1.0, "m", _EMPS_STEP, gain, 1.0)
    notes = [
        f"EMPS layout: vir (V) is kept as the command in A of an amplifier of 1 A/V, so gtau = {gain:.6g} N/V is the "
        "force constant in N/A"
    ]
    return _Log(path, scales, columns, notes, {"name": "EMPS", "nominal": _emps_nominal(found, gain)})


def _mat_variables(path: Path) -> dict[str, NDArray[Any]]:
    try:
        content = loadmat(path)
    except NotImplementedError as error:
        raise RecordingError(f"{path} is a MATLAB 7.3 file; save it with -v7 and import that") from error
    except Exception as error:  # scipy raises many kinds on a file that is damaged
        raise RecordingError(f"{path} cannot be read as a MATLAB file: {error}") from error
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _emps_nominal(found: dict[str, NDArray[Any]], gain: float) -> dict[str, Any]:
    kp, kv = (float(found[name].ravel()[0]) if name in found else None for name in ("kp", "kv"))
    return {
        "stage": {
            "name": "EMPS",
            "kind": LINEAR,
            "position_unit": "m",
            "torque_unit": "N",
            "force_constant": gain or None,
            "travel_per_unit_mm": 1000.0,
            "encoder_step": _EMPS_STEP,
        },
        "drive": {"amplifier_A_per_V": 1.0, "current_limit_A": 10.0},
        "controller": {
            "Ts": 1e-3,
            "law": "command[k] = kv (kp (reference[k] - position[k]) - dq[k]); dq[k] = (qf[k] - qf[k-1]) / Ts; "
            "qf[k] = (position[k] + position[k-1]) / 2; limited to 10 V",
            "kp": kp,
            "kv": kv,
        },
    }


def _folder(folder: Path, setup: Setup | None) -> list[Recording]:
    entries = read_values(folder / "captures.yaml").get("captures")
    if not isinstance(entries, list) or not entries:
        raise RecordingError(f"{folder / 'captures.yaml'} must hold a list `captures:` with at least one entry")
    found = []
    for number, entry in enumerate(entries):
        if not isinstance(entry, dict) or not isinstance(entry.get("file"), str):
            raise RecordingError(f"captures[{number}] needs `file:`, the name of its CSV ({folder / 'captures.yaml'})")
        path = folder / entry["file"]
        if not path.is_file():
            raise RecordingError(f"captures[{number}].file = {entry['file']}; no such file in {folder}")
        about = {"capture": entry, "trajectory": str(entry.get("experiment", path.stem))}
        found.append(_recording(_csv(path, setup, about)))
    return found


def _csv(path: Path, setup: Setup | None, about: dict[str, Any]) -> _Log:
    beside = path.parent / "nominal.yaml"
    nominal = read_values(beside) if beside.is_file() else {}
    names = _names(path)
    scales = _scales(path, names, setup, (nominal, beside))
    known, notes = _known(path, names, scales)
    table = _table(path, names, list(known))
    columns = {ours: table[name] * scale for name, (ours, scale) in known.items()}
    if about.get("capture", {}).get("injection"):
        notes.append("its injection is left out: a recording has no column for it")
    return _Log(path, scales, columns, notes, {**about, **({"nominal": nominal} if nominal else {})})


def _names(path: Path) -> list[str]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return [name.strip() for name in next(csv.reader(file), [])]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path} is no CSV text: {error}") from error


def _scales(path: Path, names: list[str], setup: Setup | None, nominal: tuple[dict[str, Any], Path]) -> Scales:
    """From the stage file, else from nominal.yaml, else what the position's own unit tells."""
    values, beside = nominal
    told = scales_of_nominal(values, beside) if values else None
    if setup is not None:
        return scales_of_stage(setup, told.amplifier if told else 0.0)
    if told is not None:
        return told
    unit = next((name.rsplit("_", 1)[1] for name in names if name.startswith(("position_", "measured_"))), "")
    if unit in ("rad", "deg", "rev"):
        return Scales(ROTARY, travel_unit="rad")
    if unit in ("m", "mm", "um", "nm"):
        return Scales(LINEAR)
    raise RecordingError(
        f"{path}: {f'a position in {unit}' if unit else 'no column position_<unit>'} does not tell the axis; "
        "give --stage, or write nominal.yaml beside it"
    )


def _known(path: Path, names: list[str], scales: Scales) -> tuple[dict[str, tuple[str, float]], list[str]]:
    """Columns that are understood: (ours, factor); and a note for each that is left out."""
    own = {header(name, quantity.unit_for(scales.kind)): name for name, quantity in quantities().items()}
    exported = any(name.startswith("measured_") and name in own for name in names)  # our own export, all columns
    known: dict[str, tuple[str, float]] = {}
    notes = []
    for name in names:
        try:
            found = ((own[name], 1.0) if name in own else None) if exported else _meaning(name, scales)
        except StageError as error:
            if name.startswith(("time_", "position_")):
                raise RecordingError(f"{name} in {path}: {error}") from error
            notes.append(f"{name} is left out: {error}")
            continue
        if found is None:
            notes.append(
                f"{name or 'a column without a name'} is left out: it is no quantity with a unit that is known"
            )
        elif found[0] in [ours for ours, _ in known.values()]:
            raise RecordingError(f"{path} has two columns for {found[0]}, the second is {name}: remove one")
        else:
            known[name] = found
    absent = {"time", "measured"} - {ours for ours, _ in known.values()}
    if absent:
        raise RecordingError(f"{path} has the columns {', '.join(names)}; it must have time_s and a position_<unit>")
    return known, notes


def _meaning(name: str, scales: Scales) -> tuple[str, float] | None:
    match = _HEADER.fullmatch(name)
    if match is None:
        return None
    quantity, unit = match.groups()
    if quantity == "time":
        return "time", factor(unit, "s")
    if quantity in _LENGTHS:
        return _LENGTHS[quantity], scales.position(unit)
    return _CURRENTS[quantity], scales.current(unit)


def _table(path: Path, names: list[str], wanted: list[str]) -> dict[str, Array]:
    """The wanted columns, (n,) each; an empty cell is NaN."""
    reading = pyarrow.csv.ReadOptions(use_threads=False, column_names=names, skip_rows=1)
    converting = pyarrow.csv.ConvertOptions(
        column_types=dict.fromkeys(wanted, pyarrow.float64()), include_columns=wanted
    )
    try:
        table = pyarrow.csv.read_csv(path, read_options=reading, convert_options=converting)
    except (pyarrow.ArrowInvalid, pyarrow.ArrowKeyError, OSError) as error:
        raise RecordingError(f"{path}: {error}") from error
    return {name: np.array(table[name].to_numpy(), dtype=np.float64) for name in wanted}
