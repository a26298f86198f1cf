"""The command group `gap`, with the commands that move a machine: record and close."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli import gap_apply, gap_diagnose, gap_next, gap_twin
from stagectl.cli.comparison import Simulate, engine
from stagectl.cli.motion import Channel, Json, Plant, StageArgument
from stagectl.cli.show import console, deliver, emit
from stagectl.cli.show import progress as bar
from stagectl.cli.studies import add
from stagectl.extras import require
from stagectl.named_values import names_of

Folder = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FOLDER", help="Folder for the recordings; an existing one is continued."),
]
Repeats = Annotated[int, typer.Option(min=1, max=100, help="Repeats of each experiment; the held-out ones take two.")]
Only = Annotated[list[str] | None, typer.Option(metavar="NAMES", help="Only these experiments, separated by commas.")]
Skip = Annotated[
    list[str] | None, typer.Option(metavar="NAMES", help="All but these experiments, separated by commas.")
]
Seed = Annotated[
    int | None,
    typer.Option(min=0, max=2**31 - 1, help="Seed of the noise; default: from the simulated machine's file."),
]

gap = typer.Typer(
    help="Where simulator and machine differ, what causes it, how far the gap closes.", no_args_is_help=True
)
for name, verb in (
    ("diagnose", gap_diagnose.diagnose),
    ("apply", gap_apply.apply),
    ("next", gap_next.following),
    ("watch", gap_twin.watch),
    ("drift", gap_twin.drift),
):
    gap.command(name)(verb)
for name in ("knock", "fleet", "exam"):
    add(gap, name)


@gap.command()
def record(
    stage: StageArgument,
    output: Folder = None,
    repeats: Repeats = 3,
    only: Only = None,
    skip: Skip = None,
    simulate: Simulate = False,
    plant: Plant = None,
    seed: Seed = None,
    channel: Channel = None,
    json: Json = None,
) -> None:
    """Record the recommended and the held-out experiments for `gap diagnose`, repeats interleaved.

    A fault or Ctrl-C keeps what has been recorded; the same command with the same folder continues.

    Example: stagectl gap record config/ball-screw.yaml --simulate
    """
    engine(simulate)
    import stagectl as sc
    from stagectl.api.comparison import machine_of
    from stagectl.gap.experiment_design.battery import battery, held_out
    from stagectl.workflows import campaign as many
    from stagectl.workflows.motion import unused
    from stagectl.workflows.trials import Shown

    machine = machine_of(sc.load_stage(stage).on_channel(channel), simulate, plant)
    experiments = many.chosen((*battery(machine.setup), *held_out(machine.setup)), names_of(only), names_of(skip))
    folder = output or unused(f"gap-{stage.stem}")
    chosen_seed = (machine.plant or machine.setup).file.simulation.seed if seed is None else seed
    campaign = many.planned(machine, experiments, repeats, folder, chosen_seed)
    runs, took = len(campaign.runs), sum(run.experiment.duration for run in campaign.runs)
    console.print(f"{runs} runs of {len(experiments)} experiments, {took / 60.0:.1f} min of motion, to {folder}")
    result = many.record(campaign, Shown(console.print, bar))
    if repeats == 1:
        console.print("one repeat only: chance variation cannot be separated from the gap; use --repeats 3")
    if not result["stopped"]:
        console.print(f"recorded: {folder}; next: stagectl gap diagnose {folder}")
    emit(result, json, not result["stopped"])


@gap.command()
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
