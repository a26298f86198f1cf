"""The trajectory file: ``type: sine`` and its numbers, or a sequence of such blocks."""

import contextlib
import csv
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import yaml

from stagectl import trajectories
from stagectl.config.bounds import DEEPEST_PARTS, LARGEST_CSV, MOST_PARTS
from stagectl.config.lengths import Lengths
from stagectl.config.loader import Reader, load
from stagectl.config.source import (
    ConfigError,
    UnreadableError,
    children_of,
    compose,
    entry_of,
    malformed,
    placed,
    read_text,
)
from stagectl.config.stage_file import Setup
from stagectl.problem import Problem, ProblemKind
from stagectl.trajectories import TYPES, Csv, Excited, Released, Sequence, Sum
from stagectl.units import LINEAR, ROTARY, Tagged, factor

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,2})?")


EXPERIMENTS: dict[str, Any] = {**TYPES, **trajectories.CURRENTS, "excited": Excited, "release": Released}
Root = Annotated[Any, Tagged("type", EXPERIMENTS)]


class Axis(NamedTuple):
    """The properties of a stage that its trajectories depend on."""

    lengths: Lengths
    encoder_step: float  # m of travel (rad where travel is an angle); 0 where it is not known


def axis_of(setup: Setup) -> Axis:
    """The axis that a trajectory is read for."""
    axis = setup.file.axis
    lengths = Lengths(axis.kind, axis.lead, axis.kind == ROTARY and not axis.lead)
    return Axis(lengths, setup.stage.encoder.step * axis.travel_per_unit)


Row = tuple[int, list[str]]  # of a CSV file: its line, from 1, and its cells
Tables = Mapping[str, str]  # text of the CSV files that a trajectory names


class _Source(NamedTuple):
    """Where a trajectory comes from."""

    path: Path
    axis: Axis
    tables: Tables | None  # None: next to `path`.  Otherwise there are no others, and no file is read


def load_trajectory(
    path: Path, axis: Axis, text: str | None = None, tables: Tables | None = None
) -> trajectories.Experiment:
    """Read a trajectory or experiment for this axis; positions come out in metres of travel (rad without a lead).

    `text` is the file's content where that is in memory; `path` then only names it and its folder.  With `tables` no
    file is read: what somebody else sent may name only what came with it.
    Raises ConfigError or TrajectoryError with the place and the reason.
    """
    entry = load(path, _read, axis.lengths, text)
    try:
        trajectory: trajectories.Experiment = _resolved(entry, _Source(path, axis, tables), "")
        trajectories.check(trajectory)
    except (trajectories.TrajectoryError, UnreadableError) as error:
        root = compose(path, text)
        error.problems = tuple(placed(problem, path, root) for problem in error.problems)
        raise
    return trajectory


def _read(reader: Reader, root: yaml.Node) -> Any:
    if beyond := _beyond(root):
        reader.refuse(root, beyond)
        return None
    if entry_of(root, "type") is None and (axis := entry_of(root, "axis")) is not None:
        remedy = "give the trajectory file in its place"
        reader.refuse(axis, Problem("belongs to a stage file", ProblemKind.UNKNOWN, "axis", remedy=remedy))
        return None
    return reader.value(Root, root, "")


def _beyond(root: yaml.Node) -> Problem | None:
    """The bound of a file that the blocks below `root` are beyond, aliases expanded; None where it is none."""
    waiting, count = [(root, 0)], 0
    while waiting:
        node, depth = waiting.pop()
        count += 1
        waiting += [(child, depth + 1) for child in children_of(node) if not isinstance(child, yaml.ScalarNode)]
        if depth > DEEPEST_PARTS:
            return _too_many(
                "trajectories within each other", DEEPEST_PARTS // 2, "write the repeats of one as its cycles"
            )
        if count + len(waiting) > MOST_PARTS:
            return _too_many("trajectories", MOST_PARTS, "write several files")
    return None


def _too_many(what: str, most: int, remedy: str) -> Problem:
    return Problem(f"holds more than {most} {what}", ProblemKind.SHAPE, "parts", interval=f"[1, {most}]", remedy=remedy)


def _resolved(entry: Any, source: _Source, place: str) -> Any:
    """The trajectory or experiment with its files read; `place` is the key path of the entry, with a dot at its end."""
    if isinstance(entry, Csv):
        return _recorded(entry, source, place)
    if isinstance(entry, Sequence | Sum):
        parts = tuple(_resolved(part, source, f"{place}parts[{k}].") for k, part in enumerate(entry.parts))
        return entry._replace(parts=parts)
    if isinstance(entry, Excited | Released):
        return entry._replace(motion=_resolved(entry.motion, source, f"{place}motion."))
    return entry


