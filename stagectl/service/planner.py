"""The service's side of planning: one motion at a time, in a process that is killed where it takes too long."""

import asyncio
import contextlib
import os
import socket
import subprocess
from collections.abc import Callable, Iterable
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle
from typing import NamedTuple

from stagectl.service.axis_controller import ServiceError
from stagectl.service.child_process import PYTHON, environment
from stagectl.service.limits import PLANNING_TIME
from stagectl.service.planning import Motion, Refusal, Task
from stagectl.units import StageError


class _Process(NamedTuple):
    """A process that plans."""

    process: subprocess.Popen[bytes]
    link: Connection
    compiled: bool

    @property
    def gone(self) -> bool:
        """Whether it has ended."""
        return self.process.poll() is not None

    def end(self) -> None:
        """End it, whatever it does."""
        self.process.kill()
        self.process.wait()
        self.link.close()


def _started(kernels: str) -> _Process:
    """Start a process with this kind of kernels: from the thread that it is to die with."""
    ours, theirs = socket.socketpair()
    process = subprocess.Popen(
        [*PYTHON, "-m", "stagectl.service.planning_process", str(theirs.fileno())],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        pass_fds=(theirs.fileno(),),
        env=environment(STAGECTL_KERNELS=kernels, OPENBLAS_NUM_THREADS="1"),
    )
    theirs.close()
    return _Process(process, Connection(ours.detach()), kernels == "compiled")


class Planner:
    """Lays motions out; its process is there before the first, and a new one after each that was killed.

    ::

        interpreted   |-- plans at once ----------|
        compiled      |-- loads, rehearses -------|-- plans, a hundred times as fast --->

    `rehearsals` are what the compiled process plans first, so that it has every kernel that a motion needs.
    """

    def __init__(
        self, rehearsals: Callable[[], Iterable[Task]] = tuple, say: Callable[[str], None] = lambda _: None
    ) -> None:
        self._rehearsals, self._say = rehearsals, say
        self._process: _Process | None = None
        self._next: _Process | None = None  # loads its kernels
        self._taking_over: asyncio.Task[None] | None = None
        self._failed = False  # the compiled process died while it loaded
        self._turn = asyncio.Lock()

    def start(self) -> _Process:
        """Start the interpreted process: from the thread that it is to die with."""
        self._process = _started("interpreted")
        return self._process

    def look(self) -> None:
        """Start what is gone: the next motion shall not wait for imports, nor be planned slowly for long."""
        if self._turn.locked():
            return
        if self._process is None or self._process.gone:
            self._drop()
            self.start()
        if not (self._failed or self._next or (self._process and self._process.compiled)):
            self._next = _started("compiled")
            self._taking_over = asyncio.create_task(self._rehearse(self._next))

    async def _rehearse(self, process: _Process) -> None:
        """Have a process plan the rehearsals; then it takes over."""
        try:
            for task in self._rehearsals():
                with contextlib.suppress(StageError):  # a model that cannot be planned is refused when a motion is
                    await asyncio.to_thread(_exchanged, process.link, task)
        except (EOFError, OSError):
            if self._next is process:  # it was not ended from here
                self._failed, self._next = True, None
                process.end()
                self._say("planning stays interpreted, and takes about a third of a motion's duration: the process "
                          "with compiled kernels ended while it loaded them; see the messages above")  # fmt: skip
            return
        async with self._turn:
            if self._next is process:
                self._drop()
                self._process, self._next = process, None

    def _drop(self) -> None:
        """End the process that plans."""
        if self._process is not None:
            self._process.end()
            self._process = None

    def close(self) -> None:
        """End both processes, whatever they do."""
        self._drop()
        if self._next is not None:
            process, self._next = self._next, None
            process.end()

    async def plan(self, task: Task) -> Motion:
        """Lay a motion out.  Cancelled, or after too long, its process is killed.

        Raises StageError with all that is wrong with the trajectory, ServiceError where it takes too long.
        """
        async with self._turn:
            process = self._process
            if process is None or process.gone:
                self._drop()
                process = self.start()
            work = asyncio.ensure_future(asyncio.to_thread(_exchanged, process.link, task))
            try:
                return await asyncio.wait_for(asyncio.shield(work), PLANNING_TIME)
            except TimeoutError as error:
                raise ServiceError(f"planning took longer than {PLANNING_TIME:g} s: divide the trajectory") from error
            except (EOFError, OSError) as error:
                self._drop()  # it may take its time to end
                raise ServiceError("the planning process died: divide the trajectory, or try again") from error
            finally:
                if not work.done():
                    process.process.kill()  # ends the exchange, too
                    await asyncio.gather(work, return_exceptions=True)
                    self._drop()
                elif not work.cancelled():
                    work.exception()  # is looked at, also where the client has left just now


def _exchanged(link: Connection, task: Task) -> Motion:
    """Send the task and wait for what becomes of it.  Raises StageError; EOFError, OSError where the process dies.

    The rows come in memory of their own: they are read in a thread, and without the interpreter's lock.
    """
    link.send(task)
    said: Motion | Refusal = link.recv()
    if isinstance(said, Refusal):
        raise StageError(*said.problems)
    memory = recv_handle(link)
    try:
        return said._replace(rows=os.pread(memory, os.fstat(memory).st_size, 0))
    finally:
        os.close(memory)
