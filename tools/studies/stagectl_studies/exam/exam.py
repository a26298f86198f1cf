"""All trials of an exam: in any order, by whoever runs them, as often as a worker dies."""

import json
import shlex
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from stagectl_studies.exam.ground import ground_of
from stagectl_studies.exam.plan import ExamError, Planned, plan
from stagectl_studies.exam.question import Manner
from stagectl_studies.exam.run_trial import TIMES, Job, finished, folder_of

EXAM = "exam.json"
FLAGS = ("short", "full", "baselines")

Record = dict[str, Any]
Runner = Callable[[Sequence[Job]], Iterator[Record]]  # records as they come
Say = Callable[[int, int, Record], None]  # trials done, of how many, the last record


class Asked(NamedTuple):
    """What exam is held."""

    trials: int
    seed: int
    strata: tuple[str, ...] = ()
    on: str = ""  # path of the record on whose friction and noise the trials are drawn; empty: on drawn ones
    stage: str = ""  # path of the stage file of that record


def seed_of(root: Path) -> int | None:
    """The seed of the exam that lies in `root`: to go on with it after the sources have changed.

    Raises ExamError where its description cannot be read.
    """
    before = _before(root)
    return None if before is None else int(before["seed"])


def prepared(root: Path, asked: Asked, manner: Manner, resume: bool) -> list[Planned]:
    """The plan, written down at the first start and compared at a later one.

    Raises ExamError, and writes nothing, where a stratum is none, or where the folder holds another exam, or any
    without `resume`, or none with it.
    """
    planned = plan(asked.trials, asked.seed, asked.strata)
    described, before = _described(asked, manner), _before(root)
    if before is not None and not resume:
        raise ExamError(f"{root} holds an exam already; go on with --resume, or choose another folder")
    if before is None and resume:
        raise ExamError(f"{root} holds no exam to continue: leave out --resume to begin one there")
    if before not in (None, described):
        raise _another(root, before, described)
    ground = ground_of(Path(asked.on), Path(asked.stage)) if asked.on else None
    if before is None:
        root.mkdir(parents=True, exist_ok=True)
        (root / EXAM).write_text(json.dumps(described, indent=1) + "\n", encoding="utf-8")
    return [trial._replace(ground=ground) for trial in planned]


def _another(root: Path, before: Record, described: Record) -> ExamError:
    changed = [name for name in described if before[name] != described[name]]
    words = [f"{_option(name, described[name])} (there: {_option(name, before[name])})" for name in changed]
    return ExamError(
        f"{root} holds another exam: {', '.join(words)}; choose another folder, or: {_again(root, before)}"
    )


def _described(asked: Asked, manner: Manner) -> Record:
    what = {**asked._asdict(), "strata": list(asked.strata)}
    return what | {name: getattr(manner, name) for name in (*FLAGS, "module")}


def _before(root: Path) -> Record | None:
    """The description of the exam that lies in `root`; None where none does."""
    path = root / EXAM
    if not path.exists():
        return None
    try:
        answer: Record = json.loads(path.read_text(encoding="utf-8"))
        wrong = sorted({*_described(Asked(1, 0), Manner())} ^ {*answer})
        int(answer["seed"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ExamError(f"{path} describes no exam: {type(error).__name__}: {error}; choose another folder") from error
    if wrong:
        raise ExamError(f"{path} is of another version, which differs in {', '.join(wrong)}; choose another folder")
    return answer


def _option(name: str, value: Any) -> str:
    """As it is asked for on the command line."""
    if name == "strata":
        return f"--strata {','.join(value)}" if value else "all strata"
    if name in FLAGS:
        return f"--{name}" if value else f"no --{name}"
    return f"--{name} {value}"


def _again(root: Path, before: Record) -> str:
    """The command that goes on with an exam."""
    chosen = [
        _option(name, before[name]) for name in ("trials", "seed", "strata", "on", "stage", *FLAGS) if before[name]
    ]
    return f"stagectl gap exam --resume {' '.join(chosen)} -o {shlex.quote(str(root))}"


def held(root: Path, planned: Sequence[Planned], manner: Manner, run: Runner, say: Say) -> list[Record]:
    """Run every trial that has no record yet; all records in the order of their numbers."""
    waiting = [planned_trial for planned_trial in planned if finished(root, planned_trial.number) is None]
    done = len(planned) - len(waiting)
    for record in run([Job(planned_trial, str(root), manner) for planned_trial in waiting]):
        done += 1
        say(done, len(planned), record)
    return records(root, planned)


def records(root: Path, planned: Sequence[Planned]) -> list[Record]:
    """All records in the order of their numbers; raises ExamError where one is missing."""
    finished_records = [finished(root, planned_trial.number) for planned_trial in planned]
    missing = [str(trial.number) for trial, record in zip(planned, finished_records, strict=True) if record is None]
    if missing:
        raise ExamError(f"{root}: the trials {', '.join(missing)} are not finished; go on with --resume")
    return [record for record in finished_records if record is not None]


def seconds(root: Path, planned: Sequence[Planned]) -> dict[str, list[float]]:
    """Seconds of staging, diagnosis and scoring, of each trial; beside the scores, as no two exams agree in them."""
    by_step: dict[str, list[float]] = {}
    for planned_trial in planned:
        path = folder_of(root, planned_trial.number) / TIMES
        times = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        for name, took in times.items():
            by_step.setdefault(name, []).append(took)
    return by_step