def _recorded(entry: Csv, source: _Source, place: str) -> trajectories.Recorded:
    path = source.path.parent / entry.file
    (_, header), *rows = _table(path, _table_text(entry, source, place))
    try:
        columns = trajectories.columns(header)
    except trajectories.TrajectoryError as error:
        raise ConfigError(*(problem._replace(file=path, line=1) for problem in error.problems)) from error
    scale = _scale(columns.unit, source.axis, path)
    samples = [_sample(row, columns, path) for row in rows]
    _check_order(path, [line for line, _ in rows], [time for time, _ in samples])
    run = _part(entry.part, [time for time, _ in samples], path)
    times, positions = [time for time, _ in samples[run]], [position * scale for _, position in samples[run]]
    return trajectories.Recorded(times, positions, entry.run_up, entry.run_out)


def _table_text(entry: Csv, source: _Source, place: str) -> str:
    """Text of the CSV file.  Raises TrajectoryError where it must have been sent along and was not."""
    if source.tables is None:
        try:
            return read_text(source.path.parent / entry.file, LARGEST_CSV)
        except UnreadableError as error:
            named = (problem._replace(key=f"{place}file", value=entry.file) for problem in error.problems)
            raise UnreadableError(*named) from error
    if entry.file not in source.tables:
        reason = "names a file; what is uploaded can only name tables that are uploaded with it"
        remedy = "send the table's text under this name, as `stagectl follow` does"
        key = f"{place}file"
        raise trajectories.TrajectoryError(Problem(reason, ProblemKind.FILE, key, entry.file, remedy=remedy))
    return source.tables[entry.file]


def tables_of(path: Path, text: str) -> dict[str, str]:
    """The CSV files that a trajectory file names, by these names: what must be sent along with it.

    Raises ConfigError where the file is no YAML, or one of them cannot be read.
    """
    names = [entry.value for entry in _files(compose(path, text))]
    return {name: read_text(path.parent / name, LARGEST_CSV) for name in names}


def _files(node: yaml.Node) -> Iterator[yaml.ScalarNode]:
    """The values of `file` in this block and all below."""
    if isinstance(named := entry_of(node, "file"), yaml.ScalarNode):
        yield named
    for child in children_of(node):
        yield from _files(child)


def _sample(row: Row, columns: trajectories.Columns, path: Path) -> tuple[float, float]:
    """Time (s) and position in the file's unit."""
    line, filled = row
    cells = [filled[j].strip() if j < len(filled) else "" for j in (columns.time, columns.position)]
    if not all(map(_NUMBER.fullmatch, cells)):
        raise malformed(path, f"a row must hold numbers for time and position, not {cells}", line)
    return float(cells[0]), float(cells[1])


def _check_order(path: Path, lines: list[int], times: list[float]) -> None:
    """Refuse a row that is no later than the one before it, by its line."""
    for line, before, time in zip(lines[1:], times, times[1:], strict=False):
        if time <= before:
            raise malformed(path, f"time {time:g} s follows {before:g} s: sort the rows by time, each time once", line)


def _part(part: tuple[float, float] | None, times: list[float], path: Path) -> slice:
    """The rows to run."""
    if part is None:
        return slice(None)
    inside = [row for row, time in enumerate(times) if part[0] <= time <= part[1]]
    if not inside:
        span = f"{min(times):g} s to {max(times):g} s" if times else "no rows"
        value = f"[{part[0]:g} s, {part[1]:g} s]"
        problem = Problem(f"holds no row; {path} holds {span}", ProblemKind.CONFLICT, "part", value, "s")
        raise ConfigError(problem._replace(file=path, line=1))
    return slice(inside[0], inside[-1] + 1)


def _table(path: Path, text: str) -> list[Row]:
    """The header and all other rows."""
    try:
        rows = [(line, cells) for line, cells in enumerate(csv.reader(text.splitlines()), 1) if cells]
    except csv.Error as error:
        raise malformed(path, f"not CSV text: {error}") from error
    if not rows:
        raise malformed(path, "the file is empty")
    return rows


def _scale(unit: str, axis: Axis, path: Path) -> float:
    """Factor from the file's unit to the unit of travel."""
    lengths = axis.lengths
    if unit == "counts":
        if not axis.encoder_step:
            raise _unit_error(path, "positions in counts need the stage file, for the encoder's step")
        return axis.encoder_step
    if (unit == "rad") == lengths.angular:
        return factor(unit, "rad" if lengths.angular else "m")
    if unit == "rad" and lengths.axis == ROTARY:
        return lengths.lead / (2.0 * math.pi)
    travel = "rad" if lengths.angular else "m"
    raise _unit_error(path, f"positions in {unit} do not fit this axis, whose travel is in {travel}")


def _unit_error(path: Path, reason: str) -> ConfigError:
    return ConfigError(Problem(reason, ProblemKind.UNIT, file=path, line=1))


FREE = (Axis(Lengths(LINEAR), 0.0), Axis(Lengths(ROTARY, 0.0, True), 0.0))  # without a stage: a length, or an angle


def load_free(path: Path) -> trajectories.Experiment:
    """Read a trajectory without a stage: travel is a length, or an angle where the file says so."""
    try:
        return load_trajectory(path, FREE[0])
    except ConfigError:
        with contextlib.suppress(ConfigError):
            return load_trajectory(path, FREE[1])
        raise
