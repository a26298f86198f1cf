"""The verb `gap exam`: the diagnosis put to sealed trials of a machine that it does not know, and scored."""

from __future__ import annotations

import json as texts
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from stagectl.api.arguments import ArgumentError
from stagectl.cli.options import Json
from stagectl.cli.show import console, emit, progress
from stagectl.extras import require
from stagectl.units import StageError

if TYPE_CHECKING:
    from stagectl_studies.exam.exam import Asked
    from stagectl_studies.exam.question import Manner

Trials = Annotated[int, typer.Option("--trials", min=1, max=100_000, help="Number of trials.")]
First = Annotated[int | None, typer.Option(min=1, help="Run only the first N trials now, then score.")]
Seed = Annotated[
    int | None, typer.Option(min=0, max=2**31 - 1, help="Seed of the exam; default: the hash of the sources.")
]
Strata = Annotated[list[str] | None, typer.Option(metavar="NAMES", help="Only these strata, separated by commas.")]
Short = Annotated[bool, typer.Option("--short/--long", help="Use a battery of 20 s instead of the recommended 80 s.")]
Full = Annotated[bool, typer.Option("--full", help="Use the full path of the diagnosis.")]
Output = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for trials and scores.")]
Workers = Annotated[int | None, typer.Option(min=1, max=1024, help="Parallel trials; default: one per core.")]
Resume = Annotated[bool, typer.Option("--resume", help="Continue the exam in DIR.")]
Keep = Annotated[bool, typer.Option("--keep", help="Keep the captures, tens of MB per trial.")]
Baselines = Annotated[
    bool, typer.Option("--baselines", help="Also run simpler methods, and an oracle that knows the effects.")
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Run the trials on the Dask cluster of this scheduler.")
]
On = Annotated[
    Path | None,
    typer.Option(
        "--on", metavar="RECORD", help="Draw the trials on the friction and noise of this record; see --stage."
    ),
]
StageOption = Annotated[Path | None, typer.Option("--stage", metavar="STAGE.yaml", help="The stage of --on.")]
Ledger = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Ledger of all exams; default: ledger.jsonl next to DIR.")
]


class _How(NamedTuple):
    """What changes no score of a trial."""

    resume: bool
    first: int | None  # trials that are sat now; None: all
    workers: int
    scheduler: str | None
    ledger: Path


def exam(
    output: Output,
    trials: Trials = 300,
    first: First = None,
    seed: Seed = None,
    strata: Strata = None,
    short: Short = False,
    full: Full = False,
    workers: Workers = None,
    resume: Resume = False,
    keep: Keep = False,
    baselines: Baselines = False,
    scheduler: Scheduler = None,
    ledger: Ledger = None,
    on: On = None,
    stage: StageOption = None,
    json: Json = None,
) -> None:
    """Put the diagnosis to sealed trials whose hidden effects it has to find, and score it.

    With `--on` the machine of the trials has the inertia, friction and noise of a record: what would the diagnosis
    find on that axis?

    Example: stagectl gap exam --trials 12 --short -o exam
    """
    from stagectl_studies.exam.exam import Asked
    from stagectl_studies.exam.question import Manner
    from stagectl_studies.exam.workers import workers_and_threads

    names = tuple(name.strip() for text in strata or () for name in text.split(",") if name.strip())
    require("tables", "an exam")
    require("report", "an exam's page")
    if baselines:
        require("exam", "--baselines")
    count, threads = workers_and_threads(workers)
    if on is not None and stage is None:
        raise ArgumentError("on", on, ": name the stage of the record, too", "stage STAGE.yaml")
    record = (str(path.resolve()) if path else "" for path in (on, stage))
    asked = Asked(trials, _seed(output, resume, seed), names, *record)
    manner = Manner(short, full, keep, baselines, threads)
    how = _How(resume, first, count, scheduler, ledger or output.resolve().parent / "ledger.jsonl")
    result, seconds = _held(output.resolve(), asked, manner, how)
    _entered(how.ledger, result, seconds)
    emit(result, json)
    _show(result, seconds)
    console.print(str(_page(result, seconds, output)))


def _seed(output: Path, resume: bool, seed: int | None) -> int:
    """As asked for; else that of the exam that goes on; else the hash of the sources."""
    from stagectl_studies.exam.exam import seed_of
    from stagectl_studies.exam.plan import ExamError, packages, source_seed

    try:
        known = seed_of(output) if resume and seed is None else seed
    except ExamError as error:
        raise StageError(str(error)) from error
    return source_seed(*packages()) if known is None else known


