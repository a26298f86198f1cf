"""The command `gap apply`: named effects go into the stage file, after the user has seen the diff."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli.motion import Json, StageArgument
from stagectl.cli.show import console, emit
from stagectl.units import StageError

ResultArgument = Annotated[
    Path, typer.Argument(metavar="FOLDER", help="Diagnosed captures, or the JSON file of a diagnosis.")
]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="NEW.yaml", help="Write a copy; STAGE.yaml stays unchanged.")
]
Only = Annotated[str | None, typer.Option("--only", metavar="NAME,...", help="Only these effects, named or not.")]
Choose = Annotated[
    list[str] | None,
    typer.Option("--choose", metavar="NAME", help="This alternative instead of the effect that it may replace."),
]
Unknown = Annotated[bool, typer.Option("--unknown", help="Also add the unknown part as a table.")]
Yes = Annotated[bool, typer.Option("--yes", "-y", help="Write without asking.")]
_COLOURS = {"+": "green", "-": "red", "@": "cyan", "#": "dim"}


def apply(
    folder: ResultArgument,
    stage: StageArgument,
    output: Output = None,
    only: Only = None,
    choose: Choose = None,
    unknown: Unknown = False,
    yes: Yes = False,
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
