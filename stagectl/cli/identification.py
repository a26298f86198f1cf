"""The verb `identify`: parameters from captures, on the screen, as JSON, as a page, and into a stage file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli.motion import Json, Report, StageArgument, Write
from stagectl.cli.show import deliver, page_path, patch, single_threaded_algebra


def _method(name: str) -> str:
    """Checked before the rest is: a forgotten METHOD makes the arguments after it look wrong."""
    single_threaded_algebra()
    from stagectl.identification.methods import chosen

    chosen(name)
    return name


MethodArgument = Annotated[
    str, typer.Argument(metavar="METHOD", help="How; any wrong name lists them all.", callback=_method)
]
Captures = Annotated[list[Path], typer.Argument(metavar="CAPTURE...", help="Recordings, logs or folders of captures.")]
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
Compensation = Annotated[
    str | None, typer.Option("--compensation", metavar="NAME", help="Compensator to act: table, gms or rheology.")
]
Compensators = Annotated[
    str, typer.Option("--compensators", metavar="NAMES", help="Compensators to `compare`: table,gms,rheology.")
]
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
    compensation: Compensation = None,
    compensators: Compensators = "",
) -> None:
    """Find the parameters of an axis from captures of its motion.

    Example: stagectl identify least-squares config/emps.yaml recordings/emps.h5 --json -
    """
    import stagectl as sc

    page = page_path(report, f"identify-{method}")
    fit = sc.identify(
        sc.load_stage(stage),
        captures,
        method,
        current=current,
        columns=columns,
        doubtful=doubtful,
        compensation=compensation,
        compensators=compensators.split(",") if compensators else (),
        progress=True,
        delay=delay,
        gravity=gravity,
        directions=directions,
        form=form,
        seed=seed,
    )
    deliver(fit, page, json)
    patch(stage, write, lambda target: fit.write(target, doubtful=doubtful))
