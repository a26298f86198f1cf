"""The recording file: HDF5, written block by block so that a crash costs the last block at most.

::

    /               format, created, complete, ended, lost_rows, gaps     (attributes)
                    meta: JSON - name, axis, dt, nd, nm, law, steady window, versions, drive, config files
    /samples        one row per control period, float64 columns in SI units; unit and meaning of each column as
                    JSON in its attributes; packed without loss, by filters that every HDF5 has.  What follows from
                    other columns stands beside it, see `packing`

It appears under its name when it can be read, see `claim`.  While it is written it is in SWMR mode: others may read
along.  If the writer dies, HDF5 leaves a mark that it is still open; `repair` then rewrites the file once, whole.

HDF5 does not survive a write that fails.  So the room for each block is taken from the file system beforehand, and
what the end has to say is there from the beginning, as long as it can get: a disk that is full costs rows, no file.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from stagectl.kernels import rollout
from stagectl.problem import ProblemKind, absent
from stagectl.recording.constants import BLOCK, GAPS, LONGEST_REASON, ROOM_AT_ONCE, ROOM_PER_BLOCK
from stagectl.recording.content import HDF5_SIGNATURE, foreign, not_hdf5
from stagectl.recording.file_lock import RecordingError as RecordingError
from stagectl.recording.file_lock import beginning, being_written, claimed
from stagectl.recording.in_memory import Recording as Recording
from stagectl.recording.in_memory import column_attributes, of_a_machine
from stagectl.recording.in_memory import quantities as quantities
from stagectl.recording.packing import Packed, Packer, layout
from stagectl.replacing import check_ending, check_is_file, check_replaceable, left_as_it_is
from stagectl.units import StageError

FORMAT, _READ = "stagectl-recording/2", ("stagectl-recording/1", "stagectl-recording/2")
_HDF5, _HEAD = HDF5_SIGNATURE + b"\x03", struct.Struct("<12s16xQ")  # signature and version 3; the end of the file
_CUT_OFF = "the recorder was cut off: the rows end at its last block"


class DamagedError(RecordingError):
    """A disk that failed while HDF5 wrote: nothing more can go into this file."""


class Writer:
    """A recording being written: it has its name once it can be read, or, `whole`, once it is closed."""

    def __init__(self, path: Path, meta: dict[str, Any], columns: tuple[str, ...], whole: bool = False) -> None:
        self.path = path
        _check_kind(path)
        self._place = path.resolve()  # a link stays one
        self._held, self._room, self._whole = claimed(self._place), 0, whole
        try:
            self._lay_out(beginning(self._place), meta, columns)
            if not whole:
                os.replace(beginning(self._place), self._place)
        except (OSError, RuntimeError, RecordingError):
            self.drop()
            raise

    def drop(self) -> None:
        """Leave nothing of a recording that has no name yet; what had the name before is as it was."""
        beginning(self._place).unlink(missing_ok=True)
        self._held.close()

    def _lay_out(self, place: Path, meta: dict[str, Any], columns: tuple[str, ...]) -> None:
        """All that makes it a file that can be read, and room for the first rows."""
        self._reserve(ROOM_AT_ONCE)
        self._file = h5py.File(place, "w", libver="latest")
        self._file.attrs.update({"format": FORMAT, "created": meta["created"], "meta": json.dumps(meta)})
        self._file.attrs.update(_ending(_CUT_OFF, False, 0, ()))
        self._packer = Packer(self._file, layout(meta, columns), columns)
        self._packer.samples.attrs.update(column_attributes(meta["axis"], columns))
        self._file.flush()
        self._file.swmr_mode = True
        self._room = os.fstat(self._held.fileno()).st_size
        self._reserve(self._room + ROOM_AT_ONCE)

    def append(self, rows: bytes) -> None:
        """Add whole rows (float64, column after column) and push them to the disk's cache.

        Raises RecordingError where there is no room now, and DamagedError where the file is lost for good.
        """
        blocks = 1 + len(rows) // (BLOCK * self._packer.row)
        self._reserve(self._file.id.get_filesize() + self._packer.room(rows) + ROOM_PER_BLOCK * blocks)
        with self._damaged_by("written to"):
            self._packer.append(rows)

    def close(self, ended: str, lost_rows: int, complete: bool = True, gaps: Gaps = ()) -> None:
        """Finish the file, with the reason of its end and what is lost; in place, as there may be no room for more.

        Raises DamagedError.
        """
        with self._damaged_by("closed"):
            for name, value in _ending(ended, complete, lost_rows, gaps).items():
                self._file.attrs.modify(name, value)
            self._file.close()
            written = beginning(self._place) if self._whole else self._place
            os.ftruncate(self._held.fileno(), _end_of(written))  # what was reserved and not needed
            if self._whole:
                os.fsync(self._held.fileno())
                os.replace(written, self._place)
        self._held.close()

    def _damaged_by(self, action: str) -> contextlib.AbstractContextManager[None]:
        words = f"{self.path}: the disk failed while it was {action}"
        return DamagedError.instead_of((OSError, RuntimeError), words, self.path, ProblemKind.FILE)

    def _reserve(self, end: int) -> None:
        """Take room up to this byte of the file; rows that pack well leave some.  Raises RecordingError."""
        if end <= self._room:
            return
        words, advice = f"{self.path} cannot be written", "; make room, or choose another disk"
        with RecordingError.instead_of((OSError,), words, self.path, ProblemKind.FILE, advice):
            os.posix_fallocate(self._held.fileno(), self._room, end - self._room)
        self._room = end


Gaps = Sequence[tuple[int, int]]


def _ending(ended: str, complete: bool, lost_rows: int, gaps: Gaps) -> dict[str, Any]:
    """What is known at the end only, each as long as it can get."""
    marked = np.zeros((GAPS, 2), np.int64)
    if gaps:
        marked[: len(gaps[:GAPS])] = gaps[:GAPS]
    marked[-1, 1] += sum(count for _, count in gaps[GAPS:])
    text = np.array(ended.encode()[:LONGEST_REASON], dtype=f"S{LONGEST_REASON}")
    return {"complete": np.bool_(complete), "ended": text, "lost_rows": np.int64(lost_rows), "gaps": marked}


def _ours(path: Path) -> bool:
    """Whether a file may be written over: a recording, whole or cut off."""
    try:
        with _opened(path) as file:
            return str(file.attrs.get("format")) in _READ
    except RecordingError:
        return False


def check_name(path: Path) -> None:
    """Raise RecordingError where a recording of this name would be taken for something else."""
    with _of_recordings():
        check_ending(path, ".h5", "a recording")


def check_target(path: Path) -> None:
    """Raise RecordingError where no recording can be written: for its name, or for what is there."""
    check_name(path)
    _check_kind(path)
    if path.is_file() and path.stat().st_size:
        with _of_recordings(), _opened(path) as file:
            if of_a_machine(json.loads(file.attrs["meta"])):  # a simulation is soon repeated, and that is not
                raise left_as_it_is(path, "holds what a machine has done")


def _check_kind(path: Path) -> None:
    with _of_recordings():
        check_is_file(path)
        check_replaceable(path, _ours)


@contextlib.contextmanager
def _of_recordings() -> Iterator[None]:
    try:
        yield
    except StageError as error:
        raise RecordingError(error.problems[0]) from error


def save(path: Path, meta: dict[str, Any], samples: NDArray[Any], ended: str, complete: bool = True) -> None:
    """Write a whole recording at once (a simulation, an import); `samples` is structured or (n, width).

    Raises RecordingError where it cannot be written; a recording that was there is then as it was.
    """
    writer = Writer(path, meta, tuple(samples.dtype.names or rollout.COLUMNS), whole=True)
    try:
        writer.append(np.ascontiguousarray(samples).tobytes())
        writer.close(ended, 0, complete)
    except BaseException:
        writer.drop()
        raise


def _not_cut_short(path: Path) -> None:
    """HDF5 would look for the missing end without an end of its own.  Raises RecordingError.

    While the file is being written its end is ahead of its size now and then.
    """
    with contextlib.suppress(OSError):  # of a file that may only be read
        if being_written(path):
            return
    size, end = path.stat().st_size, _end_of(path)
    if size < end:
        reason = f"{path} has {size} of {end} bytes: it was cut short; copy it again"
        raise RecordingError(reason, path, ProblemKind.SYNTAX)


def _end_of(path: Path) -> int:
    """Where a file says that it ends (byte; HDF5 specification, superblock version 3); 0 where it is none of ours."""
    with path.open("rb") as file:
        head = file.read(_HEAD.size)
    end = int(_HEAD.unpack(head)[-1]) if len(head) == _HEAD.size else _HEAD.size
    return end if head.startswith(_HDF5) else 0


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    try:
        file = h5py.File(path, "r")
    except OSError as first:
        if not path.is_file():
            raise RecordingError(f"{path}: {absent(path)}", path, ProblemKind.FILE) from first
        if not path.stat().st_size:
            reason = f"{path} is empty: nothing was recorded, or the copy failed; copy it again"
            raise RecordingError(reason, path, ProblemKind.SYNTAX) from first
        _not_cut_short(path)
        try:
            file = h5py.File(path, "r", libver="latest", swmr=True)
        except OSError as error:
            raise RecordingError(f"{path} {not_hdf5(path)}", path, ProblemKind.SYNTAX) from error
    words, advice = f"{path} is damaged", ": copy it again"
    try:
        with RecordingError.instead_of((OSError,), words, path, ProblemKind.SYNTAX, advice):
            yield file
    finally:
        file.close()


def open_recording(path: Path, only: Collection[str] = ()) -> Recording:
    """Read a recording, also one whose writer was killed or is still at work; of the columns those named in `only`.

    Raises RecordingError where the file is not a recording of ours.
    """
    with _opened(path) as file:
        if file.attrs.get("format") not in _READ or "samples" not in file:
            raise RecordingError(f"{path} {_strange(file)}", path, ProblemKind.SYNTAX)
        complete = bool(file.attrs.get("complete", False))
        ended = file.attrs.get("ended", _CUT_OFF)
        ended = ended.decode(errors="ignore") if isinstance(ended, bytes) else str(ended)
        lost = int(file.attrs.get("lost_rows", 0))
        gaps = tuple((int(row), int(count)) for row, count in file.attrs.get("gaps", ()) if count)
        columns = Packed(file)
        return Recording(path, _timed(file, columns), columns.structured(only), complete, ended, lost, gaps)


def _timed(file: h5py.File, columns: Packed) -> dict[str, Any]:
    """The meta; where nobody knew beforehand how long it would be, with its length, and all of it steady."""
    meta: dict[str, Any] = json.loads(file.attrs["meta"])
    if "duration" not in meta and "dt" in meta and columns.rows:
        first, last = (float(columns["time"][row]) for row in (0, -1))
        meta |= {"steady": [first, last + meta["dt"]], "duration": last}
    return meta


def _strange(file: h5py.File) -> str:
    written = str(file.attrs.get("format", ""))
    name, _, version = FORMAT.partition("/")
    if written.startswith(f"{name}/"):
        return (
            f"is a recording of format {written.partition('/')[2]}; this stagectl reads format {version}: with the "
            "version that wrote it, `stagectl export FILE --to csv`, then here `stagectl import FILE.csv`"
        )
    return foreign(file)


def repair(path: Path) -> bool:
    """Rewrite a file that a crash left marked as open, so that any HDF5 tool reads it; True if it was.

    A file whose writer is alive is left alone.  Raises RecordingError where it is damaged beyond its mark.
    """
    try:
        h5py.File(path, "r").close()
        return False
    except OSError:
        if being_written(path):
            return False
        recording = open_recording(path)
    save(path, recording.meta, recording.samples, recording.ended, complete=False)
    return True
