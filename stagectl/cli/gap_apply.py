"""The command `gap apply`: named effects go into the stage file, after the user has seen the diff."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli.options import Json, StageArgument, argument, option
from stagectl.cli.show import console, emit
from stagectl.units import StageError

ResultArgument = Annotated[Path, argument("FOLDER", "Diagnosed captures, or the JSON file of a diagnosis.")]
_COLOURS = {"+": "green", "-": "red", "@": "cyan", "#": "dim"}


def apply(
    folder: ResultArgument,
    stage: StageArgument,
    output: Annotated[Path | None, option("--output -o NEW.yaml", "Write a copy; STAGE.yaml stays unchanged.")] = None,
    only: Annotated[str | None, option("--only NAME,...", "Only these effects, named or not.")] = None,
    choose: Annotated[
        list[str] | None, option("--choose NAME", "This alternative instead of the effect that it may replace.")
    ] = None,
    unknown: Annotated[bool, option("--unknown", "Also add the unknown part as a table.")] = False,
    yes: Annotated[bool, option("--yes -y", "Write without asking.")] = False,
    json: Json = None,
) -> None:
    """Add the named effects to the stage model, as a patch that is shown first.

    Example: stagectl gap apply captures/ config/ball-screw.yaml -o with-effects.yaml
    """
    from rich.text import Text

    from stagectl.gap.result.patch import applied, patch_of, with_choices
    from stagectl.gap.result.result_json import load

    diagnosis = with_choices(load(folder), choose or ())
    patch = patch_of(diagnosis, stage, [name.strip() for name in only.split(",")] if only else (), unknown)
    for line in patch.diff:
        console.print(Text(line, style=_COLOURS.get(line[:1], "")))
    target = output or stage
    if patch.changes:
        _ask(target, yes)
        saved = applied(patch, output)
        console.print(f"wrote {target}" + (f"; what it was is in {saved}" if saved else f", a copy of {stage}"))
    else:
        console.print(f"{stage} says all of this already: nothing is written")
    emit(
        {
            "written": str(target) if patch.changes else None,
            "changes": [change._asdict() for change in patch.changes],
            "comments": list(patch.comments),
        },
        json,
    )


def _ask(target: Path, yes: bool) -> None:
    """Raise StageError without a terminal, and typer's Exit if the user declines."""
    if yes:
        return
    if not sys.stdin.isatty():
        raise StageError(f"nothing is written into {target}: nobody is there to be asked; --yes writes without asking")
    if not typer.confirm(f"Write this into {target}?", err=True):
        console.print("nothing is written")
        raise typer.Exit(1)
