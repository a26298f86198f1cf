"""The verb tune: gains from the model in the stage file."""

from __future__ import annotations

from typing import Annotated, Literal

from stagectl.cli.options import Json, Report, StageArgument, Write, option
from stagectl.cli.show import console, deliver, page_path, patch


def tune(
    stage: StageArgument,
    bandwidth: Annotated[
        str | None, option("--bandwidth FREQUENCY", "Such as 40Hz; else the highest that holds.")
    ] = None,
    margin: Annotated[
        str | None, option("--margin ANGLE", "Least phase margin, such as 30deg; else the file's.")
    ] = None,
    ms: Annotated[
        str | None, option("--ms FACTOR", "Largest peak of the sensitivity; without --bandwidth it is 2.")
    ] = None,
    law: Annotated[Literal["pid", "cascade"] | None, option("--law", "Else the stage file's.")] = None,
    start: Annotated[
        Literal["rule", "own"], option("--start", "Ratios of a cascade: by the rule, or the file's own.")
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

    designed = sc.load_stage(stage, judged=False)
    page = page_path(report, f"tune-{designed.path.stem}")
    with console.status("searching the gains over the families of machines"):
        tuned = sc.tune(designed, bandwidth, margin, peak=ms, law=law, own_ratios=start == "own")
    deliver(tuned, page, json)
    patch(stage, write, tuned.write)
