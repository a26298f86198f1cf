"""The service's side of planning: one motion at a time, in a process that is killed where it takes too long."""

from __future__ import annotations

import asyncio
import os
import pickle
import socket
import subprocess

from stagectl.realtime.scheduling import PARENT
from stagectl.service.axis_controller import ServiceError
from stagectl.service.child_process import PYTHON
from stagectl.service.limits import PLANNING_TIME
from stagectl.service.planning import Motion, Refusal, Task
from stagectl.service.planning_link import LENGTH, received
from stagectl.units import StageError


class Planner:
    """Lays motions out; its process is there before the first, and a new one after each that was killed."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._turn = asyncio.Lock()

    def start(self) -> None:
        """Start the process: from the thread that it is to die with."""
        self._link, theirs = socket.socketpair()
        self._process = subprocess.Popen(
            [*PYTHON, "-m", "stagectl.service.planning_process", str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=(theirs.fileno(),),
            env={
                **os.environ,
                "STAGECTL_KERNELS": "interpreted",
                "OPENBLAS_NUM_THREADS": "1",
                PARENT: str(os.getpid()),
            },
        )
        theirs.close()

    def look(self) -> None:
        """Start the process again where it is gone: the next motion shall not wait for its imports."""
        if not self._turn.locked() and (self._process is None or self._process.poll() is not None):
            self.close()
            self.start()

    def close(self) -> None:
        """End the process, whatever it does."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._link.close()
            self._process = None

    async def plan(self, task: Task) -> Motion:
        """Lay a motion out.  Cancelled, or after too long, its process is killed.

        Raises StageError with all that is wrong with the trajectory, ServiceError where it takes too long.
        """
        async with self._turn:
            if self._process is None or self._process.poll() is not None:
                self.close()
                self.start()
            work = asyncio.ensure_future(asyncio.to_thread(self._exchange, self._link, task))
            try:
                return await asyncio.wait_for(asyncio.shield(work), PLANNING_TIME)
            except TimeoutError as error:
                raise ServiceError(f"planning took longer than {PLANNING_TIME:g} s: divide the trajectory") from error
            except (EOFError, OSError) as error:
                raise ServiceError("the planning process died: divide the trajectory, or try again") from error
            finally:
                if not work.done():
                    self.close()  # ends the exchange, too
                    await asyncio.gather(work, return_exceptions=True)

    def _exchange(self, link: socket.socket, task: Task) -> Motion:
        """Send the task and wait for what becomes of it; the process may die over it.  Raises StageError, OSError."""
        packed = pickle.dumps(task)
        link.sendall(LENGTH.pack(len(packed)) + packed)
        head, descriptors, _, _ = socket.recv_fds(link, LENGTH.size, 1)
        if len(head) < LENGTH.size:
            raise EOFError
        said: Motion | Refusal = pickle.loads(received(link, *LENGTH.unpack(head)))
        if isinstance(said, Refusal):
            raise StageError(*said.problems)
        (memory,) = descriptors
        rows = os.pread(memory, os.fstat(memory).st_size, 0)  # in a thread, and without the interpreter's lock
        os.close(memory)
        return said._replace(rows=rows)
