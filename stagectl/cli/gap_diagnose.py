"""The verb `gap diagnose`: where the gap lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from stagectl.cli.options import Columns, Json, argument, option
from stagectl.cli.show import console, emit, single_threaded_algebra, typed, typed_files
from stagectl.extras import require
from stagectl.named_values import pairs
from stagectl.problem import Problem, ProblemKind
from stagectl.replacing import PAGE, check_folder_to_be, check_replaceable
from stagectl.units import StageError

if TYPE_CHECKING:
    from stagectl.api.diagnosis import GapDiagnosis

_EXAMPLE = "kind=rotary,force_constant=0.05,inertia=1e-4"

Folder = Annotated[
    list[Path], argument("FOLDER...", "Folders of recordings or captures, or single logs and recordings.")
]
StageFile = Annotated[Path | None, option("--stage STAGE.yaml", "The model, where the logs carry none.")]
Exclude = Annotated[
    list[str] | None,
    option("--exclude NAMES", "Effects to leave out of the search, with all effects that contain them."),
]
Full = Annotated[bool, option("--full", "Use a larger null ensemble and more resamples; takes a quarter longer.")]


def _values(model: str | None) -> dict[str, float | str] | str | None:
    """The values of `--model`, numbers as such, or its file.  Raises StageError where an entry is not NAME=VALUE."""
    if model is None or model.partition("#")[0].endswith(".xml"):
        return model
    if model.endswith((".yaml", ".yml")):
        raise StageError(
            Problem(f"--model {model}: it is a stage file", ProblemKind.FILE, remedy=f"take --stage {model}")
        )
    values: dict[str, float | str] = {}
    for name, text in pairs("--model", model, "NAME=VALUE", _EXAMPLE).items():
        try:
            values[name] = float(text)
        except ValueError:
            values[name] = text
    return values


def _check_places(target: Path, predictions: Path | None, page: Path) -> None:
    """Raises StageError where a result cannot be put, before the diagnosis takes its minutes."""
    check_replaceable(page, PAGE)
    for place in filter(None, (target, predictions, page.parent)):
        check_folder_to_be(place)


def diagnose(
    folder: Folder,
    json: Json = None,
    stage: StageFile = None,
    columns: Columns = None,
    model: Annotated[
        str | None,
        option("--model VALUES", f"Without a stage file: {_EXAMPLE} (SI), or a MuJoCo model: FILE.xml[#JOINT]."),
    ] = None,
    exclude: Exclude = None,
    predictions: Annotated[
        Path | None, option("--predictions DIR", "A CSV for each held-out capture, from the improved simulator.")
    ] = None,
    report: Annotated[
        Path | None, option("--report FILE.html", "Where the page goes; default: into the folder.")
    ] = None,
    output: Annotated[
        Path | None, option("--output -o DIR", "Where diagnosis.json goes; default: into the folder.")
    ] = None,
    full: Full = False,
    doubtful: Annotated[
        bool, option("--doubtful", "Go on with logs that fit the model only in another unit or sign.")
    ] = False,
) -> None:
    """Say where the gap between simulator and machine lies, which effect causes it, and how far it shrinks.

    Example: stagectl gap diagnose recordings/gap-ball-screw --json -
    """
    single_threaded_algebra()
    require("report", "the page")
    import stagectl as sc
    from stagectl.gap.result.result_json import save
    from stagectl.report.page import write

    target = output or (folder[0] if folder[0].is_dir() else folder[0].parent)
    _check_places(target, predictions, report or target / "diagnosis.html")
    answer = sc.diagnose(
        folder,
        stage=None if stage is None else sc.load_stage(stage, judged=False),
        columns=columns,
        model=_values(model),
        exclude=exclude or (),
        full=full,
        doubtful=doubtful,
        progress=True,
    )
    stored = save(answer.diagnosis, target)
    if predictions is not None:
        answer.save_predictions(predictions)
    path = report or target / "diagnosis.html"
    nominal = [place / "nominal.yaml" for place in folder if (place / "nominal.yaml").is_file()]
    write(answer.page(typed(), target), path, [*typed_files(), *nominal])
    if json is not None:
        emit(answer.to_json(), json)
    if json is None or str(json) != "-":
        show(answer, target)
        console.print(f"{path}\n{stored}")


def show(answer: GapDiagnosis, folder: Path) -> None:
    """Print what makes the logs doubtful, the diagnosis, and the commands that follow it in `folder`."""
    found = answer.diagnosis
    for doubt in found.doubts:
        console.print(f"doubtful data: {doubt}", style="bold")
    console.print(str(answer))
    if found.next_experiment is not None and found.next_experiment.trajectory:
        console.print(f"stagectl gap next {folder}", style="bold")
    if found.writes:
        console.print(f"stagectl gap apply {folder} STAGE.yaml", style="bold")
