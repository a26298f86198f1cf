"""The command `gap close`: from a machine to a controller that answers what its model lacked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli.comparison import Simulate, engine
from stagectl.cli.motion import Channel, Json, Plant, StageArgument
from stagectl.cli.show import console, deliver
from stagectl.extras import require


def close(
    stage: StageArgument,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FOLDER", help="Folder for all of it; an existing one is continued."),
    ] = None,
    rounds: Annotated[int, typer.Option(min=1, max=10, help="At most so many rounds.")] = 3,
    simulate: Simulate = False,
    plant: Plant = None,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1, help="Seed of noise and order.")] = 1,
    channel: Channel = None,
    json: Json = None,
) -> None:
    """Record, diagnose, apply and compare on the machine, again until the tracking error shrinks no more.

    STAGE.yaml stays as it is. Each model stands in FOLDER: stage-0.yaml is the one you began with.

    Example: stagectl gap close config/ball-screw.yaml --simulate --plant machine.yaml
    """
    require("report", "the page")
    engine(simulate)
    import stagectl as sc
    from stagectl.api.gap_closing import close_gap

    closed = close_gap(
        sc.load_stage(stage).on_channel(channel),
        simulate=simulate,
        plant=plant,
        rounds=rounds,
        folder=output,
        seed=seed,
        progress=True,
        say=console.print,
    )
    deliver(closed, Path(closed.result["folder"]) / "closed.html", json)
