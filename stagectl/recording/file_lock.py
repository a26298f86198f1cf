"""Whose a recording's file is, and what a writer that was killed has left of it.

::

    NAME.begun   locked, being laid out: no HDF5 file yet.  A writer that is killed here leaves that: `discard`
    NAME         renamed, locked, can be read; rows follow.  One that is killed here leaves its rows: `hdf5.repair`

The lock is one of the open file (`F_OFD_SETLK`): HDF5 gives its own up in SWMR mode, and a lock of the process would go
whenever HDF5 closes another descriptor of the file.
"""

import contextlib
import fcntl
import os
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from stagectl.problem import Problem, ProblemKind, remedy_of, why_unread
from stagectl.recording.constants import LOCK_PAUSE, LOCK_TRIES
from stagectl.units import StageError

BEGUN = ".begun"  # behind the name of a file that cannot be read yet
_WHOLE_FILE = struct.pack("hhqqi0q", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)  # struct flock


class DataFileError(StageError):
    """A file of data that cannot be used.  A plain text becomes a problem of this `file` and `kind`."""

    def __init__(
        self,
        problem: Problem | str,
        file: Path | None = None,
        kind: ProblemKind = ProblemKind.OTHER,
        column: str = "",
        row: int = 0,
    ) -> None:
        super().__init__(Problem(problem, kind, file=file) if isinstance(problem, str) else problem)
        self.column, self.row = column, row  # what it is about; the first row of numbers is 1, and 0 is none

    @classmethod
    @contextlib.contextmanager
    def instead_of(
        cls, causes: tuple[type[Exception], ...], words: str, file: Path, kind: ProblemKind, advice: str = ""
    ) -> Iterator[None]:
        """Turn one of the `causes` inside into this error: `words`, the cause's own reason, and advice, ours or its."""
        try:
            yield
        except causes as cause:
            remedy = remedy_of(cause)
            raise cls(f"{words}: {why_unread(cause)}{advice or (remedy and f'; {remedy}')}", file, kind) from cause


class RecordingError(DataFileError):
    """A file that is not a recording, or a recording without something that is needed."""


def beginning(path: Path) -> Path:
    """Where a recording is until it can be read."""
    return path.with_name(path.name + BEGUN)


def claimed(path: Path) -> IO[bytes]:
    """The beginning of a recording, empty, and locked for as long as its writer lives, under its later name, too.

    Raises RecordingError where another writer has it, or it cannot be written.
    """
    file = _first(path)
    try:  # with the lock in hand: nobody can rename another beginning to it meanwhile
        if being_written(path):
            raise _taken(path)
        os.ftruncate(file.fileno(), 0)
    except (OSError, RecordingError) as error:
        beginning(path).unlink()
        file.close()
        raise error if isinstance(error, RecordingError) else _unwritable(path, error) from error
    return file


def being_written(path: Path) -> bool:
    """Whether a writer is at work on this file.  Raises OSError where it is none that could be written to."""
    try:
        with path.open("r+b") as file:
            return not _locks(file)
    except FileNotFoundError:
        return False


def discard(path: Path) -> bool:
    """Take away the beginning of a recording whose writer was killed over it; False where there is none to take."""
    try:
        with beginning(path).open("r+b") as file:
            if _locks(file):
                beginning(path).unlink()
                return True
    except FileNotFoundError:
        pass
    return False


def sweep(folder: Path) -> None:
    """Take away what writers that were killed have begun in this folder."""
    for left in folder.glob(f"*{BEGUN}"):
        discard(left.with_suffix(""))


def _first(path: Path) -> IO[bytes]:
    for _ in range(LOCK_TRIES):
        try:
            file = os.fdopen(os.open(beginning(path), os.O_RDWR | os.O_CREAT, 0o666), "r+b")
        except OSError as error:
            raise _unwritable(path, error) from error
        if _locks(file) and _still(beginning(path), file):
            return file
        file.close()
        time.sleep(LOCK_PAUSE)
    raise _taken(path)


def _unwritable(path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        f"{path} cannot be written: {error.strerror}; choose another file with -o", path, ProblemKind.FILE
    )


def _taken(path: Path) -> RecordingError:
    return RecordingError(
        f"{path} is being written by another run: choose another file with -o", path, ProblemKind.CONFLICT
    )


def _locks(file: IO[bytes]) -> bool:
    """Lock it; False where another open file has the lock."""
    try:
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, _WHOLE_FILE)
    except (BlockingIOError, PermissionError):
        return False
    return True


def _still(path: Path, file: IO[bytes]) -> bool:
    """Whether the file has that name: another writer may have renamed it before it gave up its lock."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False
