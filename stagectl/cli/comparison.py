"""Verbs that run one motion many times: learn, compare."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Annotated, Any

import typer

from stagectl.cli.motion import LAYERS, Channel, Json, StageArgument, TrajectoryArgument, Without, layers_without
from stagectl.cli.process import without_compiler
from stagectl.cli.show import console, emit, typed, typed_files
from stagectl.cli.show import progress as bar
from stagectl.extras import require
from stagectl.units import StageError

Simulate = Annotated[bool, typer.Option("--simulate", help="On the stage model, compiled, instead of the drive.")]
Plant = Annotated[
    Path | None, typer.Option(metavar="PLANT.yaml", help="With --simulate: the machine, where it is not the model.")
]
Trials = Annotated[int, typer.Option(min=1, max=100, help="Number of trials to learn from.")]


def register(app: typer.Typer) -> None:
    """Add these verbs to the command line."""
    app.command("learn")(learn)
    app.command("compare")(compare)


def learn(
    stage: StageArgument,
    trajectory: TrajectoryArgument,
    trials: Trials = 8,
    simulate: Simulate = False,
    plant: Plant = None,
    without: Without = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.h5", help="Where to keep the learned current.")
    ] = None,
    channel: Channel = None,
    json: Json = None,
) -> None:
    """Run a motion again and again, and learn the current that it lacks; `run --learned FILE` then uses it.

    It starts from the layers of the stage file: with friction compensation it learns what the friction model leaves
    over; `--without friction` learns from nothing.

    Example: stagectl learn config/ball-screw.yaml config/trajectories/sine-1.6hz.yaml --trials 8 --simulate
    """
    engine(simulate)
    from stagectl.recording import learned_current
    from stagectl.workflows import trials as many
    from stagectl.workflows.motion import prepare

    machine = machine_of(stage, simulate, plant, channel)
    folder = many.fresh_folder(f"learn-{trajectory.stem}")
    base = prepare(machine.setup, trajectory, layers_without(without), folder / "trial-1.h5")
    path = output or folder / "learned.h5"
    learned_current.claim(path)
    found = many.learn(machine, base, trials, many.Shown(console.print, bar), folder)
    learned_current.save(path, found.pop("current"))
    for line in many.convergence_words(found):
        console.print(line)
    console.print(many.learned_words(found))
    console.print(f"learned: {path}")
    emit({**found, "learned": str(path), "simulated": simulate}, json)
    if found["stopped"]:
        raise typer.Exit(1)


def compare(
    stage: StageArgument,
    trajectory: TrajectoryArgument,
    variants: Annotated[
        list[str],
        typer.Argument(metavar="VARIANT...", help="off, ptc, ptc+friction, ptc+friction+ilc, ptc+observer ..."),
    ],
    repeats: Annotated[int, typer.Option(min=1, max=1000, help="Number of runs of each variant.")] = 5,
    simulate: Simulate = False,
    plant: Plant = None,
    learned: Annotated[
        list[Path] | None, typer.Option(metavar="FILE.h5", help="Learned current for ilc, instead of learning first.")
    ] = None,
    trials: Trials = 8,
    seed: Annotated[int, typer.Option(min=0, help="Of the order of the runs.")] = 1,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="Where to put recordings and page.")
    ] = None,
    channel: Channel = None,
    json: Json = None,
) -> None:
    """Run a motion with different layers, interleaved, and say which of them help, and how certain that is.

    A variant is `off` (feedback alone) or layers joined by +: ptc, friction, observer, ilc.  The first variant is what
    the others are compared with.  What ilc needs is learned first, unless --learned gives it.

    Example: stagectl compare config/ball-screw.yaml config/trajectories/sine-1.6hz.yaml off ptc ptc+friction --simulate
    """
    require("report", "the page")
    engine(simulate)
    from stagectl.report.comparison import page
    from stagectl.report.page import write
    from stagectl.workflows import layer_comparison as many
    from stagectl.workflows.trials import Shown, fresh_folder

    machine = machine_of(stage, simulate, plant, channel)
    folder, shown = output or fresh_folder(f"compare-{trajectory.stem}"), Shown(console.print, bar)
    asked = many.Asked(trajectory, variants, LAYERS, trials, learned or [])
    ready, courses = many.variants(machine, asked, shown, folder)
    found = many.compare(machine, ready, (repeats, seed), shown, folder)
    found |= {"simulated": simulate, "seed": seed, "learned": courses, "notes": many.course_words(courses)}
    for line in (*found["notes"], *found["verdict"]):
        console.print(line)
    written = write(page(found, [typed()]), folder / "report.html", typed_files())
    console.print(f"report: {written}")
    emit({**found, "report": str(written)}, json)


def engine(simulate: bool) -> None:
    """Compiled kernels where runs are simulated, else none in this process."""
    if not simulate:
        without_compiler()
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # a service's stop is an operator's
        return
    from stagectl.kernels.jit import cold

    if cold():
        console.print("compiling the kernels, once for this version: up to a minute")


def machine_of(stage: Path, simulate: bool, plant: Path | None, channel: str | None) -> Any:
    """Where the runs take place.

    Raises StageError for a plant beside a drive.
    """
    from stagectl.config.stage_file import load_stage
    from stagectl.workflows.motion import on_channel
    from stagectl.workflows.trials import Machine

    if plant is not None and not simulate:
        raise StageError(f"--plant {plant} without --simulate: a drive has its own machine; add --simulate")
    setup = on_channel(load_stage(stage), channel)
    return Machine(setup, simulate, load_stage(plant) if plant else None)
