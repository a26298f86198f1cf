"""Verbs that run one motion many times: learn, compare, effects."""

from pathlib import Path
from typing import Annotated

from stagectl.api.arguments import LAYERS, switched_off
from stagectl.cli import options
from stagectl.cli.motion import noted
from stagectl.cli.options import argument, option
from stagectl.cli.service import uploaded
from stagectl.cli.show import console, emit, progress, without_compiler, write_page
from stagectl.extras import require
from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError

Trials = Annotated[int, option("--trials", "Number of trials to learn from.", min=1, max=100)]


def learn(
    stage: options.StageArgument,
    trajectory: options.TrajectoryArgument,
    trials: Trials = 8,
    simulate: options.Simulate = False,
    plant: options.Plant = None,
    without: options.Without = None,
    output: Annotated[Path | None, option("--output -o FILE.h5", "Where to keep the learned current.")] = None,
    channel: options.Channel = None,
    json: options.Json = None,
) -> None:
    """Run a motion again and again, and learn the additional current that it needs; `run --learned FILE` then uses it.

    It starts from the layers of the stage file: with friction compensation it learns what the friction model does
    not cover; with `--without friction` it learns all of it.

    Example: stagectl learn config/ball-screw.yaml config/trajectories/sine-1.6hz.yaml --trials 8 --simulate
    """
    engine(simulate)
    import stagectl as sc
    from stagectl.api.comparison import machine_of
    from stagectl.compensation.forms import name_of
    from stagectl.workflows.motion import lay_out, unused
    from stagectl.workflows.trials import Shown, learn_into

    machine = machine_of(noted(stage, without).on_channel(channel), simulate, plant)
    compensator = name_of(machine.setup.file.compensation)
    folder = unused(f"learn-{trajectory.stem}")
    commanded = sc.load_trajectory(trajectory).bound(machine.setup)
    base = lay_out(machine.setup, commanded, switched_off(without or (), compensator), folder / "trial-1.h5")
    result = learn_into(machine, base, trials, Shown(console.print, progress), output or folder / "learned.h5")
    emit(result, json, not result["stopped"])


def compare(
    stage: options.StageArgument,
    trajectory: options.TrajectoryArgument,
    variants: Annotated[list[str], argument("VARIANT...", "off, ptc, ptc+friction, ptc+table, ptc+friction+ilc ...")],
    repeats: Annotated[int, option("--repeats", "Number of runs of each variant.", min=1, max=1000)] = 5,
    simulate: options.Simulate = False,
    plant: options.Plant = None,
    learned: Annotated[
        list[Path] | None, option("--learned FILE.h5", "Learned current for ilc, instead of learning first.")
    ] = None,
    trials: Trials = 8,
    seed: Annotated[int, option("--seed", "Seed of the order of the runs.", min=0)] = 1,
    output: Annotated[Path | None, option("--output -o FOLDER", "Where to put recordings and page.")] = None,
    channel: options.Channel = None,
    json: options.Json = None,
) -> None:
    """Run a motion with different layers, interleaved, and report which of them help, and how certain that is.

    A variant is `off` (feedback alone) or layers joined by +: ptc, friction, effects, observer, ilc.  Instead of
    friction, name a compensator of the stage file: model, table, gms, rheology, ...  The other variants are compared
    with the first one.  ilc is the learned current; it is learned first, unless --learned gives it.

    Example: stagectl compare config/ball-screw.yaml config/trajectories/sine-1.6hz.yaml off ptc ptc+friction --simulate
    """
    if not trajectory.exists() and set(str(trajectory).split("+")) <= {"off", "ilc", *LAYERS}:
        reason, remedy = f"{trajectory} is a variant", "the trajectory comes before it"
        raise StageError(Problem(reason, ProblemKind.FILE, remedy=remedy))
    require("report", "the page")
    engine(simulate)
    import stagectl as sc

    comparison = sc.compare(
        sc.load_stage(stage).on_channel(channel),
        sc.load_trajectory(trajectory),
        *variants,
        simulate=simulate,
        repeats=repeats,
        plant=plant,
        learned=learned or (),
        trials=trials,
        seed=seed,
        folder=output,
        progress=True,
        say=console.print,
    )
    for line in (*comparison.result["notes"], *comparison.verdict):
        console.print(line)
    written = write_page(comparison, comparison.folder / "report.html")
    emit({**comparison.to_json(), "report": str(written)}, json)


def engine(simulate: bool) -> None:
    """Compiled kernels where runs are simulated, else none in this process."""
    if not simulate:
        without_compiler()
        return
    from stagectl.kernels.jit import cold

    if cold():
        console.print("compiling the kernels, once for this version: up to a minute")


def effects(
    trajectory: options.TrajectoryArgument,
    axis: options.FirstAxis = "",
    repeats: Annotated[int, option("--repeats", "Number of runs of each variant.", min=2, max=1000)] = 5,
    seed: Annotated[int, option("--seed", "Seed of the order of the runs.", min=0)] = 1,
    keep: Annotated[bool, option("--keep", "Only measure; drop nothing.")] = False,
    output: options.Folder = None,
    socket: options.Socket = None,
    json: options.Json = None,
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
    emit(measured(running, (repeats, seed), keep, Shown(console.print, progress)), json)
