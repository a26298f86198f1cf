"""From recordings to captures that an identification can use: columns chosen, gaps split, suspicions said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.capture_checks import remarks, suspicions
from stagectl.identification.sampling import Part, parts
from stagectl.recording.columns import WITHOUT
from stagectl.recording.hdf5 import Recording, open_recording

CURRENTS = ("measured_current", "current", "command")  # the best that there is: in the motor, after, before the limit
READ = ("time", "measured", "reference", "injection", *CURRENTS)  # ten minutes of all columns would be 200 MB
_SMOOTH = frozenset({"position", "reference"})
_STANDS_IN = {
    "command": "no measured current: the command stands in for it, so a delay found here is that of command and drive",
    "current": "no measured current: the limited command stands in for it, so a delay found here is the drive's, too",
}


def load(
    paths: Sequence[Path],
    setup: Setup,
    current: str | None = None,
    columns: Mapping[str, str] | None = None,
    doubtful: bool = False,
) -> list[Capture]:
    """Captures from recordings, logs and folders; those marked held-out are left alone.  See `prepared`."""
    return prepared(opened(paths, setup, columns), setup, current, doubtful)


def opened(paths: Sequence[Path], setup: Setup, columns: Mapping[str, str] | None = None) -> list[Recording]:
    """All recordings of `paths`, those that are held out too; `columns` names those of logs."""
    found: list[Recording] = []
    for path in paths:
        if path.suffix != ".h5":
            from stagectl.recording.imports import read  # with pyarrow, 60 MB that our own recordings need not

        found += [open_recording(path, READ)] if path.suffix == ".h5" else read(path, setup, columns)
    return found


def held_out(recording: Recording) -> bool:
    """Whether a capture is kept back for judging what was found."""
    return bool(recording.meta.get("capture", {}).get("use") == "held-out")


def prepared(
    recordings: Sequence[Recording], setup: Setup, current: str | None = None, doubtful: bool = False
) -> list[Capture]:
    """One capture for each part without gaps; `current` names the column that stands for the motor's current.

    What looks wrong is refused, or, with `doubtful`, noted.  Raises IdentificationError with file, reason and what
    to do where nothing is left, the axis is another one, or a column is missing.
    """
    used = [one for one in recordings if not held_out(one)]
    if not used:
        raise IdentificationError("every capture is marked `use: held-out`; give at least one to identify from")
    found = []
    for recording in used:
        try:
            found += _captures(recording, setup, current, doubtful)
        except IdentificationError as error:
            raise IdentificationError(f"{recording.path}: {error}") from error
    return found


def _captures(recording: Recording, setup: Setup, current: str | None, doubtful: bool) -> list[Capture]:
    kind = recording.meta["axis"]["kind"]
    if kind != setup.file.axis.kind:
        raise IdentificationError(
            f"it is of a {kind} axis, {setup.file.name} is {setup.file.axis.kind}; give the stage it was recorded on"
        )
    chosen = _current(recording, current)
    columns, notes = _aligned(recording, chosen)
    time = columns.pop("time")
    pieces, said = parts(time, columns, _SMOOTH)
    absent = tuple(WITHOUT.values())  # what is missing of what an identification needs is said otherwise
    notes += [note for note in recording.meta.get("notes", []) if note not in absent]
    stand_in = [_STANDS_IN[chosen]] if chosen in _STANDS_IN and current is None else []
    whole, rest = [*notes, *said, *stand_in], [*notes, *stand_in]  # the first part says what was done to the record
    return [
        _judged(_capture(recording, part, chosen, (number, len(pieces)), rest if number else whole), setup, doubtful)
        for number, part in enumerate(pieces)
    ]


def _current(recording: Recording, wanted: str | None) -> str:
    names = recording.samples.dtype.names or ()
    there = [name for name in CURRENTS if name in names and np.any(np.isfinite(recording.samples[name]))]
    if wanted is not None and wanted not in there:
        raise IdentificationError(
            f"it has no {wanted}; --current must be a column that it has: {', '.join(there) or 'none'}"
        )
    if not there:
        raise IdentificationError(
            f"it holds neither a current nor a command, so no force; it has {', '.join(names)}: name the column with "
            "--columns current=NAME, or give it a header such as current_A, current_command_A or force_N"
        )
    return wanted or there[0]


def _aligned(recording: Recording, current: str) -> tuple[dict[str, Array], list[str]]:
    """Columns of one instant a row: a position that came nm periods late belongs nm rows before."""
    late = int(recording.meta.get("nm") or 0)
    names = recording.samples.dtype.names or ()
    taken = {"time": "time", "position": "measured", "current": current}
    for name, ours in (("reference", "reference"), ("excitation", "injection")):
        if ours in names and np.any(recording.samples[ours]) and np.all(np.isfinite(recording.samples[ours])):
            taken[name] = ours
    columns = {name: np.ascontiguousarray(recording.column(ours)) for name, ours in taken.items()}  # rows are strided
    if not late:
        return columns, []
    rows = len(columns["time"]) - late
    shifted = {name: column[late:] if name == "position" else column[:rows] for name, column in columns.items()}
    return shifted, [f"positions are moved {late} periods ahead (nm), to the instants they were latched at"]


def _capture(recording: Recording, part: Part, current: str, number: tuple[int, int], notes: Sequence[str]) -> Capture:
    meta = recording.meta
    length = len(part.columns["position"])
    name = str(recording.path)
    return Capture(
        name=name if number[1] == 1 else f"{name} (part {number[0] + 1} of {number[1]}, from {part.start:.6g} s)",
        time=part.dt * np.arange(length, dtype=np.float64),
        position=part.columns["position"],
        current=part.columns["current"],
        dt=part.dt,
        current_column=current,
        excitation=part.columns.get("excitation"),
        reference=part.columns.get("reference"),
        encoder_step=float(meta["axis"].get("encoder_step") or 0.0),
        steady=_span(meta.get("steady"), part, length),
        meta={**meta, "excitation": _excitations(meta, part, length)} if "excitation" in meta else meta,
        notes=(*notes, part.note) if part.note else tuple(notes),
    )


def _span(span: Sequence[float] | None, part: Part, rows: int) -> tuple[float, float] | None:
    """What of a window (s, of the record) lies in the part, in its own time; None where nothing does."""
    if span is None:
        return None
    begin, end = max(span[0] - part.start, 0.0), min(span[1] - part.start, part.dt * rows)
    return (begin, end) if end > begin else None


def _excitations(meta: Mapping[str, Any], part: Part, rows: int) -> list[dict[str, Any]]:
    """The steady spans of an excitation that lie wholly in the part; their periods are whole only then."""
    shifted = [
        {**one, "start": one["start"] - part.start, "end": one["end"] - part.start} for one in meta["excitation"]
    ]
    end = part.dt * (rows + 0.5)
    return [one for one in shifted if one["start"] >= -0.5 * part.dt and one["end"] <= end]


def _judged(capture: Capture, setup: Setup, doubtful: bool) -> Capture:
    found = suspicions(capture, setup)
    if found and not doubtful:
        raise IdentificationError("; ".join(found))
    return capture._replace(notes=(*capture.notes, *found, *remarks(capture)))
