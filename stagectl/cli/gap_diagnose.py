"""The verb `gap diagnose`: where the gap lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli.motion import Json
from stagectl.cli.process import single_threaded_algebra
from stagectl.cli.show import console, emit, progress, typed, typed_files
from stagectl.gap.steps import BEGINS, Step

Folder = Annotated[
    list[Path], typer.Argument(metavar="FOLDER...", help="Of recordings or captures; or single logs and recordings.")
]
StageFile = Annotated[
    Path | None, typer.Option("--stage", metavar="STAGE.yaml", help="The model, where the logs carry none.")
]
Exclude = Annotated[
    list[str] | None,
    typer.Option(
        "--exclude", metavar="NAMES", help="Effects that must not be candidates, nor wider ones that hold them."
    ),
]
Predictions = Annotated[
    Path | None,
    typer.Option("--predictions", metavar="DIR", help="A CSV for each held-out capture, from the improved simulator."),
]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="FILE.html", help="Where the page goes, else into the folder.")
]
Full = Annotated[
    bool,
    typer.Option("--full", help="A null ensemble three times as large, six times the resamples: a quarter longer."),
]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="DIR", help="Where diagnosis.json goes, else into the folder.")
]


def register(app: typer.Typer) -> None:
    """Add the verb to the group."""
    app.command("diagnose")(diagnose)


def diagnose(
    folder: Folder,
    json: Json = None,
    stage: StageFile = None,
    exclude: Exclude = None,
    predictions: Predictions = None,
    report: Report = None,
    output: Output = None,
    full: Full = False,
) -> None:
    """Say where the gap between simulator and machine lies, which effect causes it, and how far it shrinks.

    Example: stagectl gap diagnose recordings/gap-ball-screw --json -
    """
    single_threaded_algebra()
    from stagectl.cli.gap_show import show
    from stagectl.config.stage_file import load_stage
    from stagectl.gap import diagnose as pipeline
    from stagectl.gap.effects.library_names import excluded
    from stagectl.gap.logs import load_session as folders
    from stagectl.gap.result.result_json import as_json, save
    from stagectl.gap.validation.predictions import write
    from stagectl.report.gap import page
    from stagectl.report.page import write as write_page

    options = pipeline.Options(excluded(exclude or []), full)
    session = folders.load(folder, load_stage(stage) if stage is not None else None)
    with progress("diagnosis", 100) as update:
        done = pipeline.diagnose(session, options, _shown(update))
        update(100, 100)
    target = output or (folder[0] if folder[0].is_dir() else folder[0].parent)
    target.mkdir(parents=True, exist_ok=True)
    stored = save(done.found, target)
    if predictions is not None:
        write(session, done.improved, predictions)
    path = report or target / "diagnosis.html"
    nominal = [one / "nominal.yaml" for one in folder if (one / "nominal.yaml").is_file()]
    write_page(page.page(done.found, str(target), [typed()]), path, [*typed_files(), *nominal])
    if json is not None:
        emit(as_json(done.found), json)
    if json is None or str(json) != "-":
        show(done.found, target)
        console.print(f"{path}\n{stored}")


def _shown(update: Callable[..., None]) -> Callable[[str], None]:
    """Shows each step at its share of the whole, and what happens within it at the same place."""
    reached = 0

    def report(message: str) -> None:
        nonlocal reached
        reached = BEGINS[message] if isinstance(message, Step) else reached
        update(reached, 100, str(message))

    return report
