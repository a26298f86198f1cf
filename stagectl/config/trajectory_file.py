"""The trajectory file: ``type: sine`` and its numbers, or a sequence of such blocks."""

from __future__ import annotations

import contextlib
import csv
import math
import re
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import yaml

from stagectl import trajectories
from stagectl.config.loader import ConfigError, Lengths, Reader, Tagged, load
from stagectl.config.source import compose, node_at, read_text
from stagectl.config.stage_file import Setup
from stagectl.trajectories.experiments import AT, START, WATCH
from stagectl.units import LINEAR, ROTARY, Quantity, factor

MOST_PARTS = 1000
LARGEST_CSV = 200_000_000  # bytes
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,2})?")


class Csv(NamedTuple):
    """A recorded motion from a CSV file with the columns ``time_s`` and ``reference_mm`` (or another unit)."""

    file: Annotated[str, "the CSV file, relative to this one"]
    run_up: Annotated[
        float, Quantity("s", "[0, 60]", "time to reach the first velocity from rest; 0: it begins at rest")
    ] = 0.0
    run_out: Annotated[
        float, Quantity("s", "[0, 60]", "time to come to rest from the last velocity; 0: it ends at rest")
    ] = 0.0
    part: Annotated[
        tuple[float, float] | None, Quantity("s", "[-1e12, 1e12]", "first and last time to run, as in the file")
    ] = None


class Parts(NamedTuple):
    """Trajectories one after another."""

    parts: Annotated[tuple[Entry, ...], "list of trajectories, each a block with its type"]


class Together(NamedTuple):
    """Trajectories at once, their motions added."""

    parts: Annotated[tuple[Entry, ...], "list of trajectories, each a block with its type"]


BLOCKS: dict[str, Any] = {**trajectories.TYPES, "csv": Csv, "sequence": Parts, "sum": Together}
Entry = Annotated[Any, Tagged("type", BLOCKS)]
CurrentEntry = Annotated[Any, Tagged("type", trajectories.CURRENTS)]


class Excited(NamedTuple):
    """A motion in closed loop while a current is injected into the command."""

    motion: Entry
    current: CurrentEntry
    start: Annotated[float | None, START] = None


class Release(NamedTuple):
    """A motion in closed loop; then the axis is let go, without any current, and watched."""

    motion: Entry
    at: Annotated[float | None, AT] = None
    watch: Annotated[float, WATCH] = 0.5


EXPERIMENTS: dict[str, Any] = {**BLOCKS, **trajectories.CURRENTS, "excited": Excited, "release": Release}
Root = Annotated[Any, Tagged("type", EXPERIMENTS)]


class Axis(NamedTuple):
    """What of a stage its trajectories depend on."""

    lengths: Lengths
    encoder_step: float  # m of travel (rad where travel is an angle); 0 where it is not known


def axis_of(setup: Setup) -> Axis:
    """The axis that a trajectory is read for."""
    axis = setup.file.axis
    lengths = Lengths(axis.kind, axis.lead, axis.kind == ROTARY and not axis.lead)
    return Axis(lengths, setup.stage.encoder.step * axis.travel_per_unit)


def load_trajectory(path: Path, axis: Axis, text: str | None = None) -> trajectories.Experiment:
    """Read a trajectory or experiment for this axis; positions come out in metres of travel (rad without a lead).

    `text` is the file's content where that is in memory; `path` then only names it and its folder.
    Raises ConfigError or TrajectoryError with the place and the reason.
    """
    entry = load(path, lambda reader, root: _read(reader, root), axis.lengths, text)
    trajectory = _experiment(entry, path, axis)
    try:
        trajectories.check(trajectory)
    except trajectories.TrajectoryError as error:
        place = node_at(compose(path, text), str(error).split(" ")[0].partition(".")[2])
        raise trajectories.TrajectoryError(f"{error} ({path}:{place.start_mark.line + 1})") from error
    return trajectory


def _read(reader: Reader, root: yaml.Node) -> Any:
    if _count(root, 0) > MOST_PARTS:
        reader.refuse(root, f"parts: more than {MOST_PARTS} trajectories; write several files")
        return None
    return reader.value(Root, root, "")


