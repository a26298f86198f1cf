"""The command `drive dump`: all settings of a drive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from stagectl.cli.motion import Channel, Json, StageArgument
from stagectl.cli.process import without_compiler
from stagectl.cli.show import console, emit, progress


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
    with line_of(setup, console.print) as (wire, line), progress(f"node {wire.node}", 1) as update:
        found = read(wire, line, update)
    for one in found:
        if not changed or one.changed:
            print(_line(one))
    refused = [one for one in found if one.value is None]
    console.print(
        f"{len(found) - len(refused)} objects of node {wire.node} read, {len(refused)} refused, "
        f"{sum(one.changed for one in found)} not as the EDS' defaults"
    )
    if output is not None:
        write_dcf(found, wire.eds, wire.node, output)
        console.print(f"wrote {output}")
    emit({"node": wire.node, "objects": [_as_json(one) for one in found]}, json)


def _as_json(one: Any) -> dict[str, Any]:
    told = one._asdict()
    return {"index": told.pop("number"), **told, "changed": one.changed}  # a NamedTuple's own `index` is a method


def _line(one: Any) -> str:
    said = one.problem if one.value is None else one.value
    number = f" (0x{one.value:X})" if isinstance(one.value, int) and one.value > 9 else ""
    default = f", factory {one.default}" if one.changed else ""
    return f"{one.number:04X}_{one.subindex:02X}  {one.name}: {said}{number}{default}"
