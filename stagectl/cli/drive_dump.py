"""The command `drive dump`: all settings of a drive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from stagectl.cli.motion import Channel, Json, StageArgument
from stagectl.cli.process import without_compiler
from stagectl.cli.show import console, emit, progress

Anyway = Annotated[
    bool, typer.Option("--anyway", help="Read although another master controls the bus; it may disturb that one.")
]


def dump(
    stage: StageArgument,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE.dcf", help="Write a DCF, which other tools can write back."),
    ] = None,
    changed: Annotated[
        bool, typer.Option("--changed", help="Only values that differ from the factory settings.")
    ] = False,
    channel: Channel = None,
    anyway: Anyway = False,
    json: Json = None,
) -> None:
    """Read all objects of the drive that its EDS lists; changes nothing.

    Example: stagectl drive dump config/ball-screw.yaml -o drive.dcf
    """
    without_compiler()
    from stagectl.config.stage_file import load_stage
    from stagectl.drives.canopen.dump import dump as read
    from stagectl.drives.canopen.dump import write_dcf
    from stagectl.workflows.motion import line_of, on_channel

    setup = on_channel(load_stage(stage, designed=False), channel)
    with line_of(setup, console.print, anyway) as (wire, line), progress(f"node {wire.node}", 1) as update:
        objects = read(wire, line, update)
    for entry in objects:
        if not changed or entry.changed:
            print(_line(entry))
    refused = [entry for entry in objects if entry.value is None]
    console.print(
        f"{len(objects) - len(refused)} objects of node {wire.node} read, {len(refused)} refused, "
        f"{sum(entry.changed for entry in objects)} not as the EDS' defaults"
    )
    if output is not None:
        write_dcf(objects, wire.eds, wire.node, output)
        console.print(f"wrote {output}")
    emit({"node": wire.node, "objects": [_as_json(entry) for entry in objects]}, json)


def _as_json(entry: Any) -> dict[str, Any]:
    fields = entry._asdict()
    return {"index": fields.pop("number"), **fields, "changed": entry.changed}  # a NamedTuple's own `index` is a method


def _line(entry: Any) -> str:
    value = entry.problem if entry.value is None else entry.value
    number = f" (0x{entry.value:X})" if isinstance(entry.value, int) and entry.value > 9 else ""
    default = f", factory {entry.default}" if entry.changed else ""
    return f"{entry.number:04X}_{entry.subindex:02X}  {entry.name}: {value}{number}{default}"
