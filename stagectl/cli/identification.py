"""The verb `identify`: parameters from captures, on the screen, as JSON, as a page, and into a stage file."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stagectl.api.arguments import ArgumentError, quantity
from stagectl.cli.motion import Json, Report, StageArgument, Write
from stagectl.cli.service import AxisName, Socket
from stagectl.cli.show import console, deliver, message_event, page_path, patch, single_threaded_algebra, stream
from stagectl.identification.catalogue import listed
from stagectl.units import Quantity, StageError

if TYPE_CHECKING:
    from stagectl.workflows.friction_watch import Verdict

_EVERY = Quantity("s", "[1, 14]", "time of one look; the service holds the last 14 s")


def _method(name: str) -> str:
    """Checked before the rest is: a forgotten METHOD makes the arguments after it look wrong."""
    single_threaded_algebra()
    from stagectl.identification.methods import chosen

    if Path(name).is_file():
        corrected = shlex.join(["stagectl", "identify", "simultaneous", *sys.argv[2:]])
        raise StageError(f"the method comes first: {corrected}; `stagectl identify help` lists the methods")
    chosen(name)
    return name


MethodArgument = Annotated[
    str, typer.Argument(metavar="METHOD", help="\n\n".join(["One of these.", *listed()]), callback=_method)
]
Captures = Annotated[
    list[Path] | None, typer.Argument(metavar="CAPTURE...", help="Recordings, logs or folders of captures.")
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
Compensation = Annotated[
    str | None, typer.Option("--compensation", metavar="NAME", help="Compensator to act: table, gms or rheology.")
]
Compensators = Annotated[
    str, typer.Option("--compensators", metavar="NAMES", help="Compensators to `compare`: table,gms,rheology.")
]
Seed = Annotated[int | None, typer.Option("--seed", help="Of a method that searches at random.")]
Watch = Annotated[
    bool, typer.Option("--watch", help="Follow the friction of a running service, and keep its compensation current.")
]
Every = Annotated[
    str | None, typer.Option("--every", metavar="TIME", help="Of --watch: what one look takes, else 10 s.")
]
Within = Annotated[
    float | None, typer.Option("--within", min=0.01, max=1.0, help="Of --watch: bound of the change, else 0.3: 30 %.")
]


def identify(
    method: MethodArgument,
    stage: StageArgument,
    captures: Captures = None,
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
    watch: Watch = False,
    every: Every = None,
    within: Within = None,
    socket: Socket = None,
    axis: AxisName = "",
) -> None:
    """Find the parameters of an axis from captures of its motion.

    With `--watch` follow the friction of a running service instead, until Ctrl-C.

    Example: stagectl identify least-squares config/emps.yaml recordings/emps.h5 --json -
    """
    if watch:
        looks = _looks(method, stage, every or "10 s", socket=socket, axis=axis, within=within or 0.3)
        _follow(stage, looks, write, json)
        return
    for name, value in (("every", every), ("within", within)):
        if value is not None:
            raise ArgumentError(name, value, " is of --watch: leave it out, or follow a running service", needs="watch")
    if not captures:
        raise StageError("nothing to identify from: name recordings or logs, or --watch a running service")
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


def _looks(method: str, stage: Path, every: str, **watched: Any) -> Iterator[Verdict]:
    """What `--watch` sees; `watched` are the other arguments of `watch_friction`."""
    from stagectl.api.friction_watch import watch_friction

    if method != "simultaneous":
        raise ArgumentError("watch", "", f"follows what `simultaneous` finds, not `{method}`")
    return watch_friction(stage, every=quantity("every", every, _EVERY, "it such as '10 s'"), **watched)


def _follow(stage: Path, looks: Iterator[Verdict], write: Path | None, json: str | None) -> None:
    """Show each look until Ctrl-C, then put the scale into the stage file; exit 1 where the watch ends by itself."""
    from stagectl.config import patch as stage_patch

    event, last = stream(json), None
    with contextlib.suppress(KeyboardInterrupt):
        for last in looks:
            console.print(last.words)
            event(message_event(last.words) | last._asdict())
    if last is None:
        return
    changes = {"control.friction_scale": last.scale}
    patch(stage, write, lambda target: stage_patch.write(stage, target, changes))
    if last.ended:
        raise typer.Exit(1)
