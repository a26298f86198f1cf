"""CSV files as logs: a header of quantities and units, our own exports, or columns that the user names."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.csv

from stagectl.config.stage_file import Setup
from stagectl.recording.columns import (
    EXAMPLE,
    Array,
    Choice,
    Log,
    axis_of,
    choices,
    meaning,
    of_choices,
    parsed,
    told_scales,
)
from stagectl.recording.exports import header
from stagectl.recording.hdf5 import RecordingError, quantities
from stagectl.recording.nominal import Scales, read_values, scales_of_nominal, scales_of_stage
from stagectl.units import StageError


def read(path: Path, setup: Setup | None, about: dict[str, Any], words: Mapping[str, str] | None = None) -> Log:
    """The log in a CSV file; `words` name its columns where the header does not.

    Raises RecordingError, with file and row, where it cannot be understood.
    """
    names = _names(path)
    if words:
        return _chosen(path, names, setup, choices(words))
    if names and all(map(_number, names)):
        raise RecordingError(
            f"{path} has no header, its first row is numbers; say which of its {len(names)} columns is which, counting "
            f"from 1: {EXAMPLE}"
        )
    beside = path.parent / "nominal.yaml"
    nominal = read_values(beside) if beside.is_file() else {}
    scales = _scales(path, names, setup, (nominal, beside))
    known, notes = _known(path, names, scales)
    table = _table(path, names, list(known), 1)
    columns = {ours: table[name] * scale for name, (ours, scale) in known.items()}
    if about.get("capture", {}).get("injection"):
        notes.append("its injection is left out: a recording has no column for it")
    return Log(path, scales, columns, notes, {**about, **({"nominal": nominal} if nominal else {})})


def _chosen(path: Path, names: list[str], setup: Setup | None, chosen: list[Choice]) -> Log:
    headed = not all(map(_number, names))
    scales = axis_of(chosen, setup, path)
    found = {
        ours: (_column(path, names if headed else [], len(names), choice), scale)
        for ours, (choice, scale) in of_choices(chosen, scales, path).items()
    }
    labels = [f"column {number}" for number in range(1, len(names) + 1)]
    table = _table(path, labels, [labels[at] for at, _ in found.values()], 1 if headed else 0)
    columns = {ours: table[labels[at]] * scale for ours, (at, scale) in found.items()}
    return Log(path, scales, columns, [], {})


def _column(path: Path, names: list[str], count: int, choice: Choice) -> int:
    """The index of a column, from its name or its number."""
    if choice.name in names:
        return names.index(choice.name)
    if not choice.name.isdecimal():
        there = (
            f"its columns are {', '.join(names)}" if names else f"it has no header, so give a number from 1 to {count}"
        )
        raise RecordingError(f"{path} has no column {choice.name} for the {choice.quantity}: {there}")
    if not 1 <= int(choice.name) <= count:
        raise RecordingError(f"column {choice.name} of {path}; must be 1 to {count}, the first is 1")
    return int(choice.name) - 1


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


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
    return told_scales((name.rsplit("_", 1)[1] for name in names if name.startswith(("position_", "measured_"))), path)


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
        raise RecordingError(
            f"{path} has the columns {', '.join(names)}; it must have time_s and a position_<unit>, or say which are "
            "they: --columns time=NAME,position=NAME:mm"
        )
    return known, notes


def _meaning(name: str, scales: Scales) -> tuple[str, float] | None:
    told = parsed(name)
    return meaning(*told, scales) if told and told[1] else None


def _table(path: Path, names: list[str], wanted: list[str], skipped: int) -> dict[str, Array]:
    """The wanted columns, (n,) each; an empty cell is NaN."""
    reading = pyarrow.csv.ReadOptions(use_threads=False, column_names=names, skip_rows=skipped)
    converting = pyarrow.csv.ConvertOptions(
        column_types=dict.fromkeys(wanted, pyarrow.float64()), include_columns=list(dict.fromkeys(wanted))
    )
    try:
        table = pyarrow.csv.read_csv(path, read_options=reading, convert_options=converting)
    except (pyarrow.ArrowInvalid, pyarrow.ArrowKeyError, OSError) as error:
        raise RecordingError(f"{path}: {error}") from error
    return {name: np.array(table[name].to_numpy(), dtype=np.float64) for name in wanted}
