"""The verb tune: gains from the model in the stage file."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from stagectl.cli.motion import Json, Report, StageArgument, Write
from stagectl.cli.show import console, deliver, page_path, patch

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
LawOption = Annotated[Literal["pid", "cascade"] | None, typer.Option("--law", help="Else the stage file's.")]
StartOption = Annotated[
    Literal["rule", "own"], typer.Option("--start", help="Ratios of a cascade: by the rule, or the file's own.")
]


def tune(
    stage: StageArgument,
    bandwidth: Bandwidth = None,
    margin: Margin = None,
    ms: PeakOption = None,
    law: LawOption = None,
    start: StartOption = "rule",
    write: Write = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Design the feedback from the stage's model, with its period and all its delays.

    Without --bandwidth: the fastest design that keeps the margins.  A cascade's bandwidth is that of its position loop.

    Example: stagectl tune config/ball-screw.yaml --bandwidth 30Hz --margin 30deg
    """
    import stagectl as sc

    designed = sc.load_stage(stage, judged=False)
    page = page_path(report, f"tune-{designed.path.stem}")
    with console.status("searching the gains over the families of machines"):
        tuned = sc.tune(designed, bandwidth, margin, peak=ms, law=law, own_ratios=start == "own")
    deliver(tuned, page, json)
    patch(stage, write, tuned.write)
