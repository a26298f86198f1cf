"""A log that does not say what its columns are: what they most likely are, how sure that is, and why.

::

    table --> live columns --> time --> position and velocity --> reference --> efforts --> units --> words of --columns
"""

import math
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stagectl.problem import ProblemKind
from stagectl.recording import constants
from stagectl.recording.columns import NO_TIME, Array
from stagectl.recording.guess import motion, names, roles, units
from stagectl.recording.guess.names import Column, by_name, hinted
from stagectl.recording.guess.roles import Role
from stagectl.recording.guess.units import Unit
from stagectl.recording.hdf5 import RecordingError
from stagectl.recording.scales import SHARES, Known, Scales, bases_of
from stagectl.units import LINEAR, ROTARY, factor, unit_on


class GuessedColumn(NamedTuple):
    """One column of the log as it is taken."""

    quantity: str  # as in --columns
    column: str  # with a minus where it is turned
    unit: str
    sure: float  # 0 to 1, of column and unit together
    why: str
    stranger: str = ""  # in brackets in its header, where a unit belongs, and none of its quantity


class Guess(NamedTuple):
    """All columns that are taken, and the scales that they need."""

    columns: tuple[GuessedColumn, ...]
    scales: Scales
    notes: tuple[str, ...]  # defaults that were taken

    @property
    def words(self) -> dict[str, str]:
        """The same as --columns would say it."""
        return {part.quantity: f"{part.column}:{part.unit}" for part in self.columns}

    @property
    def sure(self) -> float:
        """Of the least sure column."""
        return min(part.sure for part in self.columns)


def guess(path: Path, known: Known, named: Collection[str] = ()) -> Guess:
    """What the columns of the log at `path` are; the user names the columns of the quantities `named`.

    Raises RecordingError where there is no time, or nothing that moves.
    """
    columns = roles.live(names.read(path))
    time = roles.time_of(columns)
    if time is None:
        reason = f"{path} has no column that runs on as a time does; say which it is: --columns time=...{NO_TIME}"
        raise RecordingError(reason, path, ProblemKind.MISSING, column="time")
    unit = units.of_time(time.column.words, time.column.values)
    seconds = time.column.values * factor(unit.name, "s")
    others = roles.beside(columns, time.column)
    if not others:
        reason = f"{path} has no column that varies besides the time; say which is the position: --columns position=..."
        raise RecordingError(reason, path, ProblemKind.MISSING, column="position")
    if not {"position", "velocity"} & set(named):
        _check_moves(others, path)
    parts, scales, notes = _of_motion(others, seconds, known)
    return Guess((_part("time", time, unit), *parts), scales, tuple(notes))


def _check_moves(columns: list[Column], path: Path) -> None:
    """Refuse a log in which every column is named a current or a force.  Raises RecordingError."""
    if not all(hinted(column, "effort") for column in columns):
        return
    one = columns[0]
    what = f"column {one.name} ({one.words})" if one.name.isdecimal() else one.name
    reason = (
        f"{path}: no column can be a position: {what} is a current or a force; name one: --columns position=N:mm, or "
        "record a position with it"
    )
    raise RecordingError(reason, path, ProblemKind.MISSING, column="position")


def _part(quantity: str, role: Role, unit: Unit, turned: bool = False) -> GuessedColumn:
    name = f"-{role.column.name}" if turned else role.column.name
    why = f"{role.why}; {unit.why}{'; it opposes the motion, so its sign is turned' if turned else ''}"
    stranger = units.bracketed(role.column.words) if unit.sure <= constants.SURE_BY_MAGNITUDE else ""
    return GuessedColumn(quantity, name, unit.name, min(role.sure, unit.sure), why, stranger)


def _of_motion(others: list[Column], time: Array, known: Known) -> tuple[list[GuessedColumn], Scales, list[str]]:
    """Position, reference and efforts."""
    blocks = motion.blocks_of(time)
    position, velocity = roles.position_and_velocity(others, blocks)
    if position is None:
        assert velocity is not None
        unit = units.of_velocity(velocity.column.words, velocity.column.values)
        parts, used = [_part("velocity", velocity, unit)], [velocity.column]
        speed = motion.mean(blocks, velocity.column.values)
    else:
        others = roles.of_one_axis(others, position, velocity, 1 + len(others))
        used = [velocity.column] if velocity else []
        pair = roles.reference_of([c for c in others if c not in used], position.column)
        position = position._replace(column=pair[1]) if pair else position
        unit = _unit_of_position(position, velocity, known)
        parts = [_part("position", position, unit), *([_part("reference", pair[0], unit)] if pair else [])]
        used += [position.column, *([pair[0].column] if pair else [])]
        speed = motion.change(blocks, position.column.values) / blocks.duration
    scales, notes = _scales(unit, position, time, known)
    driving = roles.efforts([c for c in others if all(c is not u for u in used)], blocks, speed)
    forces, scales, more = _efforts(driving, scales, blocks)
    return [*parts, *forces], scales, [*notes, *more]


def _unit_of_position(position: Role, velocity: Role | None, known: Known) -> Unit:
    speed = units.said(velocity.column.words, "velocity") if velocity else None
    ratio = velocity.ratio if velocity else 0.0
    unit = units.of_position(position.column.words, position.column.values, ratio, speed.name if speed else "", known)
    scaled = unit.name != "counts" or known.counts or known.axis
    return unit if scaled else unit._replace(sure=constants.SURE_BY_DEFAULT)  # how many a turn is nowhere said


