"""Verbs over recordings: export, import, replay, identify."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from stagectl.cli.motion import Json, StageArgument
from stagectl.cli.show import console, emit

RecordingArgument = Annotated[Path, typer.Argument(metavar="RECORDING.h5", help="A recording.")]
Recordings = Annotated[list[Path], typer.Argument(metavar="RECORDING.h5...", help="Recordings.")]
Captures = Annotated[list[Path], typer.Argument(metavar="CAPTURE...", help="Recordings, logs or folders of captures.")]
Where = Annotated[Path | None, typer.Option("--output", "-o", metavar="PATH", help="Where to write.")]


class Format(enum.StrEnum):
    """What a recording can become; `stagectl.recording.exports` writes it."""

    CSV = "csv"
    PARQUET = "parquet"
    MAT = "mat"
    FOLDER = "folder"
    TRAJECTORY = "trajectory"


class Method(enum.StrEnum):
    """How parameters are found."""

    LEAST_SQUARES = "least-squares"


def register(app: typer.Typer) -> None:
    """Add these verbs to the command line."""
    app.command("replay")(replay)
    app.command("export")(export)
    app.command("import")(import_)
    app.command("identify")(identify)


def replay(recording: RecordingArgument, json: Json = None) -> None:
    """Run the recorded feedback through the same law: the same commands, bit for bit, or exit 1."""
    from stagectl.recording.hdf5 import open_recording
    from stagectl.recording.replay import replay as again

    found = again(open_recording(recording))
    console.print(found["words"])
    emit(found, json)
    if not found["identical"]:
        raise typer.Exit(1)


def export(
    recordings: Recordings,
    to: Annotated[Format, typer.Option(help="Format; a folder takes several recordings.")],
    output: Where = None,
) -> None:
    """Write recordings for other programs: csv, parquet, mat, a trajectory, or a folder of captures.

    Example: stagectl export recordings/a.h5 recordings/b.h5 --to folder -o captures
    """
    from stagectl.recording import exports
    from stagectl.recording.hdf5 import open_recording

    for path, notes in exports.export([open_recording(one) for one in recordings], to.value, output):
        for note in notes:
            console.print(note)
        console.print(f"wrote {path}")


def import_(
    source: Annotated[Path, typer.Argument(metavar="FILE", help="A .csv, the EMPS .mat, or a folder of captures.")],
    stage: Annotated[Path | None, typer.Option(metavar="STAGE.yaml", help="The machine, for its scales.")] = None,
    output: Where = None,
) -> None:
    """Bring a log from elsewhere in as a recording; what it lacks is said.

    Example: stagectl import DATA_EMPS.mat -o recordings/emps.h5
    """
    from stagectl.config.stage_file import load_stage
    from stagectl.recording.imports import read, store

    found = read(source, load_stage(stage) if stage else None)
    for recording, path in zip(found, store(found, source, output), strict=True):
        for note in recording.meta["notes"]:
            console.print(note)
        names = ", ".join(recording.samples.dtype.names or ())
        words = f"{len(recording.samples)} rows, {recording.meta['duration']:.4g} s, columns {names}"
        console.print(f"imported {path}: {words}")


def identify(
    method: Annotated[Method, typer.Argument(help="How.")], stage: StageArgument, captures: Captures, json: Json = None
) -> None:
    """Find inertia, viscous and Coulomb friction and offset of an axis from captures of its motion.

    Example: stagectl identify least-squares config/emps.yaml recordings/emps.h5 --json -
    """
    from stagectl.config.stage_file import load_stage
    from stagectl.identification.captures import identify as solve
    from stagectl.recording.imports import captures as opened

    setup = load_stage(stage)
    found = {"method": method.value, **solve([one for path in captures for one in opened(path, setup)], setup.file)}
    console.print(_parameters(found))
    for one in found["captures"]:
        share = f"force residual {one['force_residual_percent']:.3g} % of the force, taken from {one['current']}"
        console.print(f"{one['name']}: {one['rows']} rows; {share}")
    emit(found, json)


def _parameters(found: dict[str, Any]) -> Table:
    table = Table("parameter", "value", "95 % interval", "unit", title=f"{found['stage']}, {found['method']}")
    for name, one in found["parameters"].items():
        table.add_row(name, f"{one['value']:.6g}", f"{one['low']:.6g} to {one['high']:.6g}", one["unit"])
    return table
