"""The command `effects`: what the compensation of each effect is worth on the running service."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli.motion import Json, TrajectoryArgument
from stagectl.cli.service import Socket, uploaded
from stagectl.cli.show import console, emit, without_compiler
from stagectl.cli.show import progress as bar


def effects(
    trajectory: TrajectoryArgument,
    axis: Annotated[str, typer.Option("--axis", metavar="NAME", help="Which axis; default: the first one.")] = "",
    repeats: Annotated[int, typer.Option(min=2, max=1000, help="Number of runs of each variant.")] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Of the order of the runs.")] = 1,
    keep: Annotated[bool, typer.Option("--keep", help="Only measure; drop nothing.")] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="Where to put the recordings.")
    ] = None,
    socket: Socket = None,
    json: Json = None,
) -> None:
    """Run a motion on the service with and without each effect's compensation, and drop what makes the error grow.

    The runs are interleaved. A dropped effect is left to the feedback until the service ends; `control.unanswered` in
    the stage file keeps it so.

    Example: stagectl effects config/trajectories/sine-1.6hz.yaml
    """
    without_compiler()
    from stagectl.web.client import ask, default_socket
    from stagectl.workflows.effect_worth import Running, measured
    from stagectl.workflows.motion import unused
    from stagectl.workflows.trials import Shown

    place = socket or default_socket()
    known = list(ask(place, "GET", "/v1/effects"))
    running = Running(place, axis or known[0], uploaded(trajectory), output or unused(f"effects-{trajectory.stem}"))
    emit(measured(running, (repeats, seed), keep, Shown(console.print, bar)), json)
