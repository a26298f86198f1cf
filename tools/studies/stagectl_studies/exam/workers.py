"""The local pool: each trial in a process of its own, so that one that dies takes no other with it."""

import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from stagectl_studies.exam.cores import available
from stagectl_studies.exam.plan import ExamError
from stagectl_studies.exam.question import OUTPUT, InterruptionError
from stagectl_studies.exam.run_trial import Job, finished_job, folder_of, sit
from stagectl_studies.exam.sandbox import die_with

ATTEMPTS = 3  # of a trial whose worker dies
_LOOK = 0.2  # s


def workers_and_threads(workers: int | None) -> tuple[int, int]:
    """How many trials at once, and cores for each diagnosis; by default one core each."""
    cores = max(len(available()) or os.cpu_count() or 1, 1)
    count = workers or cores
    return count, max(cores // count, 1)


def local(jobs: Sequence[Job], workers: int) -> Iterator[dict[str, Any]]:
    """Records of all jobs as they come, `workers` at once.

    Raises ExamError, after all the others, for the trials whose workers died each time.
    """
    stop = threading.Event()
    lost: list[str] = []
    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(apart, job, stop) for job in jobs]
        try:
            for future in as_completed(futures):
                if isinstance(error := future.exception(), ExamError):
                    lost.append(str(error))
                else:
                    yield future.result()
        except BaseException:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    if lost:
        raise ExamError(f"{'; '.join(lost)}; go on with --resume")


def apart(job: Job, stop: threading.Event) -> dict[str, Any]:
    """The record of a job that a process of its own has run; what a dying one began is begun again."""
    for _ in range(ATTEMPTS):
        process = multiprocessing.get_context("spawn").Process(target=_quietly, args=(job,))
        process.start()
        while process.is_alive() and not stop.is_set():
            process.join(_LOOK)
        if stop.is_set():
            process.terminate()
            process.join()
            break
        record = finished_job(job)
        if record is not None:
            return record
    output = folder_of(Path(job.root), job.planned.number) / OUTPUT
    raise ExamError(
        f"trial {job.planned.number} has no record: its worker died {ATTEMPTS} times, the last time with code "
        f"{process.exitcode} (see {output})"
    )


def _quietly(job: Job) -> None:
    """Ctrl-C is the matter of the process that began this one, with which it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    beginner = multiprocessing.parent_process()
    die_with(beginner.pid if beginner is not None else None)
    try:
        sit(job)
    except InterruptionError as error:
        sys.exit(f"trial {job.planned.number} is to be run again: {error}")
    except Exception:
        output = folder_of(Path(job.root), job.planned.number) / OUTPUT
        output.parent.mkdir(parents=True, exist_ok=True)
        with output.open("a", encoding="utf-8") as file:
            traceback.print_exc(file=file)
        raise
