"""The command `commission`: from a drive on the table to a compensated axis, step by step."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli.comparison import Simulate
from stagectl.cli.drive_accept import agreed
from stagectl.cli.motion import Channel, Json, MachineOfTheDay, StageArgument
from stagectl.cli.show import console, emit
from stagectl.extras import require
from stagectl.units import StageError


def commission(
    stage: StageArgument,
    person: Annotated[str, typer.Option(metavar="NAME", help="Who lets each step happen, and signs.")] = "",
    yes: Annotated[bool, typer.Option("--yes", help="Ask nobody; on a virtual drive or a model only.")] = False,
    again: Annotated[str, typer.Option(metavar="STEP", help="Do this step and those after it once more.")] = "",
    simulate: Simulate = False,
    machine_of_the_day: MachineOfTheDay = 0,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1, help="Seed of noise and order.")] = 1,
    channel: Channel = None,
    json: Json = None,
) -> None:
    """Commission an axis: probe, accept, identify, tune, compensate, close the gap, compare.

    Each step asks before it moves, and shows its page. The stage file changes with it: `gap close --back` goes back.
    What is done stands in STAGE.commission.json; the same command goes on after it.

    Example: stagectl commission my-stage.yaml --yes --person "A. Turing" --machine-of-the-day 7
    """
    require("report", "the pages")
    from stagectl.api.commission import Commissioning
    from stagectl.api.commission import commission as perform
    from stagectl.config.stage_file import load_stage
    from stagectl.workflows.acceptance.protocol import virtual

    is_virtual = simulate or virtual(load_stage(stage, designed=False))
    if (yes or machine_of_the_day) and not is_virtual:
        raise StageError("--yes and --machine-of-the-day are for a virtual drive: a person must let each step happen")
    going = Commissioning(
        path=Path(stage),
        simulated=simulate,
        person=person,
        seed=seed,
        machine=machine_of_the_day,
        channel=channel,
        progress=True,
        say=console.print,
        go_ahead=lambda name, words: agreed(name, words, yes),
    )
    result = perform(going, again)
    console.print(
        f"commissioned: {result['steps']['compare']['words']}; {result['machine_time']:.0f} s of machine time"
    )
    emit(result, json)
