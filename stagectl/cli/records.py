"""Verbs over recordings: export, import, replay, identify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli.motion import Json
from stagectl.cli.show import console, emit

RecordingArgument = Annotated[Path, typer.Argument(metavar="RECORDING.h5", help="A recording.")]


def register(app: typer.Typer) -> None:
    """Add these verbs to the command line."""
    app.command("replay")(replay)


def replay(recording: RecordingArgument, json: Json = None) -> None:
    """Run the recorded feedback through the same law: the same commands, bit for bit, or exit 1."""
    from stagectl.recording.hdf5 import open_recording
    from stagectl.recording.replay import replay as again

    found = again(open_recording(recording))
    console.print(found["words"])
    emit(found, json)
    if not found["identical"]:
        raise typer.Exit(1)
