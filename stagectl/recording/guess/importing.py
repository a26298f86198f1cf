"""Any log as recordings: by its own words where it has them, else by a guess that is shown."""

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.problem import Problem, ProblemKind
from stagectl.recording import constants
from stagectl.recording.columns import MOTIONS, Stated, choices, scales_by_unit
from stagectl.recording.guess import units
from stagectl.recording.guess.guess import Guess, GuessedColumn, guess
from stagectl.recording.hdf5 import Recording, RecordingError
from stagectl.recording.imports import SourceLog, captures, is_text_log, read_log
from stagectl.recording.nominal_yaml import axis_values
from stagectl.recording.scales import Known, Scales, scales_of_stage
from stagectl.units import unit_on

_LOGS = (".csv", ".txt", ".mat")


class Imported(NamedTuple):
    """A recording, and the guess that it rests on; None where the log said what it holds."""

    recording: Recording
    guess: Guess | None


def import_log(
    path: Path,
    setup: Setup | None,
    words: Mapping[str, str] | None,
    known: Known,
    unsure: bool,
    scales: Scales | None = None,
) -> list[Imported]:
    """The recordings in a log, a folder of captures or a folder of logs; an `unsure` guess is taken only if told so.

    `scales` may stand in for the stage of `setup`.

    Raises RecordingError where it cannot be read, or where the guess is not sure.
    """
    stated = Stated(setup, words, scales, known)
    logs = _logs_in(path, stated) if path.is_dir() else [SourceLog(path, stated, {})]
    return [_imported(log, unsure) for log in logs]


def _logs_in(folder: Path, stated: Stated) -> list[SourceLog]:
    """Those that captures.yaml lists, else all that are there."""
    if (folder / "captures.yaml").is_file():
        return captures(folder, stated)
    logs = [SourceLog(file, stated, {}) for file in sorted(folder.iterdir()) if _is_log(file)]
    if not logs:
        kinds = f"recordings (.h5), nor captures.yaml, nor logs ({', '.join(_LOGS)})"
        reason = f"{folder} holds neither {kinds}; give a folder that does"
        raise RecordingError(reason, folder, ProblemKind.MISSING)
    return logs


def _imported(log: SourceLog, unsure: bool) -> Imported:
    try:
        return Imported(_with(read_log(log), log.stated.known), None)
    except RecordingError as error:
        unnamed = error.problems[0].kind in (ProblemKind.MISSING, ProblemKind.UNIT) and not error.row
        named = set(log.stated.columns or {})  # where that is all that a log must have, a refusal is about these words
        if not unnamed or ("time" in named and {"position", "velocity"} & named):
            raise
    return _guessed(log, unsure)


def _is_log(path: Path) -> bool:
    """Whether a file of a folder is a log: notes beside logs are text, too."""
    kind = path.suffix.lower()
    return kind in _LOGS and (kind == ".mat" or is_text_log(path))


def _with(recording: Recording, known: Known) -> Recording:
    """The recording with what the user says of its machine, as a nominal.yaml beside it would."""
    axis, nominal = recording.meta["axis"], recording.meta.get("nominal", {})
    step = axis["encoder_step"] if known.counts else None
    said = {"force_constant": known.force_constant or None, "encoder_step": step}
    if said := {key: value for key, value in said.items() if value is not None}:
        unit = unit_on(axis["kind"], "rad | m")
        stage = nominal.get("stage") or {"name": recording.path.stem, "kind": axis["kind"], "position_unit": unit}
        recording.meta["nominal"] = {**nominal, "stage": {**stage, **said}}
    return recording


def _guessed(log: SourceLog, unsure: bool) -> Imported:
    path, stated = log.path, log.stated
    setup, words, known = stated.setup, stated.columns or {}, stated.known
    fixed = scales_of_stage(setup) if setup is not None else stated.scales
    taken = guess(path, known.of_stage(setup) if setup else known, words)
    scales, notes = (fixed, ()) if fixed else (_of_kind(taken.scales, words, path), taken.notes)
    unnamed = tuple(_beside(part, words) for part in taken.columns if part.quantity not in words)
    taken = Guess(unnamed, scales, notes)
    _check_known(path, taken, fixed)
    if taken.columns and taken.sure < constants.LEAST_SURE and not unsure:
        raise _not_sure(path, taken, path.parent if log.about else path)
    recording = read_log(log._replace(stated=Stated(setup, {**taken.words, **words}, taken.scales)))
    recording.meta["notes"] = [*map(line, taken.columns), *taken.notes, *recording.meta["notes"]]
    constant = {"force_constant": taken.scales.force_constant} if taken.scales.force_constant else {}
    stage = {"name": path.stem, **axis_values(recording.meta["axis"]), **constant}
    recording.meta.setdefault("nominal", {"stage": stage})  # inertia and controller are for the user to add
    return Imported(recording, taken)


def _beside(part: GuessedColumn, words: Mapping[str, str]) -> GuessedColumn:
    """A guessed column beside those that the user names: a reference is in the unit of a named position."""
    unit = next((choice.unit for choice in choices(words) if choice.quantity == "position"), "")
    if part.quantity != "reference" or not unit:
        return part
    why = f"{part.why.partition(';')[0]}; it is in the unit of the position"
    return part._replace(unit=unit, sure=max(part.sure, constants.SURE_BY_MAGNITUDE), why=why)


def _check_known(path: Path, taken: Guess, stated: Scales | None) -> None:
    """Raise RecordingError where a motion's header names a unit that is none: its size would be a guess."""
    for part in taken.columns:
        if part.quantity in MOTIONS and part.stranger:
            known = stated.units(part.quantity) if stated else units.known(part.quantity)
            reason = f"the header of column {part.column} says so, and this unit is not known"
            where = f"--columns {part.quantity}={part.column}:UNIT"
            remedy = f"convert the column to one of these, and name that in the header or as {where}"
            key = f"{path}: {part.quantity}"
            problem = Problem(reason, ProblemKind.UNIT, key, part.stranger, choices=known, remedy=remedy, file=path)
            raise RecordingError(problem, column=part.column)


def _of_kind(scales: Scales, words: Mapping[str, str], path: Path) -> Scales:
    """The guessed scales, on the kind of axis that the unit of a named position or velocity tells."""
    named = [choice.unit for choice in choices(words) if choice.quantity in ("position", "velocity")]
    with contextlib.suppress(RecordingError):  # a unit such as counts tells nothing
        known = scales_by_unit(named, path)
        return scales._replace(kind=known.kind, travel_unit=known.travel_unit)
    return scales


def line(part: GuessedColumn) -> str:
    """One guessed column in words."""
    return f"{part.quantity} is taken from {part.column} in {part.unit}, {100.0 * part.sure:.0f} % sure: {part.why}"


def _not_sure(path: Path, taken: Guess, source: Path) -> RecordingError:
    """What to say of a guess about a log, alone or of a folder `source` of captures."""
    said = ",".join(f"{quantity}={where}" for quantity, where in taken.words.items())
    least = min(taken.columns, key=lambda part: part.sure)
    lines = "\n  ".join([*map(line, taken.columns), *taken.notes])
    reason = (
        f"{path} does not say what its columns are: its {line(least)}. Less than "
        f"{100.0 * constants.LEAST_SURE:.0f} % sure is not taken unasked: name it with --columns {said!r}, or take it "
        f"with `stagectl import {source} --yes`, which also takes --counts and --force-constant. "
        f"All that is guessed:\n  {lines}"
    )
    return RecordingError(reason, path, ProblemKind.VALUE, column=least.quantity)
