"""Verbs that move something: run, simulate, virtual-drive, demo."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from stagectl.cli import options
from stagectl.cli.options import option
from stagectl.cli.show import console, emit, reporter, single_threaded_algebra, summary, tell, typed, without_compiler
from stagectl.extras import require

if TYPE_CHECKING:
    from stagectl.api.stage import DesignedStage


Output = Annotated[Path | None, option("--output -o FILE.h5", "Where to record.")]
Learned = Annotated[
    Path | None, option("--learned FILE.h5", "Add the current that `stagectl learn` found for this motion.")
]
# Rows of a motion that kernels go through interpreted, in the time that it takes to load them, or to compile them.
_UNLOADED, _UNCOMPILED = 40_000, 200_000


def run(
    stage: options.StageArgument,
    trajectory: options.TrajectoryArgument,
    without: options.Without = None,
    json: options.Json = None,
    output: Output = None,
    channel: options.Channel = None,
    learned: Learned = None,
    twin: Annotated[
        bool, option("--twin", "Run the model next to the axis and report how they differ; see `gap watch`.")
    ] = False,
    state: Annotated[Path | None, option("--state FILE", "Slow record of the twin, for `gap drift`.")] = None,
    reset_fault: Annotated[
        bool, option("--reset-fault", "Reset the drive's fault first. See what caused it before you do.")
    ] = False,
) -> None:
    """Run a trajectory on the drive and record it.

    On the embedded bus a virtual drive is started where none answers.

    Example: stagectl run config/ball-screw.yaml config/trajectories/sine-1.6hz.yaml
    """
    single_threaded_algebra()
    import stagectl as sc
    from stagectl.kernels.jit import interpret_first

    interpret_first(_UNLOADED)  # a plain motion needs no compiler in memory; the inverse of a whole model does
    result = sc.run(
        noted(stage, without).on_channel(channel),
        sc.load_trajectory(trajectory),
        recording=output,
        without=without or (),
        learned=learned,
        twin=twin,
        twin_record=state,
        reset_fault=reset_fault,
        progress=True,
        say=console.print,
    ).summary
    if not result["interrupted"]:
        console.print(summary(result))
        if result["cycles"] > result["lost_rows"]:  # else the file holds nothing
            console.print(f"recorded: {result['recording']}")
        if result["fault"]:
            console.print(f"next, once that is fixed: {typed()}")
    emit(result, json, result["in_position"] and not result["lost_rows"])  # half a recording must not pass for one


def simulate(
    stage: options.StageArgument,
    trajectory: options.TrajectoryArgument,
    without: options.Without = None,
    json: options.Json = None,
    output: Output = None,
    plant: options.Plant = None,
    learned: Learned = None,
) -> None:
    """Run the same law on the stage model, compiled, faster than real time.

    Example: stagectl simulate config/ball-screw.yaml config/trajectories/sine-1.6hz.yaml --json -
    """
    single_threaded_algebra()  # for the margins alone: other threads would only wait, a third of a second each
    import stagectl as sc
    from stagectl.kernels.jit import cold, interpret_first

    most = _UNCOMPILED if cold("rollout.closed_loop") else _UNLOADED
    interpret_first(most)
    designed, motion = noted(stage, without), sc.load_trajectory(trajectory)
    if most == _UNCOMPILED and motion.duration(designed) > most * designed.period:
        console.print("compiling the kernels, once for this version: up to a minute")
    run = sc.simulate(designed, motion, plant=plant, without=without or (), learned=learned)
    written = run.save(output)
    result = {**run.summary, "recording": str(written)}
    for note in run.notes:
        console.print(f"note: {note}")
    console.print(f"simulated: {summary(result)}")
    console.print(f"recorded: {written}")
    emit(result, json, result["in_position"])


def virtual_drive(
    stage: options.StageArgument,
    channel: options.Channel = None,
    seed: Annotated[
        int | None, option("--seed", "Seed of its noise, instead of the stage file's.", min=0, max=2**31 - 1)
    ] = None,
    machine_of_the_day: options.MachineOfTheDay = 0,
    reveal: Annotated[bool, option("--reveal", "Say what was drawn for the machine of the day.")] = False,
    follow: Annotated[
        bool, option("--follow/--no-follow", "End when the process that started this one dies.", hidden=True)
    ] = False,
    json: options.Lines = None,
) -> None:
    """Run a virtual drive, CANopen or ODrive, that contains the stage model, until Ctrl-C.

    Example: stagectl virtual-drive config/ball-screw.yaml
    """
    os.environ.setdefault("STAGECTL_KERNELS", "interpreted")  # compiled, its plant is lighter on the machine
    from stagectl.config.stage_file import canopen, load_stage, on_channel, with_machine_of_the_day
    from stagectl.drives.drive import Odrive
    from stagectl.realtime.scheduling import follow_parent
    from stagectl.service.shutdown_signals import heard
    from stagectl.service.virtual_drive import serve, serve_odrive
    from stagectl.workflows.motion import reseeded

    if follow:
        follow_parent()
    stopped: list[int] = []
    for number in heard():
        signal.signal(number, lambda number, _: stopped.append(number))
    setup = on_channel(load_stage(stage), channel)
    if seed is not None:
        setup = reseeded(setup, seed)
    if machine := machine_of_the_day or setup.file.virtual_drive.machine_of_the_day:
        from stagectl.workflows.machine_of_the_day import drawn

        setup, hidden = drawn(with_machine_of_the_day(setup, machine), machine)
        if reveal:
            console.print("\n  ".join([f"machine of the day {machine}:", *hidden.lines]), markup=False)
    wire, report = setup.file.drive.wire, reporter(json, (lambda _: None) if json == "-" else tell)
    if isinstance(wire, Odrive):
        serve_odrive(setup, wire, report, lambda: bool(stopped))
    else:
        serve(setup, canopen(setup), report, lambda: bool(stopped))


def demo(
    output: Annotated[Path, option("--output -o FOLDER", "Folder for the recordings and the page.")] = Path("demo"),
    json: options.Json = None,
) -> None:
    """Move a virtual ball-screw stage over a CAN bus: three sines, with and without friction compensation.

    Example: stagectl demo -o demo
    """
    without_compiler()
    require("report", "the demo's page")
    from stagectl.api.demo import demo as show

    result = show(output, True, console.print)
    console.print(f"report: {result['report']}")
    console.print("live, in a browser: `make live`, or `stagectl serve config/ball-screw.yaml`")
    emit(result, json)


def noted(path: Path, without: list[str] | None) -> DesignedStage:
    """The stage; notes say that its loop would not come to rest, and what `without` names and it does not have."""
    import stagectl as sc

    stage = sc.load_stage(path)
    if stage.unrest:
        console.print(f"note: {stage.unrest}")
    if without:
        from stagectl.gap.effects.library import absent

        for name in absent(stage.setup.stage, without):
            console.print(f"note: --without {name} changes nothing: the model in {path} has none")
    return stage
