"""Which column of a log is which of ours: by its name with a unit, or by ``--columns``."""

import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.named_values import pairs
from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import RecordingError
from stagectl.recording.scales import NOTHING_KNOWN, Known, Scales, bases_of, is_unit, scales_of_stage
from stagectl.units import LINEAR, ROTARY, StageError, factor, unit_on

Array = NDArray[np.float64]

# What a quantity of a log becomes; the first three are lengths and times, the rest currents or what drives them.
POSITIONS = ("position", "measured", "motor_position", "load_position")  # the motor's before the load's
_LENGTHS = {"reference": "reference", **dict.fromkeys(POSITIONS, "measured")}
_CURRENTS = {
    **dict.fromkeys(("current_command", "force_command", "torque_command", "voltage_command", "command"), "command"),
    **dict.fromkeys(("current", "force", "torque", "measured_current"), "measured_current"),
    "injection": "injection",
}
MOTIONS = ("position", "velocity", "reference")  # in units that nobody guesses
QUANTITIES = ("time", *_LENGTHS, *_CURRENTS)
CHOICES = ("time", "position", "velocity", "current", "command", "reference", "injection")
_HEADER = re.compile(rf"({'|'.join(sorted(QUANTITIES, key=len, reverse=True))})(?:_([A-Za-zµμ°%‰][A-Za-zµμ .*·]*))?")
_BRACKETS = re.compile(r"\s*[\[(]\s*([^\])]*?)\s*[\])]$")
_CHOICE = re.compile(r"\s*(\w+)\s*=\s*([^:]+?)\s*(?:\[\s*([0-9]{1,4})\s*\])?\s*(?::\s*(.*?)\s*)?")
EXAMPLE = "--columns time=1,position=2:mm,current=3"
NO_TIME = "; if the log holds none, add a column of it: the number of the row times the time from row to row"
# Notes of a recording about columns that its log does not have.
WITHOUT = {
    "reference": "no reference: it has neither a tracking error nor a trajectory",
    "command": "no command: the output of the controller is not known",
    "measured_current": "no measured current: the command is used in its place",
    "force": "no command and no measured current: no force is known",  # in the place of the two before
}


def without(names: Collection[str]) -> list[str]:
    """What to say of the columns that a log with these `names` lacks."""
    forceless = {"command", "measured_current"}.isdisjoint(names)
    lacking = {"reference", *({"force"} if forceless else {"command", "measured_current"})} - set(names)
    return [words for name, words in WITHOUT.items() if name in lacking]


class Log(NamedTuple):
    """A log that has been read, in the units of the axis."""

    path: Path
    scales: Scales
    columns: dict[str, Array]
    notes: list[str]
    about: dict[str, Any]  # further entries of the recording's meta
    labels: Mapping[str, str] = MappingProxyType({})  # our columns by the log's own names


class Stated(NamedTuple):
    """What the user says of a log."""

    setup: Setup | None = None  # the stage that it was recorded on
    columns: Mapping[str, str] | None = None  # which column or variable is which: ``{"position": "qm:mm"}``
    scales: Scales | None = None  # in the place of a stage
    known: Known = NOTHING_KNOWN  # where there is no stage

    @property
    def taken(self) -> Scales | None:
        """The scales that are stated; None where the log itself must show them."""
        return self.scales or (scales_of_stage(self.setup) if self.setup else None)


class Choice(NamedTuple):
    """A column of a log, as the user names it."""

    quantity: str
    name: str  # in the log: a header, a variable, or the number of a column, from 1
    number: int  # of the column within a matrix, from 1; 0: it is a vector
    unit: str  # empty: that of its name, else s or A; a motion must have one
    sign: float = 1.0  # -1: the column is turned

    @property
    def place(self) -> str:
        """The column in its log: in a table this is its header, brackets and all."""
        return f"{self.name}[{self.number}]" if self.number else self.name

    @property
    def written(self) -> str:
        """The column as ``--columns`` has it, without its unit."""
        return f"{'-' if self.sign < 0.0 else ''}{self.place}"

    @property
    def said(self) -> str:
        """The unit as chosen, else as its name says; empty where neither does."""
        return self.unit or header_unit(self.name.rsplit(".", 1)[-1])


def choices(words: Mapping[str, str] | None) -> list[Choice]:
    """``{"position": "qm:mm"}``: the quantities and where they are; a matrix's column is ``"data[2]"``.

    Raises RecordingError where it cannot be understood.
    """
    columns = []
    for quantity, where in (words or {}).items():
        match = _CHOICE.fullmatch(f"{quantity}={where}")
        if match is None or quantity not in CHOICES:
            reason = (
                f"--columns {quantity}={where}; must be QUANTITY=COLUMN or QUANTITY=COLUMN:UNIT with a quantity of "
                f"{', '.join(CHOICES)}, such as {EXAMPLE}"
            )
            raise RecordingError(reason, kind=ProblemKind.SYNTAX, column=quantity)
        name = match[2].removeprefix("-")
        sign = -1.0 if name != match[2] else 1.0
        columns.append(Choice(match[1], name, int(match[3] or 0), match[4] or "", sign))
    return columns


def split(text: str) -> dict[str, str]:
    """The words of ``--columns``: ``"time=t,position=qm:mm"``.

    Raises StageError where an entry is not ``quantity=column``, or is written twice.
    """
    return pairs("--columns", text, "QUANTITY=COLUMN", EXAMPLE)


