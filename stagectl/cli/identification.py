"""The verbs `identify` and `tune`: parameters and gains on the screen, as JSON, as a page, and into a stage file."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stagectl.api.arguments import ArgumentError, quantity
from stagectl.cli.options import Columns, FirstAxis, Json, Report, Socket, StageArgument, Write, argument, option
from stagectl.cli.show import check_patch, console, deliver, page_path, patch, reporter, single_threaded_algebra
from stagectl.identification.catalogue import listed
from stagectl.units import Quantity, StageError

if TYPE_CHECKING:
    from stagectl.workflows.friction_watch import Verdict


from typing import Literal

_EVERY = Quantity("s", "[1, 14]", "time of one look; the service holds the last 14 s")


def _method(name: str) -> str:
    """Checked before the rest is: a forgotten METHOD makes the arguments after it look wrong."""
    single_threaded_algebra()
    from stagectl.identification.methods import chosen

    if Path(name).is_file():
        words = f"the method comes first: {shlex.join(_in_order(sys.argv[2:]))}"
        raise StageError(f"{words}; `stagectl identify help` lists the methods")
    chosen(name)
    return name


def _in_order(words: list[str]) -> list[str]:
    """The words after `identify` as they belong: METHOD, STAGE.yaml, the rest; the usual method where none is named."""
    from stagectl.identification.catalogue import METHODS

    method = next((word for word in words if word in METHODS), "simultaneous")
    stage = next((word for word in words if Path(word).suffix in (".yaml", ".yml")), "STAGE.yaml")
    return ["stagectl", "identify", method, stage, *(word for word in words if word not in (method, stage))]


Current = Annotated[str | None, option("--current COLUMN", "measured_current, current (limited) or command.")]
Compensation = Annotated[str | None, option("--compensation NAME", "Compensator that acts: table, gms or rheology.")]
Watch = Annotated[
    bool, option("--watch", "Follow the friction of a running service, and keep its compensation current.")
]
Within = Annotated[
    float | None,
    option("--within", "With --watch: largest change of the scale; default: 0.3, which is 30 %.", min=0.01, max=1.0),
]


def identify(
    method: Annotated[str, argument("METHOD", "\n\n".join(["One of the following.", *listed()]), callback=_method)],
    stage: StageArgument,
    captures: Annotated[list[Path] | None, argument("CAPTURE...", "Recordings, logs or folders of captures.")] = None,
    json: Json = None,
    write: Write = None,
    report: Report = None,
    current: Current = None,
    columns: Columns = None,
    delay: Annotated[str | None, option("--delay TIME", "A known delay, such as 0.2ms.")] = None,
    gravity: Annotated[bool, option("--gravity", "Also fit gravity: sine and cosine of the angle.")] = False,
    directions: Annotated[bool, option("--directions", "Fit the friction of each direction separately.")] = False,
    form: Annotated[str | None, option("--form", "With zero-crossing: the form of the curve to fit.")] = None,
    seed: Annotated[int | None, option("--seed", "Seed of a method that searches at random.")] = None,
    doubtful: Annotated[bool, option("--doubtful", "Continue even if units or current look wrong.")] = False,
    compensation: Compensation = None,
    compensators: Annotated[str, option("--compensators NAMES", "Compensators to `compare`: table,gms,rheology.")] = "",
    watch: Watch = False,
    every: Annotated[str | None, option("--every TIME", "With --watch: length of a look; default: 10 s.")] = None,
    within: Within = None,
    socket: Socket = None,
    axis: FirstAxis = "",
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

    check_patch(stage, write)
    page = page_path(report, f"identify-{method}")
    fit = sc.identify(
        sc.load_stage(stage, judged=False),
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

    report, last = reporter(json, console.print), None
    with contextlib.suppress(KeyboardInterrupt):
        for last in looks:
            report(**last._asdict())
    if last is None:
        return
    changes = {"control.friction_scale": last.scale}
    patch(stage, write, lambda target: stage_patch.write(stage, target, changes))
    if last.ended:
        raise typer.Exit(1)


def tune(
    stage: StageArgument,
    bandwidth: Annotated[
        str | None, option("--bandwidth FREQUENCY", "For example 40Hz; default: the highest that keeps the margins.")
    ] = None,
    margin: Annotated[
        str | None, option("--margin ANGLE", "Least phase margin, for example 30deg; default: the stage file's.")
    ] = None,
    ms: Annotated[
        str | None, option("--ms FACTOR", "Largest peak of the sensitivity; without --bandwidth it is 2.")
    ] = None,
    law: Annotated[Literal["pid", "cascade"] | None, option("--law", "Default: the stage file's.")] = None,
    start: Annotated[
        Literal["rule", "own"],
        option("--start", "Ratios of a cascade's gains: by the rule, or those of the stage file."),
    ] = "rule",
    write: Write = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Design the feedback from the stage's model, with its period and all its delays.

    Without --bandwidth: the fastest design that keeps the margins.  A cascade's bandwidth is that of its position loop.

    Example: stagectl tune config/ball-screw.yaml --bandwidth 30Hz --margin 30deg
    """
    import stagectl as sc

    check_patch(stage, write)
    designed = sc.load_stage(stage, judged=False)
    page = page_path(report, f"tune-{designed.path.stem}")
    with console.status("searching the gains over the families of machines"):
        tuned = sc.tune(designed, bandwidth, margin, peak=ms, law=law, own_ratios=start == "own")
    deliver(tuned, page, json)
    patch(stage, write, tuned.write)