def _held(output: Path, asked: Asked, manner: Manner, how: _How) -> tuple[dict[str, Any], dict[str, list[float]]]:
    """The result of the exam, which also stands in scores.json, and the seconds."""
    from stagectl_studies.exam import exam as exams
    from stagectl_studies.exam import ledger
    from stagectl_studies.exam.plan import ExamError
    from stagectl_studies.exam.totals import totals

    try:
        new = exams.seed_of(output) is None
        planned = exams.prepared(output, asked, manner, how.resume)[: how.first]
        if new:
            ledger.append(how.ledger, ledger.beginning({**asked._asdict(), **_ways(manner)}, _now()))
        where = f"{how.workers} at once" if how.scheduler is None else f"on {how.scheduler}"
        only = f"the first {len(planned)} of " if len(planned) < asked.trials else ""
        console.print(f"{only}{asked.trials} trials, seed {asked.seed}, {where}, to {output}")
        with progress("trials", len(planned)) as update:
            records = exams.held(output, planned, manner, _runner(how.workers, how.scheduler), _said(update))
    except ExamError as error:
        raise StageError(str(error)) from error
    except KeyboardInterrupt:
        raise StageError("interrupted: trials that are finished are kept; go on with --resume") from None
    ways, part = {**_ways(manner), "sources": _sources(records)}, {"stopped after": len(planned)} if only else {}
    result = {"exam": {**asked._asdict(), **ways, **part}, **totals(records), "records": records}
    (output / "scores.json").write_text(texts.dumps(result, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    return result, exams.seconds(output, planned)


def _ways(manner: Manner) -> dict[str, bool]:
    return {"short": manner.short, "full": manner.full, "baselines": manner.baselines}


def _now() -> tuple[str, str]:
    """Date and version."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), version("stagectl")


def _sources(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """The versions that sat the trials, by the hash of their sources; more than one where an exam went on later."""
    return list(dict.fromkeys(record["sources"] for record in records if "sources" in record))


def _runner(workers: int, scheduler: str | None) -> Any:
    """Who runs the trials: processes of this machine, or a cluster."""
    from stagectl_studies.cluster import on_cluster
    from stagectl_studies.exam.run_trial import sit
    from stagectl_studies.exam.workers import ATTEMPTS, local

    if scheduler is None:
        return lambda jobs: local(jobs, workers)
    return lambda jobs: on_cluster(sit, jobs, scheduler, ATTEMPTS - 1)


def _said(update: Any) -> Any:
    def say(done: int, whole: int, record: Mapping[str, Any]) -> None:
        update(done, whole)
        for reason in record["reasons"]:
            console.print(f"trial {record['number']} is {record['state']}: {reason}")

    return say


def _entered(path: Path, result: Mapping[str, Any], seconds: Mapping[str, Sequence[float]]) -> None:
    from stagectl_studies.exam import ledger

    medians = {name: round(sorted(each)[len(each) // 2], 2) for name, each in seconds.items()}
    ledger.append(path, ledger.entry(result["exam"], _now(), result, medians))
    console.print(f"entered into {path}")


def _show(summary: Mapping[str, Any], seconds: Mapping[str, Sequence[float]]) -> None:
    from rich.table import Table

    from stagectl_studies.exam.page import HEAD, answer, cells

    table = Table(*HEAD)
    for row in summary["rows"]:
        table.add_row(*cells(row))
    console.print(table)
    for kind in summary["classes"]:
        limit = f"below {kind['limit']:.2g}" if kind["below"] else f"{kind['limit']:.2g}"
        limit += f" (95 %: {kind['low']:.2g} to {kind['high']:.2g})"
        named = f"named {kind['named']} of {kind['clear']} at twice that"
        console.print(f"{kind['class']}: half are noticed at {limit} x typical ({kind['trials']} trials); {named}")
    if summary["void"]:
        console.print(f"{len(summary['void'])} trials are void and not counted", style="bold")
    for name, each in seconds.items():
        console.print(f"{name}: {sorted(each)[len(each) // 2]:.1f} s median, {max(each):.1f} s most")
    console.print(answer(summary))


def _page(result: Mapping[str, Any], seconds: Mapping[str, Sequence[float]], output: Path) -> Path:
    from stagectl.report.page import write
    from stagectl_studies.exam import page as pages

    exam = result["exam"]
    strata = f" --strata {','.join(exam['strata'])}" if exam["strata"] else ""
    ways = "".join(f" --{name}" for name in ("short", "full", "baselines") if exam[name])
    first = f" --first {exam['stopped after']}" if "stopped after" in exam else ""
    command = f"stagectl gap exam --trials {exam['trials']}{first} --seed {exam['seed']}{strata}{ways} -o {output}"
    return write(pages.page(result, seconds, [command]), output / "exam.html")
