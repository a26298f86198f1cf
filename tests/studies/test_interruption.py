"""A diagnosis that is ended from outside leaves no record: the trial is run again, and none is lost."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from stagectl_studies.exam import exam, run_trial, workers
from stagectl_studies.exam.plan import ExamError, Planned
from stagectl_studies.exam.question import ANSWER, CAPTURES, InterruptionError, Manner, Place, asked
from stagectl_studies.exam.run_trial import Job, finished_job, sit
from stagectl_studies.exam.workers import local

from tests.conftest import SOURCES

ANSWERING = Path(__file__).parent / "answering"
PLANNED = Planned(1, "null-exact", 5)
HANGS = 300.0  # s: what takes longer does not end; below the 600 s after which the patient ends by itself


def says(folder: Path, line: str) -> Manner:
    """A module that runs this line in place of the diagnosis."""
    folder.mkdir()
    (folder / "ends.py").write_text(f"import os, signal, sys, time\n{line}\n")
    return Manner(short=True, module="ends", code=str(folder))


def ended(tmp_path: Path, line: str, timeout: float | None = None) -> str:
    trial = tmp_path / "trials" / "0001"
    (trial / CAPTURES).mkdir(parents=True)
    manner = says(tmp_path / "code", line)
    manner = manner if timeout is None else manner._replace(timeout=timeout)
    return asked(Place(tmp_path, trial, ()), "ends", [], manner)


@pytest.mark.parametrize(
    "line",
    [
        "os.kill(os.getpid(), signal.SIGKILL)",
        "os.kill(os.getpid(), signal.SIGTERM)",
        "try:\n    os.kill(os.getpid(), signal.SIGINT); time.sleep(9)\nexcept KeyboardInterrupt:\n    sys.exit(1)",
        "raise MemoryError",
        "import numpy; numpy.zeros(1 << 50)",
    ],
)
def test_ended_from_outside(tmp_path: Path, line: str) -> None:
    """Also where the program would make an exit code of Ctrl-C that says nothing of it."""
    with pytest.raises(InterruptionError, match="ends was interrupted, with code"):
        ended(tmp_path, line)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", "code -11"),
        ("sys.exit(2)", "code 2"),
        ("raise ValueError('no')", "code 1: ValueError: no"),
    ],
)
def test_ended_by_itself(tmp_path: Path, line: str, why: str) -> None:
    """A crash and an error are the diagnosis' own: they count."""
    assert why in ended(tmp_path, line)


def test_one_that_takes_for_ever(tmp_path: Path) -> None:
    """It counts, too; its progress within that time makes no difference."""
    assert "more than 2 s" in ended(tmp_path, "while True: time.sleep(60)", 2.0)


def staged(_: Planned, folder: Path, __: bool) -> bytes:
    (folder / CAPTURES).mkdir()
    return b"truth"


def test_no_record_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_trial, "staged", staged)
    job = Job(PLANNED, str(tmp_path), says(tmp_path / "code", "raise MemoryError"))
    with pytest.raises(InterruptionError, match="out of memory"):
        sit(job)
    assert (tmp_path / "trials" / "0001" / ANSWER).is_dir() and finished_job(job) is None
    with pytest.raises(ExamError, match="the trials 1 are not finished; go on with --resume"):
        exam.records(tmp_path, [PLANNED])


def test_one_that_always_dies_holds_up_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def apart(job: Job, _: object) -> dict[str, int]:
        if job.planned.number == 1:
            raise ExamError("trial 1 has no record")
        return {"number": job.planned.number}

    monkeypatch.setattr(workers, "apart", apart)
    coming = local([Job(PLANNED._replace(number=number), str(tmp_path), Manner()) for number in (1, 2, 3)], 1)
    assert sorted(next(coming)["number"] for _ in "23") == [2, 3]
    with pytest.raises(ExamError, match="trial 1 has no record; go on with --resume"):
        next(coming)


BESIDE = """
from stagectl_studies.exam.question import Manner
from stagectl_studies.exam.plan import Planned
from stagectl_studies.exam.run_trial import Job
from stagectl_studies.exam.workers import local

if __name__ == "__main__":
    list(local([Job(Planned(1, "null-exact", 5), {root!r}, Manner(short=True, module="patient", code={code!r}))], 1))
"""


def until(true: Callable[[], bool]) -> None:
    """Wait for it; what does not come at all fails."""
    end = time.monotonic() + HANGS
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


def patient_of(code: Path, exam_process: subprocess.Popen[bytes]) -> int:
    """Process id of the diagnosis, which it writes down; the exam must not end before."""
    note = code / "process"
    while not (note.exists() and note.read_text()):
        assert exam_process.poll() is None
        time.sleep(0.05)
    return int(note.read_text())


def lives(process: int) -> bool:
    """Whether it runs; who has ended and is not yet waited for does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="processes end with the one that began them on Linux alone")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_exam_that_is_ended_takes_its_diagnosis_along(tmp_path: Path, how: signal.Signals) -> None:
    """By Ctrl-C in a terminal, which goes to all of its processes, or by SIGKILL to the first of them alone."""
    code, root = tmp_path / "code", tmp_path / "exam"
    code.mkdir()
    root.mkdir()
    (code / "patient.py").write_bytes((ANSWERING / "patient.py").read_bytes())
    script = tmp_path / "beside.py"
    script.write_text(BESIDE.format(root=str(root), code=str(code)))
    surroundings = {**os.environ, "PYTHONPATH": SOURCES}
    held = subprocess.Popen(
        [sys.executable, str(script)], env=surroundings, start_new_session=True, stderr=subprocess.DEVNULL
    )
    try:
        patient = patient_of(code, held)
        os.killpg(held.pid, how) if how == signal.SIGINT else held.send_signal(how)
        assert held.wait(HANGS) != 0
        until(lambda: not lives(patient))
    finally:
        held.kill()
        held.wait()
    assert finished_job(Job(PLANNED, str(root), Manner())) is None
    assert (root / "trials" / "0001" / "journal.json").exists()
