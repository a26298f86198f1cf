"""The verb `identify`: parameters from captures, on the screen, as JSON, as a page, and into a stage file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli.motion import Json, StageArgument
from stagectl.cli.process import single_threaded_algebra
from stagectl.cli.show import console, drawable, emit, fresh_page, show_changes, write_page

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
    import stagectl as sc

    with_page = drawable(report)
    fit = sc.identify(
        sc.load_stage(stage),
        captures,
        method,
        current=current,
        columns=columns,
        doubtful=doubtful,
        progress=True,
        delay=delay,
        gravity=gravity,
        directions=directions,
        form=form,
        seed=seed,
    )
    console.print(str(fit))
    if with_page:
        write_page(fit, report or fresh_page(f"identify-{method}"))
    emit(fit.to_json(), json)
    if write is not None:
        fresh = not write.exists()
        show_changes(stage, write, fresh, fit.write(write, doubtful=doubtful))
