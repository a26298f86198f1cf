"""The verb `identify`: parameters from captures, on the screen, as JSON, as a page, and into a stage file."""

from __future__ import annotations

import itertools
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from stagectl.cli.motion import Json, StageArgument
from stagectl.cli.process import single_threaded_algebra
from stagectl.cli.show import console, drawable, emit, typed, typed_files
from stagectl.cli.show import progress as bar
from stagectl.units import StageError

MethodArgument = Annotated[str, typer.Argument(metavar="METHOD", help="How; any wrong name lists them all.")]
Captures = Annotated[list[Path], typer.Argument(metavar="CAPTURE...", help="Recordings, logs or folders of captures.")]
Write = Annotated[
    Path | None, typer.Option("--write", metavar="STAGE.yaml", help="Patch this stage file; its comments stay.")
]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="FILE.html", help="Where the page goes, else into recordings/.")
]
Current = Annotated[
    str | None, typer.Option("--current", metavar="COLUMN", help="measured_current, current (limited) or command.")
]
Columns = Annotated[
    str | None,
    typer.Option("--columns", metavar="WHICH", help="Of logs: time=t,position=qm:mm,current=3; numbers count from 1."),
]
Doubtful = Annotated[bool, typer.Option("--doubtful", help="Go on where a capture's units or current look wrong.")]
Delay = Annotated[str | None, typer.Option("--delay", metavar="TIME", help="A known delay, such as 0.2ms.")]
Gravity = Annotated[bool, typer.Option("--gravity", help="The axis turns in gravity: sine and cosine of its angle.")]
Directions = Annotated[bool, typer.Option("--directions", help="Friction of its own in each direction.")]
Form = Annotated[str | None, typer.Option("--form", help="Of zero-crossing: the form whose parameters are wanted.")]
Seed = Annotated[int | None, typer.Option("--seed", help="Of a method that searches at random.")]


def register(app: typer.Typer) -> None:
    """Add the verb to the command line."""
    app.command("identify")(identify)


def identify(
    method: MethodArgument,
    stage: StageArgument,
    captures: Captures,
    json: Json = None,
    write: Write = None,
    report: Report = None,
    current: Current = None,
    columns: Columns = None,
    delay: Delay = None,
    gravity: Gravity = False,
    directions: Directions = False,
    form: Form = None,
    seed: Seed = None,
    doubtful: Doubtful = False,
) -> None:
    """Find the parameters of an axis from captures of its motion.

    Example: stagectl identify least-squares config/emps.yaml recordings/emps.h5 --json -
    """
    single_threaded_algebra()
    from stagectl.config.stage_file import load_stage
    from stagectl.identification import methods
    from stagectl.identification.capture_checks import implausible
    from stagectl.identification.captures import held_out, opened, prepared
    from stagectl.recording.columns import split

    methods.chosen(method)
    with_page = drawable(report)
    setup = load_stage(stage)
    words = split(columns) if columns else None
    recordings = opened(captures, setup, words)
    left = [str(one.path) for one in recordings if held_out(one)]
    used = prepared(recordings, setup, current, doubtful)
    del recordings  # all their columns: the captures have copies of those that they need
    with bar(f"identify {method}", 1) as update:
        options = {"delay": _time(delay), "gravity": gravity, "directions": directions, "form": form, "seed": seed}
        found = methods.identify(method, used, setup.file, update, options)
    strange = implausible({name: one.value for name, one in found.parameters.items()}, setup)
    found = found._replace(notes=(*strange, *found.notes))
    result = methods.result(method, setup, used, found, left)
    _show(result)
    if with_page:
        _page(result, (found, used, setup), report or _fresh(method))
    emit(result, json)
    if write is not None:
        _write(stage, write, found.changes, [] if doubtful else strange)


def _time(text: str | None) -> float | None:
    """A time as a user writes it, in s."""
    from stagectl.units import UnitError, parse

    try:
        return None if text is None else parse(text, "s")
    except UnitError as error:
        raise StageError(f"--delay {text}: {error}; write a time such as 0.2ms") from error


def _show(result: dict[str, Any]) -> None:
    from rich.table import Table

    table = Table("parameter", "value", "95 % interval", "unit", title=f"{result['stage']}, {result['method']}")
    for name, one in result["parameters"].items():
        table.add_row(name, _digits(one["value"]), f"{_digits(one['low'])} to {_digits(one['high'])}", one["unit"])
    console.print(table)
    for one in result["captures"]:
        console.print(f"{one['name']}: {one['rows']} rows every {1e3 * one['dt']:.4g} ms, taken from {one['current']}")
        for note in one["notes"]:
            console.print(f"  {note}")
    if result.get("force_residual_percent") is not None:
        console.print(f"force residual {result['force_residual_percent']:.3g} % of the force")
    for name in result["held_out"]:
        console.print(f"{name}: held out, not used")
    for note in result["notes"]:
        console.print(note)


def _digits(value: float | None) -> str:
    return "not known" if value is None else f"{value:.6g}"


def _page(result: dict[str, Any], what: tuple[Any, Any, Any], path: Path) -> None:
    from stagectl.report.identification import page
    from stagectl.report.page import write

    path.parent.mkdir(parents=True, exist_ok=True)
    console.print(f"report: {write(page(result, what, typed()), path, typed_files())}")


def _fresh(method: str) -> Path:
    """A page's name that is not taken."""
    stem = Path("recordings") / f"{time.strftime('%Y%m%d-%H%M%S')}-identify-{method}"
    names = itertools.chain([stem.name], (f"{stem.name}-{n}" for n in itertools.count(2)))
    return next(path for name in names if not (path := stem.with_name(f"{name}.html")).exists())


def _write(stage: Path, target: Path, changes: Mapping[str, Any], strange: list[str]) -> None:
    """Patch `target` and say what has changed."""
    from stagectl.config.patch import write

    if not changes:
        raise StageError(f"--write {target}: this method finds nothing that stands in a stage file; it is as it was")
    if strange:
        raise StageError(f"--write {target}: nothing is written, as {strange[0]}; --doubtful writes it all the same")
    fresh = not target.exists()
    made = write(stage, target, changes)
    console.print(
        f"wrote {target}" + (f", a copy of {stage} with" if fresh else "") + ("" if made else ": nothing has changed")
    )
    for change in made:
        console.print(f"  {change}")
