"""Commands on recordings: report, export, import, replay."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from stagectl.api.arguments import ArgumentError
from stagectl.cli.options import Json, argument, option
from stagectl.cli.show import console, emit, typed
from stagectl.extras import require
from stagectl.replacing import PAGE, check_replaceable
from stagectl.units import StageError

if TYPE_CHECKING:
    from stagectl.recording.hdf5 import Recording

RecordingArgument = Annotated[Path, argument("RECORDING.h5", "A recording.")]
Format = Literal["csv", "parquet", "mat", "mcap", "folder", "trajectory", "mujoco", "fmu", "isaac"]
SIMULATORS = ("mujoco", "fmu", "isaac")  # of `stagectl.interchange`; the others are of `stagectl.recording.exports`
Where = Annotated[Path | None, option("--output -o PATH", "Output file or folder.")]


def report(recording: RecordingArgument, output: Where = None, json: Json = None) -> None:
    """Write the page of a run: result, figures, and the command that repeats it.

    Example: stagectl report recordings/sine.h5 -o sine.html
    """
    require("report", "the page")
    from stagectl.recording.hdf5 import open_recording
    from stagectl.report.page import write
    from stagectl.report.run import page

    path = output or recording.with_suffix(".html")
    check_replaceable(path, PAGE)
    run_page = page(open_recording(recording), [typed()])
    console.print(run_page.answer)
    console.print(f"report: {write(run_page, path)}")
    emit({"answer": run_page.answer, "report": str(path)}, json)


def replay(recording: RecordingArgument, json: Json = None) -> None:
    """Compute each command again from the recorded positions; exit 1 if one differs in any bit.

    Example: stagectl replay recordings/sine.h5
    """
    from stagectl.recording.hdf5 import open_recording
    from stagectl.recording.replay import replay as again

    comparison = again(open_recording(recording))
    console.print(comparison["words"])
    emit(comparison, json, comparison["identical"])


def export(
    files: Annotated[
        list[Path], argument("RECORDING.h5... | STAGE.yaml", "Recordings; for a simulator, a stage file.")
    ],
    to: Annotated[
        Format, option("--to", "Format; `folder` takes several recordings, `mujoco`, `fmu` and `isaac` a stage file.")
    ],
    output: Where = None,
    json: Json = None,
) -> None:
    """Export recordings (csv, parquet, mat, mcap, trajectory, folder of captures), or a stage (mujoco, fmu, isaac).

    Example: stagectl export recordings/a.h5 recordings/b.h5 --to folder -o captures
    Example: stagectl export config/ball-screw.yaml --to mujoco -o ball-screw.xml
    Example: stagectl export config/ball-screw.yaml --to fmu -o ball-screw.fmu
    """
    stages = [path for path in files if path.suffix in (".yaml", ".yml") or "#" in path.name]
    if to in SIMULATORS:
        if len(files) > 1 or not stages:
            raise StageError(f"--to {to} takes one stage file: stagectl export STAGE.yaml --to {to}")
        _export_model(stages[0], to, output, json)
    elif stages:
        known = ", ".join(SIMULATORS)
        raise StageError(f"{stages[0]} is a stage file, and --to {to} takes recordings; a stage file goes --to {known}")
    else:
        _export_recordings(files, to, output, json)


def _export_model(stage: Path, to: Format, output: Path | None, json: Json) -> None:
    require("report", "the page of the export")
    from stagectl.config.stage_file import load_stage
    from stagectl.interchange import export as models
    from stagectl.report.interchange import answer, page
    from stagectl.report.page import write

    path = models.SIMULATORS[to].file(stage, output)
    report_file = path.with_suffix(f".{to}.html")  # the models of a stage may share a name
    check_replaceable(report_file, PAGE)
    if output is None:
        check_replaceable(path, "")
    setup = load_stage(stage)
    path.parent.mkdir(parents=True, exist_ok=True)
    exported = models.SIMULATORS[to].write(setup, path)
    for file in exported.files:
        console.print(f"wrote {file}")
    write(page(setup, exported, typed()), report_file)
    for words in (*(f"not held: {entry}" for entry in exported.lost), *exported.notes):
        console.print(words, markup=False)
    console.print(answer(exported))
    console.print(f"report: {report_file}")
    differences = {
        name: dict(zip(("of_motion", "of_friction"), worst, strict=True)) for name, worst in exported.worst().items()
    }
    written = {"files": [str(file) for file in exported.files], "report": str(report_file)}
    emit({**written, "lost": exported.lost, "notes": list(exported.notes), "differences": differences}, json)


def _export_recordings(recordings: list[Path], to: Format, output: Path | None, json: Json) -> None:
    from stagectl.recording import exports
    from stagectl.recording.hdf5 import open_recording

    written = exports.export([open_recording(path) for path in recordings], to, output)
    for path, notes in written:
        for note in notes:
            console.print(note)
        console.print(f"wrote {path}")
    emit({"written": [{"file": str(path), "notes": list(notes)} for path, notes in written]}, json)


def import_(
    source: Annotated[Path, argument("FILE", "A text table, a .mat, a folder of captures, or a folder of logs.")],
    stage: Annotated[Path | None, option("--stage STAGE.yaml", "Stage file with the scales of the columns.")] = None,
    output: Where = None,
    columns: Annotated[
        str | None,
        option(
            "--columns WHICH",
            "Assign columns: time=t,position=qm:mm,current=-3 (numbers count from 1, a minus turns the sign).",
        ),
    ] = None,
    counts: Annotated[float | None, option("--counts N", "Encoder counts a turn, or a metre.")] = None,
    force_constant: Annotated[
        float | None, option("--force-constant K", "N m/A or N/A, of a column that is a force.")
    ] = None,
    yes: Annotated[bool, option("--yes -y", "Take a guess that is not sure.")] = False,
    json: Json = None,
) -> None:
    """Import the log of another program; columns and units that it does not name are guessed, and the guess is shown.

    If the output does not end in `.h5`, it becomes a folder of captures, with the YAML file that describes them.

    Example: stagectl import DATA_EMPS.mat -o recordings/emps.h5
    """
    from stagectl.config.stage_file import load_stage
    from stagectl.recording.columns import split
    from stagectl.recording.guess.importing import import_log
    from stagectl.recording.scales import Known

    words = split(columns) if columns else None
    known = Known(_scale("counts", counts, stage), _scale("force-constant", force_constant, stage))
    setup = load_stage(stage, designed=False) if stage else None  # a log was recorded by whatever loop
    logs = import_log(source, setup, words, known, yes)
    paths = _stored([log.recording for log in logs], source, output)
    written = []
    for (recording, guess), path in zip(logs, paths, strict=True):
        guessed = [part._asdict() for part in guess.columns] if guess else []
        notes = list(recording.meta["notes"])
        written.append({"file": str(path), "rows": len(recording.samples), "notes": notes, "guessed": guessed})
        for note in notes:
            console.print(note, markup=False)
        names = ", ".join(recording.samples.dtype.names or ())
        size = f"{len(recording.samples)} rows, {recording.meta['duration']:.4g} s, columns {names}"
        console.print(f"imported {path}: {size}")
    emit({"imported": written}, json)


def _scale(name: str, value: float | None, stage: Path | None) -> float:
    """A scale that an option states; 0 where it does not.  Raises ArgumentError where it is not above 0."""
    if value is not None and stage is not None:
        raise ArgumentError(name, f"{value:g}", f"; {stage} says it: leave out one of the two")
    if value is not None and not 0.0 < value < math.inf:
        turn = "; a minus before the column turns it: --columns position=-2:counts" if value < 0.0 else ""
        raise ArgumentError(name, f"{value:g}", f"; must lie in (0, inf){turn}")
    return value or 0.0


def _stored(recordings: list[Recording], source: Path, output: Path | None) -> list[Path]:
    """Where the recordings went: files, or one folder of captures where the output of a file is a folder."""
    from stagectl.recording.exports import export
    from stagectl.recording.imports import store

    if source.is_dir() or output is None or output.suffix:
        return store(recordings, source, output)
    return [export(recordings, "folder", output)[0].path for _ in recordings]
