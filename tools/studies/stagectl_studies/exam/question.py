"""A question put to a program under watch: its own folders, its own cores, its own time."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import stagectl
import stagectl_studies
from stagectl_studies.exam.plan import ExamError, Planned
from stagectl_studies.exam.sandbox import OUT_OF_MEMORY

CAPTURES, ANSWER, TOLD, SCRATCH = "captures", "answer", "told", "scratch"
LOG, OUTPUT = "diagnosis.log", "output.txt"
BLIND = ("refit", "ladder", "sparse", "blackbox")  # baselines that are told nothing
ORACLE = "oracle"
ENDED_FROM_OUTSIDE = frozenset(  # by a user, a system that shuts down, or one that is short of memory
    {-signal.SIGINT, -signal.SIGTERM, -signal.SIGHUP, -signal.SIGKILL, OUT_OF_MEMORY}
)


class InterruptionError(ExamError):
    """A program that was ended from outside: nothing is known of what it would have said."""


class Manner(NamedTuple):
    """How the trials of an exam are held."""

    short: bool = False
    full: bool = False  # the diagnosis' full path
    keep: bool = False  # captures, after scoring
    baselines: bool = False
    threads: int = 1  # cores of each diagnosis
    timeout: float = 3600.0  # s of one diagnosis
    module: str = "stagectl"  # what answers: run as `python -m MODULE gap diagnose ...`
    code: str = ""  # folder in which another module than ours lies


class Place(NamedTuple):
    """Where a trial lies, and on which cores it is answered."""

    root: Path  # of the exam
    folder: Path  # of the trial
    cores: tuple[int, ...]  # none: any
    out: str = ANSWER  # where the answer goes, below `folder`


def answers(folder: Path) -> list[Path]:
    """Folders of all answers of a trial, in their order."""
    return sorted(path for path in folder.glob(f"{ANSWER}*") if path.is_dir())


def diagnosed(place: Place, planned: Planned, manner: Manner) -> str:
    """The diagnosis; why it failed, empty where it did not."""
    answer = place.folder / place.out
    words = ["gap", "diagnose", str(place.folder / CAPTURES), "--json", str(answer / "answer.json")]
    words += ["--predictions", str(answer / "predictions"), "-o", str(answer)]
    words += ["--report", str(answer / "page.html")] + (["--full"] if manner.full else [])
    words += ["--exclude", ",".join(planned.exclude)] if planned.exclude else []
    failure = asked(place, manner.module, words, manner)
    (answer / "page.html").unlink(missing_ok=True)
    return failure


def baselines(place: Place, planned: Planned, manner: Manner, names: Sequence[str] = ()) -> str:
    """The baselines that are told nothing or, where the truth is `told`, the oracle."""
    place = place._replace(out=TOLD) if names else place
    words = [str(place.folder / CAPTURES), str(place.folder / place.out), *([ORACLE] if names else BLIND)]
    words += ["--exclude", ",".join(planned.exclude)] if planned.exclude and not names else []
    words += ["--told", ",".join(names)] if names else []
    return asked(place, "stagectl_studies.baselines", words, manner)


def asked(place: Place, module: str, words: Sequence[str], manner: Manner) -> str:
    """Run `module` under watch; why it failed, empty where it did not.

    Raises InterruptionError where it was ended from outside, or out of memory.
    """
    out, scratch = place.folder / place.out, place.folder / SCRATCH
    written = [str(out), str(scratch), *filter(None, [manner.code])]
    for folder in (out, scratch):
        folder.mkdir(exist_ok=True)
    command = [sys.executable, "-m", f"{__package__}.sandbox", str(place.folder / LOG), "--module", module]
    command += ["--parent", str(os.getpid())]
    command += ["--own", str(place.folder / CAPTURES), *(word for folder in written for word in ("--out", folder))]
    command += ["--closed", str(place.root), "--", *words]
    output = place.folder / OUTPUT
    with output.open("ab") as file:
        child = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            cwd=scratch,
            env=surroundings(scratch, manner),
        )
        try:
            _bound(child.pid, place.cores)
            code = child.wait(manner.timeout)
        except subprocess.TimeoutExpired:
            return f"{module} took more than {manner.timeout:g} s"
        finally:
            child.kill()
            child.wait()
            shutil.rmtree(scratch, ignore_errors=True)
    if code in ENDED_FROM_OUTSIDE:
        raise InterruptionError(f"{module} was interrupted, with code {code}: {_last(output)}")
    return "" if code == 0 else f"{module} ended with code {code}: {_last(output)}"


def _bound(process: int, cores: Sequence[int]) -> None:
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(process, cores)


def surroundings(scratch: Path, manner: Manner) -> dict[str, str]:
    """Environment of an answer: this package is found wherever it runs, and its temporary files are its own."""
    packages = [str(Path(file).resolve().parents[1]) for file in (stagectl.__file__, stagectl_studies.__file__)]
    places = [*packages, manner.code, *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    path = os.pathsep.join(dict.fromkeys(filter(None, places)))
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    return {**os.environ, **threads, "PYTHONPATH": path, "TMPDIR": str(scratch), "PYTHONDONTWRITEBYTECODE": "1"}


def _last(path: Path) -> str:
    lines = path.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return lines[-1][-300:] if lines else "nothing was said"
