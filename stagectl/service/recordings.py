"""Recordings of a running service: a recorder process for as long as it is wanted, and the files there are."""

import contextlib
import functools
import math
import os
import re
import shlex
import stat
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.config.machine_file import text_of
from stagectl.config.stage_blocks import Retention
from stagectl.problem import Problem, ProblemKind
from stagectl.recording.file_lock import being_written, discard, sweep
from stagectl.recording.hdf5 import RecordingError, repair
from stagectl.recording.metadata import of_axis
from stagectl.recording.recorder import ENOUGH, Order
from stagectl.replacing import not_taken
from stagectl.service.axis_controller import COLUMNS, AbsentError, AxisController, ServiceError
from stagectl.service.black_box import UNFINISHED
from stagectl.service.child_process import Child, start

LONGEST = 86400.0  # s
KINDS = ("recordings", "blackbox")
DAY, GIB = 86400.0, float(1 << 30)  # s, bytes
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.+-]{0,79}")
_EXPIRY = 600.0  # s between two looks at what is too old or too much
_END = 60.0  # s that a recorder may take to finish its file: one that is killed leaves it cut off


def about(axis: AxisController, what: str) -> dict[str, Any]:
    """What a recording of an axis says about itself; `what` stands for the trajectory."""
    return {**of_axis(axis.setup, axis.controller, _loaded(axis.setup.path)), "trajectory": what}


@functools.cache
def _loaded(path: Path) -> str:
    """The stage file's text when the service came up: it may be edited while that runs."""
    return text_of(path)


class _Running(NamedTuple):
    axis: str
    path: Path
    child: Child
    pipe: int  # writing end: a byte says enough, its closing that the loop is gone
    first: int  # row
    until: float  # s, monotonic clock
    asked_to_end: bool = False


class Recordings:
    """Begins and ends them; at most one an axis at a time."""

    def __init__(self, state: Path) -> None:
        self._state = state
        self._lock = threading.Lock()  # of the next two: `end` and `files` are called in threads of their own
        self._running: dict[str, _Running] = {}
        self._ending: set[Path] = set()  # asked to end, and not whole yet
        self._expiry = 0.0  # s, monotonic clock, of the next look at what is too old

    def begin(self, axis: AxisController, name: str, before: float, seconds: float) -> Path:
        """Record an axis from `before` (s) ago, as far as the ring goes back, until `end` or `seconds` from now.

        Raises ServiceError where it is being recorded, or the name will not do.
        """
        self.look()
        if axis.name in self._running:
            reason = f"{axis.name} is being recorded: {self._running[axis.name].path.name}"
            remedy = f"`stagectl record --end --axis {shlex.quote(axis.name)}` ends that"
            raise ServiceError(Problem(reason, ProblemKind.CONFLICT, remedy=remedy))
        path = self._place(axis.name, name.strip())
        path.parent.mkdir(parents=True, exist_ok=True)
        ring, dt = axis.ring, axis.setup.dt
        first = max(ring.written - round(before / dt), ring.written - ring.capacity + round(1.0 / dt), 0)
        reading, writing = os.pipe()
        child = start("stagectl.recording.recorder", (ring.descriptor, reading), "interpreted")
        os.close(reading)
        meta = about(axis, "recorded")
        child.send(Order(ring.place, reading, str(path), meta, COLUMNS, first))
        until = time.monotonic() + seconds
        self._running[axis.name] = _Running(axis.name, path, child, writing, first, until)
        return path

    def _place(self, axis: str, name: str) -> Path:
        """The file of a recording with this name; of the time where it has none."""
        folder = self._state / "recordings" / axis
        if not name:
            return not_taken(folder / time.strftime("%Y%m%d-%H%M%S.h5"), self._ending)
        if not _NAME.fullmatch(name):
            raise ServiceError(f"name {name!r}; must be letters, digits, '_', '-', '.', '+', 80 at most")
        path = folder / f"{name}.h5"
        if path.exists() or path in self._ending:
            raise ServiceError(f"{path.name} exists already: take another name")
        return path

    def tidy(self) -> Iterator[str]:
        """Take away what killed processes have begun; black boxes that one was writing keep their rows: their names.

        What is still being written is left alone, as by the black box of a service that has just died.
        """
        for folder in [folder for kind in KINDS for folder in (self._state / kind).glob("*/")]:
            sweep(folder)
            for left in folder.glob(f"*{UNFINISHED}"):
                with contextlib.suppress(OSError, RecordingError):
                    if not being_written(left):
                        repair(left)
                        yield left.rename(left.with_suffix(".h5")).name

    def expire(self, axes: Iterable[AxisController]) -> Iterator[str]:
        """Remove what each stage file no longer wants kept, every ten minutes; what went, or could not, in words."""
        if time.monotonic() < self._expiry:
            return
        self._expiry = time.monotonic() + _EXPIRY
        for axis in axes:
            for path in expired(axis.setup.file.recordings, kept(self._state, axis.name), time.time()):
                try:
                    if not being_written(path):
                        path.unlink(missing_ok=True)
                        yield f"removed {path}: {in_words(axis.setup.file.recordings)}"
                except OSError as error:
                    yield f"{path} cannot be removed: {error.strerror}"

    def end(self, name: str) -> Path:
        """End the recording of an axis; returns when its file is whole.  Raises ServiceError where there is none."""
        with self._lock:
            running = self._running.pop(name, None)
            if running is None:
                raise ServiceError(f"{name} is not being recorded")
            self._ending.add(running.path)
        try:
            return _finished(running)
        finally:
            with self._lock:
                self._ending.remove(running.path)

    def look(self) -> list[str]:
        """Tell those whose time is over, take leave of those that have ended; axes whose recording failed."""
        failed = []
        for name, running in list(self._running.items()):
            if running.child.ended is not None and self._taken(running):
                os.close(running.pipe)
                if running.child.wait(_END):
                    discard(running.path)
                    failed.append(name)
            elif time.monotonic() > running.until and not running.asked_to_end:
                self._asks_to_end(running)
        return failed

    def _taken(self, running: _Running) -> bool:
        """Whether it was still there to be taken out: `end` may have done so."""
        with self._lock:
            if self._running.get(running.axis) is not running:
                return False
            del self._running[running.axis]
            return True

    def _asks_to_end(self, running: _Running) -> None:
        with self._lock:
            if self._running.get(running.axis) is running:
                _ask_to_end(running)
                self._running[running.axis] = running._replace(asked_to_end=True)

    def cut(self) -> list[tuple[Child, float]]:
        """The real-time process is gone: what was being recorded ends here; recorders, and what (s) each may take."""
        gone = list(self._running.values())
        self._running.clear()
        for running in gone:
            os.close(running.pipe)
        return [(running.child, _END) for running in gone]

    def status_json(self, axis: AxisController) -> dict[str, Any] | None:
        """The recording of an axis that goes on."""
        running = self._running.get(axis.name)
        if running is None:
            return None
        rows = axis.ring.written - running.first
        return {
            "file": running.path.name,
            "seconds": rows * axis.setup.dt,
            "left": max(running.until - time.monotonic(), 0.0),
        }

    def files(self) -> list[dict[str, Any]]:
        """All files there are, the newest first; one that is about to be written has no bytes."""
        with self._lock:
            going = {running.path for running in self._running.values()} | self._ending
        there = kept(self._state)
        begun = [Kept(path, 0, time.time()) for path in going - {file.path for file in there}]
        return [
            {
                "kind": path.parent.parent.name,
                "axis": path.parent.name,
                "file": path.name,
                "bytes": size,
                "time": when,
                "going_on": path in going,
            }
            for path, size, when in (*begun, *there)
        ]

    def path(self, kind: str, axis: str, file: str) -> Path:
        """A file of the list.  Raises AbsentError where it is none."""
        entries = [entry for entry in self.files() if entry["bytes"]]
        if not any((entry["kind"], entry["axis"], entry["file"]) == (kind, axis, file) for entry in entries):
            raise AbsentError(f"no recording {kind}/{axis}/{file}; GET /v1/recordings lists all")
        return self._state / kind / axis / file


