"""Verbs that move something: run, simulate, virtual-drive, demo."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from stagectl.cli.process import without_compiler
from stagectl.cli.show import console, emit, said, stream, summary, tell, typed
from stagectl.cli.show import progress as bar
from stagectl.units import StageError

StageArgument = Annotated[Path, typer.Argument(metavar="STAGE.yaml", help="The machine.")]
TrajectoryArgument = Annotated[Path, typer.Argument(metavar="TRAJECTORY.yaml", help="The motion.")]
Json = Annotated[str | None, typer.Option("--json", metavar="FILE", help="Result as JSON; - for standard output.")]
Lines = Annotated[
    str | None, typer.Option("--json", metavar="FILE", help="A line of JSON for each message; - for standard output.")
]
Without = Annotated[
    list[str] | None, typer.Option("--without", metavar="LAYER", help="Switch a layer off: ptc, friction, observer.")
]
Output = Annotated[Path | None, typer.Option("--output", "-o", metavar="FILE.h5", help="Where to record.")]
Learned = Annotated[
    Path | None, typer.Option(metavar="FILE.h5", help="Add the current that `stagectl learn` found for this motion.")
]
Twin = Annotated[
    bool, typer.Option("--twin", help="Run the model beside the axis, and tell how they differ; see `gap watch`.")
]
State = Annotated[
    Path | None, typer.Option("--state", metavar="FILE", help="Slow record of the twin, for `gap drift`.")
]
Channel = Annotated[str | None, typer.Option(help="Bus channel instead of the stage file's.")]
LAYERS = ("ptc", "friction", "observer")


def register(app: typer.Typer) -> None:
    """Add these verbs to the command line."""
    app.command("run")(run)
    app.command("simulate")(simulate)
    app.command("virtual-drive")(virtual_drive)
    app.command("demo")(demo)


def run(
    stage: StageArgument,
    trajectory: TrajectoryArgument,
    without: Without = None,
    json: Json = None,
    output: Output = None,
    channel: Channel = None,
    learned: Learned = None,
    twin: Twin = False,
    state: State = None,
) -> None:
    """Run a trajectory on the drive and record it.

    On the embedded bus a virtual drive is started where none answers.

    Example: stagectl run config/ball-screw.yaml config/trajectories/sine-1.6hz.yaml
    """
    without_compiler()
    from stagectl.workflows.motion import on_channel, perform, prepare

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a service's stop is an operator's
    setup = on_channel(_judged(stage), channel)
    motion = prepare(setup, trajectory, layers_without(without), output, learned)
    if twin or state:
        motion = _with_twin(motion, state)
    with bar(f"run {motion.meta['trajectory']}", len(motion.plan.setpoints)) as update:
        result = perform(motion, console.print, update)
    console.print(summary(result))
    console.print(f"recorded: {result['recording']}")
    emit({**result, **_seen(motion)}, json)
    if result["fault"]:
        console.print(f"when that is mended: {typed()}")
    if not result["in_position"]:
        raise typer.Exit(1)


def _with_twin(motion: Any, state: Path | None) -> Any:
    """The motion with a twin beside it."""
    from stagectl.twin.start import companion

    console.print("starting the twin: some seconds, and longer once for each version, while its kernels are compiled")
    return motion._replace(companion=companion(motion.setup, motion.law, motion.recording, state))


def _seen(motion: Any) -> dict[str, Any]:
    """What the twin saw, where there was one; its words are shown."""
    if motion.companion is None:
        return {}
    from stagectl.twin.start import live_file, load_snapshot

    path = live_file(motion.recording)
    if not path.exists():
        console.print("twin: it saw nothing of this run")
        return {"twin": None}
    found = load_snapshot(path)
    skipped = f"; {found['skipped_rows']} rows were skipped" if found["skipped_rows"] else ""
    console.print(f"twin: {found['words']}{skipped}")
    return {"twin": found}


def simulate(
    stage: StageArgument,
    trajectory: TrajectoryArgument,
    without: Without = None,
    json: Json = None,
    output: Output = None,
    plant: Annotated[
        Path | None, typer.Option(metavar="PLANT.yaml", help="The machine, where it is not as the model says.")
    ] = None,
    learned: Learned = None,
) -> None:
    """Run the same law on the stage model, compiled, faster than real time.

    Example: stagectl simulate config/ball-screw.yaml config/trajectories/sine-1.6hz.yaml --json -
    """
    from stagectl.kernels.jit import cold
    from stagectl.workflows.motion import prepare, pretend

    if cold():
        console.print("compiling the kernels, once for this version: up to a minute")
    motion = prepare(_judged(stage), trajectory, layers_without(without), output, learned)
    machine = _load(plant) if plant else None
    with console.status(f"simulating {len(motion.plan.setpoints) * motion.setup.dt:.4g} s of motion"):
        result = pretend(motion, machine)
    console.print(f"simulated: {summary(result)}")
    console.print(f"recorded: {result['recording']}")
    emit(result, json)
    if not result["in_position"]:
        raise typer.Exit(1)


def virtual_drive(
    stage: StageArgument,
    channel: Channel = None,
    seed: Annotated[
        int | None, typer.Option(min=0, max=2**31 - 1, help="Of its noise, instead of the stage file's.")
    ] = None,
    follow: Annotated[
        bool, typer.Option(hidden=True, help="Leave when the process that started this one dies.")
    ] = False,
    json: Lines = None,
) -> None:
    """Be a virtual CANopen drive, or ODrive, with the stage inside, until interrupted.

    Example: stagectl virtual-drive config/ball-screw.yaml
    """
    os.environ.setdefault("STAGECTL_KERNELS", "interpreted")  # compiled, its plant is lighter on the machine
    from stagectl.drives.drive import Odrive
    from stagectl.realtime.scheduling import follow_parent
    from stagectl.service.virtual_drive import serve, serve_odrive
    from stagectl.workflows.motion import canopen, on_channel

    if follow:
        follow_parent()
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopped.append(number))
    setup = on_channel(_load(stage), channel)
    if seed is not None:
        simulation = setup.file.simulation._replace(seed=seed)
        setup = setup._replace(file=setup.file._replace(simulation=simulation))
    wire = setup.file.drive.wire
    if isinstance(wire, Odrive):
        serve_odrive(setup, wire, _teller(json), lambda: bool(stopped))
    else:
        serve(setup, canopen(setup), _teller(json), lambda: bool(stopped))


def _teller(json: str | None) -> Callable[[str], None]:
    """What tells one line in words, as an event of `json`, or both."""
    write = stream(json)

    def told(words: str) -> None:
        write(said(words))
        if json != "-":
            tell(words)

    return told


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where to put it all.")] = Path(
        "demo"
    ),
    json: Json = None,
) -> None:
    """Move a virtual ball-screw stage over a CAN bus: three sines, with and without friction compensation.

    Example: stagectl demo -o demo
    """
    without_compiler()
    from stagectl.workflows.demo import demo as show

    found = show(output, console.print, bar)
    console.print(f"report: {found['report']}")
    console.print("live, in a browser: `make live`, or `stagectl serve config/ball-screw.yaml`")
    emit(found, json)


def layers_without(without: list[str] | None) -> frozenset[str]:
    """The layers that the user switches off.

    Raises StageError where there is no such layer.
    """
    for layer in without or ():
        if layer not in LAYERS:
            raise StageError(f"--without {layer}; must be one of {', '.join(LAYERS)}")
    return frozenset(without or ())


def _judged(path: Path) -> Any:
    """The stage, whose user is told where its loop would not stand still."""
    from stagectl import design

    setup = _load(path)
    if restless := design.unrest(setup.stage, setup.file.control):
        console.print(f"note: {restless}")
    return setup


def _load(path: Path) -> Any:
    from stagectl.config.stage_file import load_stage

    return load_stage(path)
