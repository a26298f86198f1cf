"""The command group `gap`, with the commands that move a machine: record and close."""

from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli import gap_apply, gap_diagnose, gap_twin
from stagectl.cli.comparison import engine
from stagectl.cli.options import Channel, Json, Plant, Simulate, StageArgument, option
from stagectl.cli.show import console, deliver, emit, progress
from stagectl.cli.studies import add
from stagectl.extras import require
from stagectl.named_values import names_of

gap = typer.Typer(
    help="Where simulator and machine differ, what causes it, how far the gap closes.", no_args_is_help=True
)
for name, verb in (
    ("diagnose", gap_diagnose.diagnose),
    ("apply", gap_apply.apply),
    ("next", gap_apply.following),
    ("watch", gap_twin.watch),
    ("drift", gap_twin.drift),
):
    gap.command(name)(verb)
for name in ("knock", "fleet", "exam"):
    add(gap, name)


@gap.command()
def record(
    stage: StageArgument,
    output: Annotated[
        Path | None, option("--output -o FOLDER", "Folder for the recordings; an existing one is continued.")
    ] = None,
    repeats: Annotated[
        int, option("--repeats", "Repeats of each experiment; the held-out ones take two.", min=1, max=100)
    ] = 3,
    only: Annotated[list[str] | None, option("--only NAMES", "Only these experiments, separated by commas.")] = None,
    skip: Annotated[list[str] | None, option("--skip NAMES", "All but these experiments, separated by commas.")] = None,
    simulate: Simulate = False,
    plant: Plant = None,
    seed: Annotated[
        int | None,
        option("--seed", "Seed of the noise; default: from the simulated machine's file.", min=0, max=2**31 - 1),
    ] = None,
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
    result = many.record(campaign, Shown(console.print, progress))
    if repeats == 1:
        console.print("one repeat only: chance variation cannot be separated from the gap; use --repeats 3")
    if not result["stopped"]:
        console.print(f"recorded: {folder}; next: stagectl gap diagnose {folder}")
    emit(result, json, not result["stopped"])


@gap.command()
def close(
    stage: StageArgument,
    output: Annotated[
        Path | None, option("--output -o FOLDER", "Folder for all of it; an existing one is continued.")
    ] = None,
    rounds: Annotated[int, option("--rounds", "At most so many rounds.", min=1, max=10)] = 3,
    simulate: Simulate = False,
    plant: Plant = None,
    seed: Annotated[int, option("--seed", "Seed of noise and order.", min=0, max=2**31 - 1)] = 1,
    write: Annotated[bool, option("--write", "Put the model into STAGE.yaml; --back undoes it.")] = False,
    back: Annotated[bool, option("--back", "Only restore the previous version of STAGE.yaml.")] = False,
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