def _ask_to_end(running: _Running) -> None:
    """Enough; one that has ended by itself does not hear it."""
    if not running.asked_to_end:
        with contextlib.suppress(BrokenPipeError):
            os.write(running.pipe, ENOUGH)


def _finished(running: _Running) -> Path:
    """The whole file of a recording that is to end.  Raises ServiceError where there is none."""
    _ask_to_end(running)
    os.close(running.pipe)
    code = running.child.wait(_END)
    discard(running.path)
    if code:
        raise ServiceError(f"{running.path}: the recorder failed ({code}); see the service's messages")
    if not running.path.exists():
        raise ServiceError(
            f"nothing was recorded: {running.axis} gave no rows; see `stagectl status` and `stagectl fault list`"
        )
    return running.path


class Kept(NamedTuple):
    """A file there is."""

    path: Path
    bytes: int
    time: float  # s, of its last change


def kept(state: Path, axis: str = "*") -> list[Kept]:
    """Recordings and black boxes of a service, the newest first; a link or a pipe is no file of ours."""
    files = []
    for path in (path for kind in KINDS for path in (state / kind).glob(f"{axis}/*.h5")):
        with contextlib.suppress(FileNotFoundError):  # it has just gone
            about = path.lstat()
            if stat.S_ISREG(about.st_mode):
                files.append(Kept(path, about.st_size, about.st_mtime))
    return sorted(files, key=lambda file: -file.time)


def expired(p: Retention, files: Iterable[Kept], now: float) -> list[Path]:
    """What goes of `files`, which are the newest first, at the time `now` (s); the newest always stays."""
    gone, size = [], 0
    for number, file in enumerate(files):
        size += file.bytes
        if number and (now - file.time > p.keep_days * DAY or size > p.keep_gib * GIB):
            gone.append(file.path)
    return gone


def in_words(p: Retention) -> str:
    """What goes when."""
    if p == Retention():
        return "none is ever removed"
    ends = {f"after {p.keep_days:g} days": p.keep_days, f"beyond {p.keep_gib:g} GiB": p.keep_gib}
    return "removed " + " or ".join(words for words, limit in ends.items() if limit < math.inf)
