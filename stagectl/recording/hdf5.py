"""The recording file: HDF5, written block by block so that a crash costs the last block at most.

::

    /               format, created, complete, ended, lost_rows     (attributes)
                    meta: JSON - name, axis, dt, nd, nm, law, steady window, versions, drive, config files
    /samples  (n,)  one compound row per control period, float64 columns in SI units; unit and meaning of
                    each column as JSON in its attributes

While it is written the file is in SWMR mode: others may read along.  If the writer dies, HDF5 leaves a mark that
it is still open; `open_recording` then rewrites the file once, whole.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from stagectl.kernels import law, rollout
from stagectl.units import Quantity, StageError, quantity_of

FORMAT = "stagectl-recording/1"
BLOCK = 512  # rows: chunk size, and what a crash costs at most


class RecordingError(StageError):
    """A file that is no recording, or one that lacks what was asked for."""


class Recording(NamedTuple):
    """A recording in memory."""

    path: Path
    meta: dict[str, Any]
    samples: NDArray[Any]  # (n,) structured, one float64 field per column
    complete: bool  # written to its end
    ended: str  # why it ended, in words
    lost_rows: int

    def column(self, name: str) -> NDArray[np.float64]:
        """One column, (n,), SI.

        Raises RecordingError naming the columns there are.
        """
        if name not in (self.samples.dtype.names or ()):
            raise RecordingError(
                f"{self.path} has no column {name}; it has {', '.join(self.samples.dtype.names or ())}"
            )
        return np.asarray(self.samples[name], dtype=np.float64)


def quantities() -> dict[str, Quantity]:
    """Unit and meaning of every column, as declared beside the kernels' fields."""
    found = {"time": Quantity("s", "[-inf, inf]", "start of the period, 0 at the first row")}
    for block in (law.Setpoint, law.Output, rollout.Observed):
        for name, hint in _hints(block).items():
            quantity = quantity_of(hint)
            assert quantity is not None
            found[name] = quantity
    return found


def _hints(block: type) -> dict[str, Any]:
    from typing import get_type_hints

    return get_type_hints(block, include_extras=True)


class Writer:
    """A recording being written."""

    def __init__(self, path: Path, meta: dict[str, Any], columns: tuple[str, ...]) -> None:
        self.path = path
        self._dtype = np.dtype([(name, "<f8") for name in columns])
        self._held = _claimed(path)
        self._file = h5py.File(path, "w", libver="latest")
        self._file.attrs.update({"format": FORMAT, "created": meta["created"], "meta": json.dumps(meta)})
        self._samples = self._file.create_dataset("samples", (0,), self._dtype, maxshape=(None,), chunks=(BLOCK,))
        self._samples.attrs.update(_column_attributes(meta["axis"], columns))
        self._file.flush()
        self._file.swmr_mode = True
        fcntl.lockf(self._held, fcntl.LOCK_EX)  # again: it goes whenever HDF5 closes a descriptor of the file

    def append(self, rows: bytes) -> None:
        """Add whole rows (float64, column after column) and push them to the disk's cache."""
        block = np.frombuffer(rows, dtype=self._dtype)
        size = self._samples.shape[0]
        self._samples.resize((size + len(block),))
        try:
            self._samples[size:] = block
            self._samples.flush()
        except OSError:
            self._samples.resize((size,))  # no rows of zeros where the disk was full
            raise

    def close(self, ended: str, lost_rows: int, complete: bool = True) -> None:
        """Finish the file, with the reason it ended."""
        self._file.close()
        self._held.close()
        with h5py.File(self.path, "r+", libver="latest") as file:
            file.attrs.update({"complete": complete, "ended": ended, "lost_rows": lost_rows})


def _column_attributes(axis: dict[str, Any], columns: tuple[str, ...]) -> dict[str, str]:
    known = quantities()
    units = {name: known[name].unit_for(axis["kind"]) for name in columns if name in known}
    return {"units": json.dumps(units), "meanings": json.dumps({n: known[n].meaning for n in units})}


def _claimed(path: Path) -> IO[bytes]:
    """The file, locked for as long as its writer lives; HDF5 itself gives its lock up in SWMR mode.

    Raises RecordingError where another writer has it, or it cannot be written.
    """
    if path.is_file() and path.stat().st_size and not _ours(path):
        raise RecordingError(f"{path} is no recording and is left as it is: choose another file with -o")
    try:
        file = path.open("ab")
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {error.strerror}; choose another file with -o") from error
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        file.close()
        raise RecordingError(f"{path} is being written by another run: choose another file with -o") from error
    return file


def _ours(path: Path) -> bool:
    """Whether a file may be written over: a recording, whole or cut off."""
    try:
        with _opened(path) as file:
            return str(file.attrs.get("format")) == FORMAT
    except RecordingError:
        return False


def _being_written(path: Path) -> bool:
    try:
        _claimed(path).close()
    except RecordingError:
        return True
    return False


def save(path: Path, meta: dict[str, Any], samples: NDArray[Any], ended: str, complete: bool = True) -> None:
    """Write a whole recording at once (a simulation, an import); `samples` is structured or (n, width)."""
    names = samples.dtype.names or rollout.COLUMNS
    writer = Writer(path, meta, tuple(names))
    writer.append(np.ascontiguousarray(samples).tobytes())
    writer.close(ended, 0, complete)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    try:
        file = h5py.File(path, "r")
    except OSError as first:
        if not path.is_file():
            raise RecordingError(f"{path}: no such recording") from first
        try:
            file = h5py.File(path, "r", libver="latest", swmr=True)
        except OSError as error:
            raise RecordingError(f"{path} is no HDF5 file, or it is damaged: {error}") from error
    try:
        yield file
    finally:
        file.close()


def open_recording(path: Path, only: Collection[str] = ()) -> Recording:
    """Read a recording, also one whose writer was killed or is still at work; of the columns those named in `only`.

    Raises RecordingError where the file is no recording of ours.
    """
    with _opened(path) as file:
        if file.attrs.get("format") != FORMAT or "samples" not in file:
            raise RecordingError(f"{path} is no stagectl recording; `stagectl import` brings other logs in")
        complete = bool(file.attrs.get("complete", False))
        ended = str(file.attrs.get("ended", "the recorder was cut off: the rows end at its last block"))
        lost = int(file.attrs.get("lost_rows", 0))
        names = [name for name in file["samples"].dtype.names if not only or name in only]
        samples = file["samples"].fields(names)[:] if only else file["samples"][:]
        return Recording(path, json.loads(file.attrs["meta"]), samples, complete, ended, lost)


def repair(path: Path) -> bool:
    """Rewrite a file that a crash left marked as open, so that any HDF5 tool reads it; True if it was.

    A file whose writer is alive is left alone.  Raises RecordingError where it is damaged beyond its mark.
    """
    try:
        h5py.File(path, "r").close()
        return False
    except OSError:
        if _being_written(path):
            return False
        recording = open_recording(path)
    fresh = path.with_suffix(".repaired")
    save(fresh, recording.meta, recording.samples, recording.ended, complete=False)
    os.replace(fresh, path)
    return True
