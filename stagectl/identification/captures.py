"""From recordings to captures that an identification can use: columns chosen, gaps split, doubts noted."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal
from stagectl.identification.capture_checks import remarks, suspicions
from stagectl.identification.resampling import Part, parts
from stagectl.identification.result import Note, Topic
from stagectl.recording.columns import WITHOUT
from stagectl.recording.hdf5 import Recording
from stagectl.recording.in_memory import given_twice
from stagectl.recording.opening import recordings_at
from stagectl.recording.scales import scales_of_stage

CURRENTS = ("measured_current", "current", "command")  # the best first: in the motor, after, before the limit
READ = ("time", "measured", "reference", "injection", *CURRENTS)  # ten minutes of all columns would be 200 MB
_SMOOTH = frozenset({"position", "reference"})
_STANDS_IN = {
    "command": "no measured current: the command is used instead, so a delay found here is that of command and drive",
    "current": "no measured current: the limited command is used instead, so a delay found here includes the drive's",
}


def opened(paths: Sequence[Path], setup: Setup, columns: Mapping[str, str] | None = None) -> list[Recording]:
    """All recordings of `paths`, including those that are held out; `columns` names the columns of logs."""
    return [
        recording.filled("identify from")
        for path in paths
        for recording in recordings_at(path, setup, columns, only=READ)
    ]


def held_out(recording: Recording) -> bool:
    """Whether a capture is reserved for validation."""
    return bool(recording.meta.get("capture", {}).get("use") == "held-out")


def prepared(
    recordings: Sequence[Recording], setup: Setup, current: str | None = None, doubtful: bool = False
) -> list[Capture]:
    """One capture for each part without gaps; `current` names the column that is used as the motor's current.

    What looks wrong is refused, or, with `doubtful`, noted.  Raises IdentificationError with file, reason and remedy
    where no capture remains, it is of another kind of axis, or a column is missing.
    """
    if not recordings:
        raise IdentificationError("no capture was given: record one, or give a log", Refusal.NO_CAPTURE)
    _each_once(recordings)
    used = [recording for recording in recordings if not held_out(recording)]
    if not used:
        raise IdentificationError(
            "every capture is marked `use: held-out`; give at least one to identify from", Refusal.HELD_OUT
        )
    captures = []
    for recording in used:
        try:
            captures += _captures(recording, setup, current, doubtful)
        except IdentificationError as error:
            raise error.within(recording.path) from error
    return captures


def _each_once(recordings: Sequence[Recording]) -> None:
    """Raise IdentificationError where a log is there twice: it would make every interval too narrow."""
    seen: dict[Path, list[Recording]] = {}
    for recording in recordings:
        others = seen.setdefault(recording.path.resolve(), [])
        # Two motions in memory may be planned for one path.
        if any(np.array_equal(recording.samples, other.samples) for other in others):
            name = recording.path.name
            raise IdentificationError(given_twice(name), Refusal.GIVEN_TWICE, capture=str(recording.path), value=name)
        others.append(recording)


def _captures(recording: Recording, setup: Setup, current: str | None, doubtful: bool) -> list[Capture]:
    kind = recording.meta["axis"]["kind"]
    if kind != setup.file.axis.kind:
        text = f"it is of a {kind} axis, {setup.file.name} is {setup.file.axis.kind}; give the stage it was recorded on"
        raise IdentificationError(text, Refusal.WRONG_AXIS, value=kind, admissible=setup.file.axis.kind)
    chosen = _current(recording, current)
    columns, notes = _aligned(recording, chosen)
    time = columns.pop("time")
    pieces, part_notes = _moved(*parts(time, columns, _SMOOTH), recording)
    without = tuple(WITHOUT.values())  # missing columns that an identification needs are reported by its own notes
    notes += [note for note in recording.meta.get("notes", []) if note not in without]
    stand_in: list[str] = []
    if chosen in _STANDS_IN and current is None:
        stand_in = [Note(Topic.STAND_IN, _STANDS_IN[chosen])]
    first, rest = [*notes, *part_notes, *stand_in], [*notes, *stand_in]  # the record's treatment is noted once
    return [
        _checked(_capture(recording, part, chosen, (number, len(pieces)), rest if number else first), setup, doubtful)
        for number, part in enumerate(pieces)
    ]


def _current(recording: Recording, wanted: str | None) -> str:
    names = recording.samples.dtype.names or ()
    there = [name for name in CURRENTS if name in names and np.any(np.isfinite(recording.samples[name]))]
    if wanted is not None and wanted not in there:
        text = f"it has no {wanted}; --current must be a column that it has: {', '.join(there) or 'none'}"
        raise IdentificationError(text, Refusal.MISSING_COLUMN, value=wanted, admissible=", ".join(there))
    if not there:
        text = (
            f"it holds neither a current nor a command, so no force; it has {', '.join(names)}: name the column with "
            "--columns current=NAME, or give it a header such as current_A, current_command_A or force_N"
        )
        raise IdentificationError(text, Refusal.MISSING_COLUMN, value=", ".join(names), admissible=", ".join(CURRENTS))
    return wanted or there[0]


def _aligned(recording: Recording, current: str) -> tuple[dict[str, Array], list[str]]:
    """Columns of the same instant in each row: a position that came nm periods late belongs nm rows earlier."""
    late = int(recording.meta.get("nm") or 0)
    names = recording.samples.dtype.names or ()
    taken = {"time": "time", "position": "measured", "current": current}
    for name, recorded in (("reference", "reference"), ("excitation", "injection")):
        if (
            recorded in names
            and np.any(recording.samples[recorded])
            and np.all(np.isfinite(recording.samples[recorded]))
        ):
            taken[name] = recorded
    columns = {  # rows are strided
        name: np.ascontiguousarray(recording.column(recorded)) for name, recorded in taken.items()
    }
    if not late:
        return columns, []
    rows = len(columns["time"]) - late
    shifted = {name: column[late:] if name == "position" else column[:rows] for name, column in columns.items()}
    text = f"positions are moved {late} periods ahead (nm), to the instants they were latched at"
    return shifted, [Note(Topic.DELAY, text)]


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
        encoder_step=_encoder_step(recording),
        unevenness=part.unevenness,
        meta={**meta, "excitation": _excitations(meta, part, length)} if "excitation" in meta else meta,
        notes=(*notes, part.note) if part.note else tuple(notes),
    )


def _moved(pieces: list[Part], notes: list[str], recording: Recording) -> tuple[list[Part], list[str]]:
    """The parts of a record in which the axis moves, and the notes; all of them where it never does."""
    least = thresholds.MOVED_STEPS * _encoder_step(recording)
    moved = [part for part in pieces if np.ptp(part.columns["position"]) > least]
    if not moved or len(moved) == len(pieces):
        return pieces, notes
    still = len(pieces) - len(moved)
    text = f"{still} of {len(pieces)} parts between gaps stand still and are left out"
    return moved, [*notes, Note(Topic.LEFT_OUT, text)]


def _encoder_step(recording: Recording) -> float:
    return float(recording.meta["axis"].get("encoder_step") or 0.0)


def _excitations(meta: Mapping[str, Any], part: Part, rows: int) -> list[dict[str, Any]]:
    """The steady spans of an excitation that lie wholly in the part, as only then their periods are whole."""
    shifted = [
        {**span, "start": span["start"] - part.start, "end": span["end"] - part.start} for span in meta["excitation"]
    ]
    end = part.dt * (rows + 0.5)
    return [span for span in shifted if span["start"] >= -0.5 * part.dt and span["end"] <= end]


def _checked(capture: Capture, setup: Setup, doubtful: bool) -> Capture:
    doubts = suspicions(capture, setup)
    if doubts and not doubtful:
        topics = ", ".join(doubt.topic for doubt in doubts)
        raise IdentificationError("; ".join(doubts), Refusal.IMPLAUSIBLE, capture=capture.name, value=topics)
    return capture._replace(notes=(*capture.notes, *doubts, *remarks(capture, scales_of_stage(setup))))
