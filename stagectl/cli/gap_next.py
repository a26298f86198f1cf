"""The verb `gap next`: the experiment that a diagnosis proposes, as a file that `run` takes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stagectl.cli.gap_apply import ResultArgument
from stagectl.cli.motion import Json
from stagectl.cli.show import console, emit
from stagectl.units import StageError

if TYPE_CHECKING:
    from stagectl.gap.found import Found, Next

Output = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="FILE.yaml", help="Where the trajectory goes; else to FOLDER.")
]


def register(app: typer.Typer) -> None:
    """Add the verb to the group `gap`."""
    app.command("next")(following)


def following(folder: ResultArgument, output: Output = None, json: Json = None) -> None:
    """Write the experiment that separates what is ambiguous, or shows what no run has shown.

    Example: stagectl gap next captures/ -o next.yaml
    """
    from stagectl.gap import told
    from stagectl.gap.stored import load

    found = load(folder)
    one = found.next_experiment
    for line in told.advice(found) if one else ["no experiment is proposed: these data leave nothing that one tells"]:
        console.print(line)
    written = _written(found, one, folder, output) if one else None
    emit({"next_experiment": one._asdict() if one else None, "written": str(written) if written else None}, json)
    if output is not None and written is None:
        console.print(f"{output} is not written: there is no trajectory to write")
        raise typer.Exit(1)


def _written(found: Found, one: Next, folder: Path, output: Path | None) -> Path | None:
    """The trajectory file, with the commands that run it; None where it is done by hand.

    Raises StageError where another file stands in its place.
    """
    if not one.trajectory:
        return None
    place = folder if folder.is_dir() else folder.parent
    path = output or place / one.trajectory
    if path.exists() and path.read_text(encoding="utf-8") != one.text:
        raise StageError(f"{path} exists and holds something else: move it away, or name another file with -o")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(one.text, encoding="utf-8")
    console.print(f"wrote {path}; to run it, and to diagnose again with it:")
    for line in _commands(one, place, path):
        console.print(line, style="bold")
    return path


def _commands(one: Next, place: Path, path: Path) -> list[str]:
    """What follows: into a folder of our recordings goes another one, into one from elsewhere another capture."""
    if (place / "captures.yaml").is_file():
        return [
            f"stagectl run STAGE.yaml {path}, or as your machine does it; add the log to {place / 'captures.yaml'}",
            f"stagectl gap diagnose {place}",
        ]
    recording = place / f"{one.name}-1.h5"
    return [f"stagectl run STAGE.yaml {path} --output {recording}", f"stagectl gap diagnose {place}"]