def check_kind(path: Path, column: str, kind: str, taken: Scales | None) -> None:
    """Raise RecordingError where the log says by a `column` that its axis is of another kind than the one `taken`."""
    if taken is not None and taken.kind != kind:
        reason = (
            f"{path} has {column}, so its axis is {kind}, and the stage's is {taken.kind}: give the stage of the log"
        )
        raise RecordingError(reason, path, ProblemKind.CONFLICT, column=column)


def check_once(path: Path, places: Mapping[str, tuple[object, str]]) -> None:
    """Raise RecordingError where two quantities are at one place of the log; `places` hold it and its name."""
    taken: dict[object, str] = {}
    for quantity, (place, name) in places.items():
        if place in taken:
            reason = (
                f"--columns {taken[place]} and {quantity} are both {name} of {path}; each must have a column of its "
                "own: leave one out, or choose another for it"
            )
            raise RecordingError(reason, path, ProblemKind.REPEATED, column=name)
        taken[place] = quantity


def meaning(quantity: str, unit: str, scales: Scales) -> tuple[str, float]:
    """Our column for a quantity, and the factor that brings it into SI; without a unit it is in SI.

    Raises StageError where the unit does not fit, or a scale is missing.
    """
    if quantity == "time":
        return "time", factor(unit or "s", "s")
    if quantity == "velocity":  # of a log without a position, which is its integral
        return "velocity", scales.speed(unit)
    if quantity in _LENGTHS:
        return _LENGTHS[quantity], scales.position(unit or unit_on(scales.kind, "rad | m"))
    return _CURRENTS[quantity], scales.current(unit or "A")


def parsed(name: str) -> tuple[str, str] | None:
    """Quantity and unit in a name such as ``position_mm`` or ``torque [N m]``; an empty unit where it has none."""
    match = _HEADER.fullmatch(_BRACKETS.sub(r"_\1", name.strip()))
    return (match[1], match[2] or "") if match else None


def header_unit(name: str) -> str:
    """The unit that a header says behind a quantity of ours or in brackets, as ``Achse 3 [Nm]``; empty where none."""
    if (named := parsed(name)) and named[1]:
        return named[1]
    match = _BRACKETS.search(name.strip())
    return match[1] if match and is_unit(match[1]) else ""


def _unit(choice: Choice, scales: Scales, path: Path) -> str:
    """The unit of a chosen column; of a motion it must be said.  Raises RecordingError where it is not."""
    if choice.said or choice.quantity not in MOTIONS:
        return choice.said
    known = scales.units(choice.quantity)
    where = f"{choice.quantity}={choice.written}"
    reason = (
        f"--columns {where}: the unit is missing, and {path} does not name it; must be one of {', '.join(known)}: "
        f"write the one that it is in, such as {where}:{known[0]}"
    )
    raise RecordingError(reason, path, ProblemKind.UNIT, column=choice.name)


def scales_by_unit(units: Iterable[str], path: Path) -> Scales:
    """The kind of the axis by the units of its positions or velocities.  Raises RecordingError where none shows it."""
    known = [unit for unit in units if unit]
    for bases in map(bases_of, known):
        if bases in ({"rad": 1}, {"m": 1}, {"rad": 1, "s": -1}, {"m": 1, "s": -1}):
            return Scales(ROTARY, travel_unit="rad") if "rad" in bases else Scales(LINEAR)
    what = f" from a position in {known[0]}" if known else ": no column is named position_<unit>"
    reason = (
        f"{path}: the kind of the axis is not known{what}; give --stage, or a position in rad, deg, m or mm, or "
        "write nominal.yaml next to it"
    )
    raise RecordingError(reason, path, ProblemKind.UNIT)


def of_choices(chosen: list[Choice], stated: Stated, path: Path) -> tuple[Scales, dict[str, tuple[Choice, float]]]:
    """The axis, and our columns by name: where each is, and its factor into SI.

    The scales are those that are `stated`, else those that follow from the units of the positions, with what is known.
    Raises RecordingError where time or position is not among them, or a velocity is beside the position.
    """
    units = (choice.unit for choice in chosen if choice.quantity in ("position", "velocity"))
    scales = stated.taken or stated.known.on(scales_by_unit(units, path))
    found: dict[str, tuple[Choice, float]] = {}
    for choice in chosen:
        unit = _unit(choice, scales, path)
        try:
            ours, scale = meaning(choice.quantity, unit, scales)
        except StageError as error:
            reason = f"--columns {choice.quantity}={choice.written}{unit and f':{unit}'}: {error}"
            raise RecordingError(reason, path, ProblemKind.UNIT, column=choice.name) from error
        if ours in found:
            reason = f"{path} has two columns for {ours}, {found[ours][0].name} and {choice.name}: name one"
            raise RecordingError(reason, path, ProblemKind.REPEATED, column=ours)
        found[ours] = (choice, scale * choice.sign)
    if {"measured", "velocity"} <= found.keys():
        reason = f"{path}: --columns names a velocity, which is used only where there is no position: leave it out"
        raise RecordingError(reason, path, ProblemKind.CONFLICT, column="velocity")
    for ours, quantity in (("time", "time"), ("measured", "position")):
        if ours not in found and not (ours == "measured" and "velocity" in found):
            reason = f"{path}: --columns names no {quantity}; add {quantity}=COLUMN, as in {EXAMPLE}"
            reason += NO_TIME if quantity == "time" else ""
            raise RecordingError(reason, path, ProblemKind.MISSING, column=ours)
    return scales, found
