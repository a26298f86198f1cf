"""Commands about one drive: probe, presets, dump, accept, verify."""

from pathlib import Path
from typing import Annotated, Any

import typer

from stagectl.cli import commission
from stagectl.cli.options import Channel, Json, StageArgument, amperes, option
from stagectl.cli.show import console, emit, progress, without_compiler
from stagectl.units import StageError

Anyway = Annotated[bool, option("--anyway", "Read although another master controls the bus; it may disturb that one.")]
drive = typer.Typer(
    help="Read a drive, propose lines for the stage file, accept it before its first motion.", no_args_is_help=True
)


@drive.command()
def dump(
    stage: StageArgument,
    output: Annotated[
        Path | None, option("--output -o FILE.dcf", "Write a DCF, which other tools can write back.")
    ] = None,
    changed: Annotated[bool, option("--changed", "Only values that differ from the factory settings.")] = False,
    channel: Channel = None,
    anyway: Anyway = False,
    json: Json = None,
) -> None:
    """Read all objects of the drive that its EDS lists; changes nothing.

    Example: stagectl drive dump config/ball-screw.yaml -o drive.dcf
    """
    without_compiler()
    from stagectl.config.stage_file import load_stage, on_channel
    from stagectl.drives.canopen.dump import check_dcf, write_dcf
    from stagectl.drives.canopen.dump import dump as read
    from stagectl.workflows.motion import line_of

    if output is not None:
        check_dcf(output)
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


drive.command("accept")(commission.accept)
drive.command("verify")(commission.verify)


@drive.command()
def probe(
    stage: StageArgument,
    channel: Channel = None,
    preset: Annotated[str | None, option("--preset NAME", "Family of the drive; default: by its vendor id.")] = None,
    rated: Annotated[
        str | None, option("--rated CURRENT", "Rated current, e.g. '4 A', if the drive does not report it.")
    ] = None,
    write: Annotated[bool, option("--write", "Put the proposal into the stage file.")] = False,
    anyway: Anyway = False,
    json: Json = None,
) -> None:
    """Read identity, state, modes, rated current and option codes of a drive; changes nothing.

    Exit 1 where something needs your attention before the axis may move.

    Example: stagectl drive probe config/ball-screw.yaml
    """
    without_compiler()
    from stagectl.config.stage_file import load_stage, on_channel
    from stagectl.config.time_outs import axis_limits
    from stagectl.drives.canopen.probe import probe as ask
    from stagectl.workflows.motion import line_of

    setup = on_channel(load_stage(stage, designed=False), channel)
    with line_of(setup, console.print, anyway) as (wire, line):
        answers = ask(wire, line, _chosen(preset), amperes("rated", rated), limits=axis_limits(setup.file))
    _show(answers, proposed=not write)
    changed = [str(change) for change in _written(stage, answers.values)] if write and answers.values else []
    for change in changed:
        console.print(f"written: {change}")
    if write and not changed:
        known = "it holds all of this" if answers.values else "there is nothing to write"
        console.print(f"{stage}: {known}; nothing has changed")
    emit({**answers._asdict(), "preset": answers.preset.name, "written": changed}, json, not answers.doubts)


@drive.command()
def presets(json: Json = None) -> None:
    """List the known families of drives with their sources.

    Example: stagectl drive presets
    """
    from stagectl.drives.canopen.presets import PRESETS

    for preset in PRESETS:
        console.print(f"{preset.name}: {preset.family} ({preset.standing})")
        console.print(f"    rated current: {preset.rated_words}")
        for line in (*preset.notes, *(f"source: {document}" for document in preset.documents)):
            console.print(f"    {line}")
    emit({"presets": [preset._asdict() for preset in PRESETS]}, json)


def _chosen(name: str | None) -> Any:
    from stagectl.drives.canopen.presets import BY_NAME

    if name is None:
        return None
    if name not in BY_NAME:
        raise StageError(f"--preset {name}; must be one of {', '.join(BY_NAME)}: see `stagectl drive presets`")
    return BY_NAME[name]


def _show(result: Any, proposed: bool) -> None:
    width = max(map(len, result.answers))
    for name, words in result.answers.items():
        console.print(f"{name:{width}}  {words}")
    console.print(f"\npreset {result.preset.name}: {result.preset.family} ({result.preset.standing})")
    for note in result.preset.notes:
        console.print(f"  {note}")
    if result.values:
        console.print(f"\nfor the stage file{' (--write puts it there)' if proposed else ''}:\n")
        console.print("drive:\n  wire:")
        for name, value in result.values.items():
            console.print(f"    {name}: {_worded(name, value)}")
    for doubt in result.doubts:
        console.print(f"look at: {doubt}")


def _worded(name: str, value: float) -> str:
    if name.endswith("_object"):
        return f"0x{int(value) >> 8:04x}_{int(value) & 0xFF:02x}"
    return f"{value:.7g} {'rad/s^2' if name == 'deceleration_scale' else 'A'}"


def _written(stage: Path, values: dict[str, float | int]) -> list[Any]:
    from stagectl.config.machine_file import split
    from stagectl.config.patch import write
    from stagectl.config.stage_file import load_stage

    if split(stage)[1]:
        raise StageError(f"{stage} is one axis of several: write the lines above into its entry under `axes`")
    wire = load_stage(stage, designed=False).file.drive.wire
    news = {f"drive.wire.{name}": value for name, value in values.items() if getattr(wire, name) != value}
    return write(stage, stage, news) if news else []


def _as_json(entry: Any) -> dict[str, Any]:
    fields = entry._asdict()
    return {"index": fields.pop("number"), **fields, "changed": entry.changed}  # a NamedTuple's own `index` is a method


def _line(entry: Any) -> str:
    value = entry.problem if entry.value is None else entry.value
    number = f" (0x{entry.value:X})" if isinstance(entry.value, int) and entry.value > 9 else ""
    default = f", factory {entry.default}" if entry.changed else ""
    return f"{entry.number:04X}_{entry.subindex:02X}  {entry.name}: {value}{number}{default}"
