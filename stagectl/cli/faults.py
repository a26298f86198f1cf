"""Commands about faults: inject, selftest."""

import contextlib
from pathlib import Path
from typing import Annotated, Any

from stagectl.api.arguments import quantity
from stagectl.cli.options import Channel, Json, StageArgument, amperes, argument, option, replacing
from stagectl.cli.show import console, emit, progress, typed, typed_files, without_compiler
from stagectl.extras import require
from stagectl.problem import Problem, ProblemKind
from stagectl.replacing import PAGE
from stagectl.units import Quantity, StageError


def inject(
    stage: Annotated[Path | None, argument("STAGE.yaml", "The machine.")] = None,
    fault: Annotated[str | None, argument("[FAULT]", "Name of the fault, see --list.")] = None,
    parameters: Annotated[list[str] | None, argument("KEY=VALUE...", "Its parameters.")] = None,
    channel: Channel = None,
    clear: Annotated[bool, option("--clear", "End all faults.")] = False,
    show: Annotated[bool, option("--list", "Show all faults with their parameters.")] = False,
    json: Json = None,
) -> None:
    """Inject a fault into a running virtual drive.

    Example: stagectl inject config/ball-screw.yaml encoder-stuck duration=0.5s
    """
    without_compiler()
    if show:
        _show(json)
        return
    from stagectl.config.fault_words import read_fault
    from stagectl.config.stage_file import canopen, load_stage, on_channel
    from stagectl.drives.faults import FAULT_TYPES
    from stagectl.drives.virtual.inject import ask, check_stage, socket_path

    if str(stage) in FAULT_TYPES:
        raise StageError(Problem(f"{stage} is a fault", ProblemKind.FILE, remedy="the stage file comes first"))
    if stage is None or clear == (fault is not None):
        raise StageError("give STAGE.yaml, and either the name of a fault (see --list) or --clear")
    setup = on_channel(load_stage(stage, designed=False), channel)
    wire = canopen(setup)
    place = socket_path(wire.interface, wire.channel, wire.node)
    block = read_fault(fault, parameters or []) if fault else None
    request = {"do": "add", "fault": block._asdict()} if block else {"do": "clear"}
    check_stage(place, setup.file.name)
    answer = ask(place, request)
    active = ", ".join(answer["active"]) or "none"
    console.print(f"node {wire.node} on {wire.interface} {wire.channel}: faults that act: {active}")
    emit(answer, json)


def selftest(
    stage: StageArgument,
    json: Json = None,
    report: Annotated[
        Path | None, option("--report FILE.html", "Write the table as a page to sign.", callback=replacing(PAGE))
    ] = None,
    only: Annotated[list[str] | None, option("--only FAULT", "These faults only.")] = None,
    signed: Annotated[str, option("--signed NAME", "Name of the person who signs.")] = "",
    current: Annotated[
        str | None, option("--current", "Test the real drive, which moves, with at most this current, e.g. '2 A'.")
    ] = None,
    travel: Annotated[str, option("--travel", "Distance of one move of the real drive.")] = "5 mm",
) -> None:
    """Try each fault in each state, in virtual time; exit 1 if one does not end as required.

    Example: stagectl selftest config/ball-screw.yaml --report selftest.html
    """
    without_compiler()
    if report is not None:
        require("report", "--report")
    from stagectl.config.stage_file import canopen, load_stage
    from stagectl.selftest import matrix, remote
    from stagectl.workflows.motion import drive_present

    setup = load_stage(stage)
    canopen(setup)  # refuses any other wire
    gentle = _gentle(setup, current, travel)
    with drive_present(setup, console.print) if gentle else contextlib.nullcontext():
        tried = remote.bench(setup, only, gentle)
        with progress("selftest", len(tried.rows) * len(tried.states)) as update:
            estimate = matrix.run(setup, tried, signed, typed(), update)
    _show_result(estimate, report)
    emit(estimate, json, estimate["passed"] == len(estimate["faults"]))


def _gentle(setup: Any, current: str | None, travel: str) -> Any:
    """Current and travel (axis units) for a test of the real drive; None without a current."""
    from stagectl.selftest.remote import Gentle

    axis, most = setup.file.axis, amperes("current", current)
    declared = Quantity(axis.travel_unit, "[-inf, inf]", "distance of one move")
    way = quantity("travel", travel, declared, f"it such as '5 m{axis.travel_unit}'")
    return None if most is None else Gentle(most, way / axis.travel_per_unit)


def _show_result(result: dict[str, Any], report: Path | None) -> None:
    console.print(result["words"])
    for case in result["faults"]:
        if not case["passed"]:
            console.print(f"not passed: {case['name']} while {case['state']}: {case['words']}")
    if report is not None:
        from stagectl.report.selftest import page

        console.print(f"report: {page(result, report, typed_files())}")


def _show(json: str | None) -> None:
    from stagectl.report.selftest import faults

    rows = list(faults())
    for row in rows if json != "-" else ():
        print(f"{row['fault']}: {row['what happens']} ({row['component']}; {row['stop']})\n    {row['parameters']}")
    emit({"faults": rows}, json)
