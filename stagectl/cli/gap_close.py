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
    write: Annotated[bool, typer.Option("--write", help="Put the model into STAGE.yaml; --back undoes it.")] = False,
    back: Annotated[bool, typer.Option("--back", help="Only put the version of STAGE.yaml before it back.")] = False,
    channel: Channel = None,
    json: Json = None,
) -> None:
    """Record, diagnose, apply and compare on the machine, again until the tracking error shrinks no more.

    Each model stands in FOLDER: stage-0.yaml is the one you began with. STAGE.yaml stays as it is without --write.

    Example: stagectl gap close config/ball-screw.yaml --simulate --plant machine.yaml
    """
    from stagectl.workflows import stage_versions

    if back:
        console.print(f"{stage} is what it was; that version stood in {stage_versions.back(stage)}")
        return
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
    page = Path(closed.result["folder"]) / "closed.html"
    deliver(closed, page, json)
    if write and closed.result["rounds"]:
        kept = stage_versions.replaced(stage, closed.model.read_text(encoding="utf-8"), [page])
        console.print(f"wrote {stage}; what it was stands in {kept}: `stagectl gap close {stage} --back`")
