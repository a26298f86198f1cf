"""The verb tune: gains from the model in the stage file."""

from __future__ import annotations

import enum
import itertools
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from stagectl.cli.motion import Json, StageArgument
from stagectl.cli.show import console, emit, typed, typed_files
from stagectl.units import Quantity, StageError, UnitError, parse

if TYPE_CHECKING:
    from stagectl.config.stage_file import Setup
    from stagectl.tuning.search import Tuned


class Law(enum.StrEnum):
    """What feeds back."""

    PID = "pid"
    CASCADE = "cascade"


class Start(enum.StrEnum):
    """Where a cascade's ratios come from."""

    RULE = "rule"
    OWN = "own"


Bandwidth = Annotated[
    str | None, typer.Option("--bandwidth", metavar="FREQUENCY", help="Such as 40Hz; else the highest that holds.")
]
Margin = Annotated[
    str | None, typer.Option("--margin", metavar="ANGLE", help="Least phase margin, such as 30deg; else the file's.")
]
PeakOption = Annotated[
    str | None,
    typer.Option("--ms", metavar="FACTOR", help="Largest peak of the sensitivity; without --bandwidth it is 2."),
]
LawOption = Annotated[Law | None, typer.Option("--law", help="Else the stage file's.")]
StartOption = Annotated[Start, typer.Option("--start", help="Ratios of a cascade: by the rule, or the file's own.")]
Write = Annotated[
    Path | None, typer.Option("--write", metavar="STAGE.yaml", help="Patch this stage file; its comments stay.")
]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="FILE.html", help="Where the page goes, else into recordings/.")
]
_MARGIN, _PEAK = Quantity("rad", "[0, 1.5]", "phase margin"), Quantity("", "(1, 100]", "peak of the sensitivity")


def register(app: typer.Typer) -> None:
    """Add the verb to the command line."""
    app.command("tune")(tune)


def tune(
    stage: StageArgument,
    bandwidth: Bandwidth = None,
    margin: Margin = None,
    ms: PeakOption = None,
    law: LawOption = None,
    start: StartOption = Start.RULE,
    write: Write = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Design the feedback from the stage's model, with its period and all its delays.

    Without --bandwidth: the fastest design that keeps the margins.  A cascade's bandwidth is that of its position loop.

    Example: stagectl tune config/ball-screw.yaml --bandwidth 30Hz --margin 30deg
    """
    from stagectl.config.stage_file import load_stage
    from stagectl.tuning import constants, families, sheet
    from stagectl.tuning import search as tuning

    setup = load_stage(stage, judged=False)
    hertz = None if bandwidth is None else _read("--bandwidth", bandwidth, "Hz")
    control = setup.file.control
    least = control.margin if margin is None else _within("--margin", margin, _MARGIN)
    peak = (constants.SENSITIVITY_PEAK if hertz is None else math.inf) if ms is None else _within("--ms", ms, _PEAK)
    chosen = law.value if law else families.law_of(control)
    choice = families.family(setup.stage, control._replace(margin=least), chosen, start is Start.OWN)
    with console.status("searching the gains over the families of machines"):
        found = tuning.tuned(choice, tuning.Demand(least, peak), hertz)
    result = sheet.result(setup, found)
    _show(setup, found, result)
    _page(setup, found, report or _fresh(setup.path.stem))
    emit(result, json)
    if write is not None:
        _write(stage, write, found, margin is not None)


def _read(option: str, text: str, unit: str) -> float:
    try:
        return parse(text, unit)
    except UnitError as error:
        example = {"Hz": "40Hz", "rad": "30deg"}.get(unit, "2")
        raise StageError(f"{option} {text}: {error}; write it such as {example}") from error


def _within(option: str, text: str, quantity: Quantity) -> float:
    value = _read(option, text, quantity.unit)
    if not quantity.admits(value):
        raise StageError(f"{option} {text}; must lie in {quantity.interval} {quantity.unit}".rstrip())
    return value


def _show(setup: Setup, found: Tuned, result: dict[str, Any]) -> None:
    from stagectl.tuning import sheet

    console.print(f"{setup.file.name}: {result['answer']}")
    console.print(_gains(setup, found))
    for title, head, rows in (
        ("Margins", ["", *found.reached], sheet.margins(found)),
        ("Closed loop", ["", ""], sheet.rows(setup, sheet.closed(setup, found))),
    ):
        table = Table(*head, title=title, show_header=any(head))
        for row in rows:
            table.add_row(*row)
        console.print(table)
    for note in result["notes"]:
        console.print(note)


def _gains(setup: Setup, found: Tuned) -> Table:
    from stagectl.tuning import sheet

    dt, control = found.control.period, found.control
    table = Table("gain", "continuous", "unit", f"as it runs every {dt * 1e3:g} ms", "unit", title="Gains")
    for one in sheet.gains(setup, control):
        table.add_row(f"{one.name} {one.symbol}", f"{one.value:.6g}", one.unit, f"{one.running:.6g}", one.running_unit)
    return table


def _page(setup: Setup, found: Tuned, path: Path) -> None:
    from stagectl.report.page import write
    from stagectl.report.tuning import page

    path.parent.mkdir(parents=True, exist_ok=True)
    console.print(f"report: {write(page(setup, found, typed()), path, typed_files())}")


def _fresh(stage: str) -> Path:
    """A page's name that is not taken."""
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}-tune-{stage}"
    names = itertools.chain([stem], (f"{stem}-{n}" for n in itertools.count(2)))
    return next(path for name in names if not (path := Path("recordings") / f"{name}.html").exists())


def _write(stage: Path, target: Path, found: Tuned, with_margin: bool) -> None:
    """Patch `target` and say what has changed."""
    from stagectl.config.patch import write
    from stagectl.config.stage_file import load_stage
    from stagectl.tuning.families import law_of

    fresh = not target.exists()
    before = load_stage(stage if fresh else target, judged=False).file.control
    changes = _changes(found, law_of(before), with_margin)
    made = write(stage, target, changes)
    console.print(
        f"wrote {target}" + (f", a copy of {stage} with" if fresh else "") + ("" if made else ": nothing has changed")
    )
    for change in made:
        console.print(f"  {change}")


def _changes(found: Tuned, before: str, with_margin: bool) -> dict[str, Any]:
    """What the stage file must say, by dotted name (SI); another law replaces its whole block."""
    from stagectl.tuning.families import law_of
    from stagectl.tuning.sheet import entries

    control, law = found.control, law_of(found.control)
    chosen: dict[str, Any] = entries(control)
    if law == before:
        changes = {f"control.{name}": value for name, value in chosen.items()}
        return changes | ({"control.margin": control.margin} if with_margin else {})
    kept = {name: getattr(control, name) for name in control._fields if name not in chosen}
    defaults = control._field_defaults
    stated = {name: value for name, value in kept.items() if name == "margin" or value != defaults.get(name)}
    return {"control": {"law": law, **chosen, **stated}}