def _count(node: yaml.Node, depth: int) -> int:
    """Blocks below `node`, aliases expanded; stops counting past the limit."""
    inner = [value for _, value in node.value] if isinstance(node, yaml.MappingNode) else []
    inner = node.value if isinstance(node, yaml.SequenceNode) else inner
    total = 1
    for child in inner:
        if total > 20 * MOST_PARTS or depth > 40:
            return 20 * MOST_PARTS
        total += _count(child, depth + 1) if not isinstance(child, yaml.ScalarNode) else 0
    return total


def _experiment(entry: Any, path: Path, axis: Axis) -> trajectories.Experiment:
    if isinstance(entry, Excited):
        return trajectories.Excited(_resolved(entry.motion, path, axis), entry.current, entry.start)
    if isinstance(entry, Release):
        return trajectories.Released(_resolved(entry.motion, path, axis), entry.at, entry.watch)
    if type(entry) in trajectories.CURRENTS.values():
        current: trajectories.Current = entry
        return current
    return _resolved(entry, path, axis)


def _resolved(entry: Any, path: Path, axis: Axis) -> trajectories.Trajectory:
    """Files read, parts resolved."""
    if isinstance(entry, Csv):
        return _recorded(path.parent / entry.file, entry, axis)
    if isinstance(entry, Parts):
        return trajectories.Sequence(tuple(_resolved(part, path, axis) for part in entry.parts))
    if isinstance(entry, Together):
        return trajectories.Sum(tuple(_resolved(part, path, axis) for part in entry.parts))
    found: trajectories.Trajectory = entry
    return found


def _recorded(path: Path, entry: Csv, axis: Axis) -> trajectories.Recorded:
    header, rows = _table(path)
    try:
        where = trajectories.columns(header)
    except trajectories.TrajectoryError as error:
        raise ConfigError(f"{error} ({path}:1)") from error
    scale = _scale(where.unit, axis, path)
    times, positions = [], []
    for number, row in rows:
        cells = [row[column].strip() if column < len(row) else "" for column in (where.time, where.position)]
        if not all(map(_NUMBER.fullmatch, cells)):
            raise ConfigError(f"a row must hold numbers for time and position, not {cells} ({path}:{number})")
        times.append(float(cells[0]))
        positions.append(float(cells[1]) * scale)
    first, last = _part(entry.part, times, path)
    return trajectories.Recorded(times[first:last], positions[first:last], entry.run_up, entry.run_out)


def _part(part: tuple[float, float] | None, times: list[float], path: Path) -> tuple[int, int]:
    """Numbers of the first row to run and of the one after the last."""
    if part is None:
        return 0, len(times)
    inside = [row for row, time in enumerate(times) if part[0] <= time <= part[1]]
    if not inside:
        held = f"{min(times):g} s to {max(times):g} s" if times else "no rows"
        raise ConfigError(f"csv.part = [{part[0]:g} s, {part[1]:g} s] holds no row; the file holds {held} ({path})")
    return inside[0], inside[-1] + 1


def _table(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    text = read_text(path, LARGEST_CSV)
    try:
        lines = [(number, row) for number, row in enumerate(csv.reader(text.splitlines()), 1) if row]
    except csv.Error as error:
        raise ConfigError(f"no CSV text: {error} ({path}:1)") from error
    if not lines:
        raise ConfigError(f"the file is empty ({path}:1)")
    return lines[0][1], lines[1:]


def _scale(unit: str, axis: Axis, path: Path) -> float:
    """Factor from the file's unit to the unit of travel."""
    lengths = axis.lengths
    if unit == "counts":
        if not axis.encoder_step:
            raise ConfigError(f"positions in counts need the stage file, for the encoder's step ({path}:1)")
        return axis.encoder_step
    if (unit == "rad") == lengths.angular:
        return factor(unit, "rad" if lengths.angular else "m")
    if unit == "rad" and lengths.axis == ROTARY:
        return lengths.lead / (2.0 * math.pi)
    raise ConfigError(
        f"positions in {unit} do not fit this axis, whose travel is in {'rad' if lengths.angular else 'm'} ({path}:1)"
    )


FREE = (Axis(Lengths(LINEAR), 0.0), Axis(Lengths(ROTARY, 0.0, True), 0.0))  # without a stage: a length, or an angle


def load_free(path: Path) -> trajectories.Experiment:
    """Read a trajectory without a stage: travel is a length, or an angle where the file says so."""
    try:
        return load_trajectory(path, FREE[0])
    except ConfigError:
        with contextlib.suppress(ConfigError):
            return load_trajectory(path, FREE[1])
        raise
