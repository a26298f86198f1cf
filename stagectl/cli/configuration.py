"""Verbs about configuration files: check and schema."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stagectl.cli.options import Json, argument
from stagectl.cli.show import console, emit, without_compiler
from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError

if TYPE_CHECKING:
    from stagectl.config.stage_blocks import StageFile
    from stagectl.config.stage_file import Setup

config = typer.Typer(help="Check configuration files, export their JSON schema.", no_args_is_help=True)


@config.command()
def check(files: Annotated[list[Path], argument("FILE...", "Stage and trajectory files.")], json: Json = None) -> None:
    """Check files without moving anything: exit 0 all good, 1 something wrong, 2 a file cannot be read.

    Example: stagectl config check config/ball-screw.yaml config/trajectories/sine-1.6hz.yaml
    """
    without_compiler()
    stages = [path for path in files if _is_stage(path)]
    machine = _machine(stages[0]) if len(stages) == 1 else None  # of several, nobody knows which one is to move
    results = [{"file": str(path), **_check(path, machine)} for path in files]
    emit({"files": results}, json)
    raise typer.Exit(max(result["code"] for result in results))


def _machine(path: Path) -> Setup | None:
    """The stage that is to move; None where it is not one, which its own line says."""
    from stagectl.config.stage_file import load_stage

    with contextlib.suppress(StageError):
        return load_stage(path)
    return None


def _check(path: Path, machine: Setup | None) -> dict[str, Any]:
    from rich.text import Text

    from stagectl.config.machine_file import axes_of
    from stagectl.config.source import UnreadableError

    try:
        known = [(axis, *_known(axis, machine)) for axis in axes_of(path)]
        for axis, words, warnings in known:
            headline = ("valid", "yellow") if warnings else ("good", "green")
            console.print(Text.assemble(headline, f"  {axis}: {words}"))
            for warning in warnings:
                console.print(Text.assemble(("warning:", "bold yellow"), f" {axis}: {warning}"))
        every = [warning for _, _, warnings in known for warning in warnings]
        return {"code": 0, "words": "; ".join(words for _, words, _ in known), "warnings": every, "errors": []}
    except StageError as error:
        for line in str(error).splitlines():
            console.print(Text.assemble(("error:", "bold red"), f" {line}"))
        code = 2 if isinstance(error, UnreadableError) else 1
        return {"code": code, "words": "", "warnings": [], "errors": str(error).splitlines()}


def kind(path: Path) -> str:
    """Whether a valid file is a stage or a trajectory; empty where it is neither."""
    try:
        _known(path)
    except StageError:
        return ""
    return "stage" if _is_stage(path) else "trajectory"


def _is_stage(path: Path) -> bool:
    """Whether the keys of a file are a stage's; what cannot be read is none."""
    from yaml import MappingNode, ScalarNode

    from stagectl.config.machine_file import split
    from stagectl.config.source import compose
    from stagectl.config.stage_blocks import StageFile

    with contextlib.suppress(StageError):
        node = compose(split(path)[0])
        keys = [key for key, _ in node.value] if isinstance(node, MappingNode) else []
        words = {key.value for key in keys if isinstance(key, ScalarNode)}
        return "type" not in words and bool(words & set(StageFile._fields))
    return False


def _known(path: Path, machine: Setup | None = None) -> tuple[str, list[str]]:
    """What a valid file says, and warnings; a trajectory must keep to the limits of the `machine`, if there is one."""
    from stagectl.config.trajectory_file import load_free
    from stagectl.trajectories import phases

    if _is_stage(path):
        return _stage(path)
    duration = phases(load_free(path)).duration
    return f"trajectory of {duration:.4g} s{_on(path, machine) if machine else ''}", []


def _on(path: Path, machine: Setup) -> str:
    from stagectl.config.trajectory_file import axis_of, load_trajectory
    from stagectl.motion_limits import check_limits
    from stagectl.trajectories import phases

    check_limits(machine, phases(load_trajectory(path, axis_of(machine))).motion)
    return f", within the limits of {machine.path}"


def _stage(path: Path) -> tuple[str, list[str]]:
    from stagectl import design
    from stagectl.config.stage_checks import doubtful
    from stagectl.config.stage_file import load_stage
    from stagectl.config.wire_checks import untried
    from stagectl.realtime.envelope import unwatched

    setup = load_stage(path)
    control = setup.file.control
    reached = setup.margins
    name, value, unit = design.speed(control)
    watched = ", with the observer" if "observer" in control.layers else ""
    phase, least = math.degrees(reached.phase), math.degrees(control.margin)
    words = (
        f"{setup.file.name}, {name.replace('_', ' ')} {value:g} {unit} at {setup.dt * 1e3:g} ms; "
        f"phase margin {phase:.1f} deg (at least {least:g}), gain margin {20 * math.log10(reached.gain):.1f} dB, "
        f"crossover {reached.crossover:.1f} Hz{watched} "
        f"(nd {setup.stage.drive.delay_samples}, nm {setup.stage.encoder.delay_samples}); {_protects(setup.file)}"
    )
    warnings = setup.unrest, doubtful(setup.file), unwatched(setup), untried(setup.file)
    return words, [*filter(None, warnings)]


def _protects(file: StageFile) -> str:
    """What protects the machine: ``travel -50 mm to 50 mm, 300 mm/s, 15 A``."""
    unit, scale = ("mm", 1e3) if file.axis.travel_unit == "m" else ("rad", 1.0)
    scale *= file.axis.travel_per_unit
    low, high, speed = (f"{scale * value:g} {unit}" for value in (*file.limits.travel, file.limits.speed))
    return f"travel {low} to {high}, {speed}/s, {file.drive.current_limit:g} A"


@config.command()
def schema(what: Annotated[str, argument("[WHAT]", "stage or trajectory")] = "stage", json: Json = "-") -> None:
    """Print the JSON schema of a stage or trajectory file, for editors.

    Example: stagectl config schema trajectory
    """
    from stagectl.config.schema import SCHEMAS

    if what not in SCHEMAS:
        raise StageError(Problem("", ProblemKind.VALUE, "schema", what, choices=tuple(SCHEMAS)))
    emit(SCHEMAS[what](), json)