def _scales(unit: Unit, position: Role | None, time: Array, known: Known) -> tuple[Scales, list[str]]:
    kind = LINEAR if "m" in bases_of(unit.name) else ROTARY
    scales = known.on(Scales(kind, travel_unit=unit_on(kind, "rad | m")))
    if known.counts:
        return scales, []
    if unit.name != "counts" or position is None:
        return scales, []
    counts = units.counts_by_speed(position.column.values, time)
    words = f"counts a turn are not known: {counts:.0f} taken, by the speed of the motion; say --counts N"
    return scales._replace(encoder_step=2.0 * math.pi / counts), [words]


def _efforts(
    driving: list[Role], scales: Scales, blocks: motion.Blocks
) -> tuple[list[GuessedColumn], Scales, list[str]]:
    """The measured effort and the command, in units that agree with each other."""
    if not driving:
        return [], scales, ["no column drives the motion: no force is known; say --columns current=..."]
    measured = _after_its_command(driving, blocks)
    unit = units.of_effort(measured.column.words)
    notes: list[str] = []
    scaled = _other_scale(measured, driving)
    if scaled is not None and unit.sure <= constants.SURE_BY_MAGNITUDE:
        measured, constant = scaled
        why = f"another column is {constant:.4g} times it: a current and its torque"
        unit = Unit("A", constants.SURE_BY_MAGNITUDE, why)
        scales = scales._replace(force_constant=scales.force_constant or constant)
    unit, scales, words = _usable(unit, scales)
    notes += words
    parts = [_part("current", measured, unit, measured.ratio < 0.0)]
    if command := _command(driving, measured, blocks):
        taken = _unit_of_command(command, measured, unit, scales)
        parts.append(_part("command", command, taken, measured.ratio < 0.0))
    return parts, scales, notes


def _after_its_command(driving: list[Role], blocks: motion.Blocks) -> Role:
    """The measured column: of two that are named alike, or both not, the one that follows the other."""
    first = driving[0]
    command = _command(driving, first, blocks)
    alike = command is not None and by_name(command.column) == by_name(first.column)
    return command if command and alike and roles.ahead(first, command) else first


def _other_scale(measured: Role, driving: list[Role]) -> tuple[Role, float] | None:
    """The current, of two measured columns that are the same but for a factor, and what the other is times it.

    Names say which of them is the current, else the larger numbers.
    """
    for other in driving:
        if other is measured or _correlation(measured, other) <= constants.PROPORTIONAL:
            continue
        torque, current = sorted((measured, other), key=_current_last)
        constant = float(np.std(torque.column.values) / np.std(current.column.values))
        if constant > constants.LEAST_CONSTANT and not units.same_by_name(torque.column.words, current.column.words):
            return current._replace(ratio=measured.ratio), constant
    return None


def _current_last(role: Role) -> tuple[bool, float]:
    return units.of_effort(role.column.words).name == "A", float(np.std(role.column.values))


def _correlation(first: Role, second: Role) -> float:
    return float(np.corrcoef(first.column.values, second.column.values)[0, 1])


def _usable(unit: Unit, scales: Scales) -> tuple[Unit, Scales, list[str]]:
    """A unit that can be converted: what has no scale is kept as amperes, and said."""
    if unit.name == "V" or (unit.name in SHARES and not scales.rated_current):
        words = f"a column in {unit.name} has no scale: its numbers are kept as A"
        return Unit("A", min(unit.sure, constants.SURE_BY_DEFAULT), words), scales, [words]
    if unit.name in ("N", "Nm", "mNm") and not scales.force_constant:
        words = "the force constant is not known: 1 is taken, so that the column of the current holds the force; say "
        return unit, scales._replace(force_constant=1.0), [f"{words}--force-constant K"]
    return unit, scales, []


def _command(driving: list[Role], measured: Role, blocks: motion.Blocks) -> Role | None:
    """The other column that goes with the measured one: what is called a command, else the smoothest."""
    alike = [
        role
        for role in driving
        if role.column is not measured.column
        and roles.together(blocks, role, measured) > constants.GOES_WITH
        and _correlation(role, measured) < constants.PROPORTIONAL
    ]
    return min(alike, key=lambda role: (not hinted(role.column, "command"), role.rough), default=None)


def _unit_of_command(command: Role, measured: Role, unit: Unit, scales: Scales) -> Unit:
    """Its own words, else the unit in which it is as large as what was measured."""
    if own := units.said(command.column.words, "effort"):
        return own
    slope, _ = np.polyfit(command.column.values, measured.column.values, 1)
    ratio = max(abs(float(slope)), constants.TINY)
    force, constant = "N" if scales.kind == LINEAR else "Nm", scales.force_constant
    if unit.name == "A" and constant and abs(math.log(ratio * constant)) < abs(math.log(ratio)):
        return Unit(force, constants.SURE_BY_MAGNITUDE, "it is as large as the torque")
    if abs(ratio - 1.0) < constants.SAME_UNIT:
        return Unit(unit.name, unit.sure, "it is as large as what was measured")
    why = f"{ratio:.3g} times it is what was measured, so it may be in {force}"
    return Unit(unit.name, constants.SURE_BY_DEFAULT, why)
