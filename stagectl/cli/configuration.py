"""Verbs about configuration files: check and schema."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer

from stagectl.cli.show import console
from stagectl.units import StageError

app = typer.Typer(help="Check configuration files, export their JSON schema.", no_args_is_help=True)


@app.command()
def check(files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Stage and trajectory files.")]) -> None:
    """Check files without moving anything: exit 0 all good, 1 something wrong, 2 a file cannot be read."""
    worst = max(_check(path) for path in files)
    raise typer.Exit(worst)


def _check(path: Path) -> int:
    if not path.is_file():
        console.print(f"[bold red]error:[/] {path}: no such file")
        return 2
    try:
        console.print(f"[green]good[/]  {path}: {_words(path)}")
        return 0
    except StageError as error:
        for line in str(error).splitlines():
            console.print(f"[bold red]error:[/] {line}", markup=True)
        return 1


def _words(path: Path) -> str:
    from stagectl.config.loader import compose
    from stagectl.config.trajectory_file import load_free

    node = compose(path)
    if any(getattr(key, "value", "") == "type" for key, _ in _pairs(node)):
        trajectory = load_free(path)
        return f"trajectory of {trajectory.duration:.4g} s"
    return _stage_words(path)


def _pairs(node: Any) -> list[Any]:
    return node.value if isinstance(node.value, list) and node.id == "mapping" else []


def _stage_words(path: Path) -> str:
    from stagectl import design
    from stagectl.config.stage_file import load_stage

    setup = load_stage(path)
    reached = design.margins(setup.stage, design.gains(setup.stage, setup.file.control), setup.dt)
    return (
        f"{setup.file.name}, {setup.file.control.bandwidth:g} Hz at {setup.dt * 1e3:g} ms; phase margin "
        f"{math.degrees(reached.phase):.1f} deg, gain margin {20 * math.log10(reached.gain):.1f} dB, "
        f"crossover {reached.crossover:.1f} Hz (nd {setup.stage.drive.delay_samples}, "
        f"nm {setup.stage.encoder.delay_samples})"
    )


@app.command()
def schema(what: Annotated[str, typer.Argument(help="stage or trajectory")] = "stage") -> None:
    """Print the JSON schema of a stage or trajectory file, for editors."""
    from stagectl.config.schema import SCHEMAS

    if what not in SCHEMAS:
        raise StageError(f"no schema {what}; there are {', '.join(SCHEMAS)}")
    print(json.dumps(SCHEMAS[what](), indent=2))
