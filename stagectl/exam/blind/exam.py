"""All trials of an exam: in any order, by whoever runs them, as often as a worker dies."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from .asking import Manner
from .plan import ExamError, Planned, plan
from .sitting import TIMES, Job, finished, folder_of

EXAM = "exam.json"

Record = dict[str, Any]
Runner = Callable[[Sequence[Job]], Iterator[Record]]  # records as they come
Say = Callable[[int, int, Record], None]  # trials done, of how many, the last record


class Asked(NamedTuple):
    """What exam is held."""

    trials: int
    seed: int
    strata: tuple[str, ...] = ()


def seed_of(root: Path) -> int | None:
    """The seed of the exam that lies in `root`: to go on with it after the sources have changed."""
    path = root / EXAM
    return int(json.loads(path.read_text(encoding="utf-8"))["seed"]) if path.exists() else None


def prepared(root: Path, asked: Asked, manner: Manner, resume: bool) -> list[Planned]:
    """The plan, written down at the first start and compared at a later one.

    Raises ExamError where the folder holds another exam, or any without `resume`.
    """
    path, described = root / EXAM, _described(asked, manner)
    if path.exists():
        if not resume:
            raise ExamError(f"{root} holds an exam already; go on with --resume, or choose another folder")
        before = json.loads(path.read_text(encoding="utf-8"))
        changed = sorted(name for name in described if before.get(name) != described[name])
        if changed:
            raise ExamError(f"{root} holds another exam: {', '.join(changed)} differ; choose another folder")
    root.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(described, indent=1) + "\n", encoding="utf-8")
    return plan(asked.trials, asked.seed, asked.strata)


def _described(asked: Asked, manner: Manner) -> Record:
    what = {**asked._asdict(), "strata": list(asked.strata)}
    kept = ("short", "full", "baselines", "module")
    return what | {name: getattr(manner, name) for name in kept}


def held(root: Path, planned: Sequence[Planned], manner: Manner, run: Runner, say: Say) -> list[Record]:
    """Run every trial that has no record yet; all records in the order of their numbers."""
    waiting = [one for one in planned if finished(root, one.number) is None]
    done = len(planned) - len(waiting)
    for record in run([Job(one, str(root), manner) for one in waiting]):
        done += 1
        say(done, len(planned), record)
    return records(root, planned)


def records(root: Path, planned: Sequence[Planned]) -> list[Record]:
    """All records in the order of their numbers; raises ExamError where one is missing."""
    found = [finished(root, one.number) for one in planned]
    missing = [str(one.number) for one, record in zip(planned, found, strict=True) if record is None]
    if missing:
        raise ExamError(f"{root}: the trials {', '.join(missing)} are not finished; go on with --resume")
    return [one for one in found if one is not None]


def seconds(root: Path, planned: Sequence[Planned]) -> dict[str, list[float]]:
    """Seconds of staging, diagnosis and scoring, of each trial; beside the scores, as no two exams agree in them."""
    found: dict[str, list[float]] = {}
    for one in planned:
        path = folder_of(root, one.number) / TIMES
        times = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        for name, took in times.items():
            found.setdefault(name, []).append(took)
    return found
