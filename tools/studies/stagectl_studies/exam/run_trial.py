"""One trial from end to end, in one process; nothing of it is left on disk that the diagnosis could learn from."""

import functools
import json
import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from stagectl_studies.exam import closed, rounds, scoring
from stagectl_studies.exam.cores import alone, taken
from stagectl_studies.exam.plan import CLOSED, ExamError, Planned, packages, sources
from stagectl_studies.exam.question import (
    ANSWER,
    BLIND,
    CAPTURES,
    LOG,
    ORACLE,
    TOLD,
    Manner,
    Place,
    answers,
    baselines,
    diagnosed,
)
from stagectl_studies.exam.rounds import Round, Said
from stagectl_studies.exam.sealing import Seal, SealError, broken
from stagectl_studies.exam.staging import staged

RECORD, TIMES, REGISTER = "record.json", "times.json", "register.jsonl"
VOID, SCORED, FAILED = "void", "scored", "failed"


class Job(NamedTuple):
    """One trial, for whichever process runs it."""

    planned: Planned
    root: str  # of the exam
    manner: Manner


class Clock:
    """Seconds of each step."""

    def __init__(self) -> None:
        self._before = time.monotonic()
        self.times: dict[str, float] = {}

    def __call__(self, name: str) -> None:
        """The step `name` ends here."""
        now = time.monotonic()
        self.times[name] = now - self._before
        self._before = now


def folder_of(root: Path, number: int) -> Path:
    """Where a trial lies; its name tells its number and nothing else."""
    return root / "trials" / f"{number:04d}"


def finished(root: Path, number: int) -> dict[str, Any] | None:
    """The record of a trial that was held before; None where there is none."""
    path = folder_of(root, number) / RECORD
    try:
        answer: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return answer


def finished_job(job: Job) -> dict[str, Any] | None:
    """The record of a job that was run."""
    return finished(Path(job.root), job.planned.number)


def sit(job: Job) -> dict[str, Any]:
    """Stage, seal, diagnose, seal the answer, open, score: the record, which also stands in the trial's folder.

    One process at a time sits a trial; one that comes later, of an exam begun again meanwhile, gets its record.
    A trial whose seal is broken, or whose diagnosis looked elsewhere, is void: it has reasons and no score.  Raises
    InterruptionError, and leaves no record, where the diagnosis was ended from outside: the trial is to be run again.
    """
    root = Path(job.root).resolve()
    with alone(root, job.planned.number):
        return finished(root, job.planned.number) or _sat(root, job)


def _sat(root: Path, job: Job) -> dict[str, Any]:
    planned = job.planned
    folder, clock = folder_of(root, planned.number), Clock()
    shutil.rmtree(folder, ignore_errors=True)
    (folder / ANSWER).mkdir(parents=True)
    made_ready = closed.staged if planned.stratum == CLOSED else staged
    try:
        labels = made_ready(planned, folder, job.manner.short)
    except ExamError as error:
        return _kept(folder, planned, {"state": VOID, "reasons": [str(error)]}, clock.times)
    seal = Seal(folder, labels, root / REGISTER)
    del labels
    clock("staging")
    with taken(root, job.manner.threads) as cores:
        record = _answered(Place(root, folder, cores), job, seal, clock)
    if not job.manner.keep:
        shutil.rmtree(folder / CAPTURES)
    return _kept(folder, planned, record, clock.times)


def _answered(place: Place, job: Job, seal: Seal, clock: Clock) -> dict[str, Any]:
    if job.planned.stratum == CLOSED:
        return _closed(place, job, seal, clock)
    said = _said(place, job, seal, clock)
    record = judged(place, seal, lambda labels: _scored(labels, place, said))
    if job.manner.baselines and record["state"] != VOID:
        effects = [effect["name"] for effect in record["truth"]["effects"]]
        failure = baselines(place, job.planned, job.manner, effects or ["none"])
        record["reasons"] += [failure] if failure else []
        record["baselines"] |= scoring.beside(seal.again(), place.folder, (TOLD, (ORACLE,)))
    clock("scoring")
    return record


def _closed(place: Place, job: Job, seal: Seal, clock: Clock) -> dict[str, Any]:
    left = closed.closed(place, job.planned, job.manner)
    clock("closing")
    seal.answered(place.folder / ANSWER)
    state = {"state": FAILED, "reasons": [left.failure]} if left.failure else {"state": SCORED, "reasons": []}
    record = judged(place, seal, lambda labels: state | closed.record(labels, place, left))
    clock("scoring")
    return record


def _said(place: Place, job: Job, seal: Seal, clock: Clock) -> Said:
    """All answers, each sealed."""
    planned, manner = job.planned, job.manner
    first = Round("", ANSWER, diagnosed(place, planned, manner))
    clock("diagnosis")
    beside = None
    if manner.baselines:
        beside = baselines(place, planned, manner)
        clock("baselines")
    seal.answered(place.folder / ANSWER)
    if planned.stratum not in rounds.STRATA:
        return Said((first,), beside=beside)
    later = rounds.held(place, planned, manner, seal)
    clock("rounds")
    return later._replace(rounds=(first, *later.rounds), beside=beside)


def _kept(folder: Path, planned: Planned, record: Mapping[str, Any], times: Mapping[str, float]) -> dict[str, Any]:
    made = {"number": planned.number, "stratum": planned.stratum, "sources": _version(), **record}
    _write(folder / TIMES, times)
    _write(folder / RECORD, made)  # the last file: with it the trial is finished
    return made


@functools.cache
def _version() -> str:
    return sources(*packages())[:12]


def _write(path: Path, content: Any) -> None:
    draft = path.with_suffix(".part")
    draft.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    draft.replace(path)


def judged(place: Place, seal: Seal, scored: Callable[[bytes], dict[str, Any]]) -> dict[str, Any]:
    """The record's content: void, failed or `scored` from the labels."""
    folder = place.folder
    reasons = [f"the diagnosis looked elsewhere: {line}" for line in _lines(folder / LOG)]
    try:
        labels = seal.opened()
    except SealError as error:
        return {"state": VOID, "reasons": [*reasons, str(error)]}
    reasons += broken(folder, answers(folder), place.root / REGISTER)
    return {"state": VOID, "reasons": reasons} if reasons else scored(labels)


def _scored(labels: bytes, place: Place, said: Said) -> dict[str, Any]:
    """The first answer's record; beside it, where more could be asked for, how right each answer was."""
    folder, failure = place.folder, said.rounds[0].failure
    answer = None if failure else scoring.read(folder / ANSWER / "answer.json")
    record = scoring.record(labels, answer, folder / ANSWER / "predictions", folder / CAPTURES)
    state = SCORED if answer is not None else FAILED
    why = [failure or "no answer"] if answer is None else []
    why += [f"after {answered.experiment}: {answered.failure}" for answered in said.rounds[1:] if answered.failure]
    if record["stratum"] in rounds.STRATA:
        record["rounds"] = rounds.scored(labels, place, said.rounds)
    why += filter(None, [said.refused, said.beside])
    beside = scoring.beside(labels, folder, (ANSWER, BLIND)) if said.beside is not None else {}
    return {"state": state, "reasons": why, **record, "baselines": beside}


def _lines(path: Path) -> list[str]:
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return list(dict.fromkeys(lines))[:10]
