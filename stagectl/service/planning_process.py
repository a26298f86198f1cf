"""Planning as a process of its own: ``python -m stagectl.service.planning_process DESCRIPTOR``.

What a client wrote is read, and computed with, only here: however large or slow it is, the service can kill it.  The
rows come back in shared memory.

::

    service -- length, pickled Task ----> planning
            <- length, pickled Motion, descriptor of its rows; or the problems why not
"""

from __future__ import annotations

import os
import pickle
import socket
import sys

from stagectl.service.confined import confine
from stagectl.service.limits import PLANNING_MEMORY
from stagectl.service.planning import Motion, Refusal, Task, rows_of
from stagectl.service.planning_link import LENGTH, received
from stagectl.units import StageError


def _answer(task: Task) -> tuple[Motion | Refusal, list[int]]:
    """What there is to send, and the descriptor of the rows."""
    try:
        motion, rows = rows_of(task)
        memory = os.memfd_create("stagectl-rows")
        with open(memory, "wb", closefd=False) as file:
            file.write(rows.data)
        return motion, [memory]
    except StageError as error:
        return Refusal(error.problems or (str(error),)), []
    except (MemoryError, RecursionError) as error:
        return Refusal((f"the trajectory is too large to be planned ({type(error).__name__}): divide it",)), []


def main() -> None:
    """Entry of the process: one task after the other, until the service closes its end."""
    confine(PLANNING_MEMORY)
    link = socket.socket(fileno=int(sys.argv[1]))
    while True:
        try:
            task: Task = pickle.loads(received(link, *LENGTH.unpack(received(link, LENGTH.size))))
        except (EOFError, OSError):
            return
        said, memory = _answer(task)
        packed = pickle.dumps(said)
        socket.send_fds(link, [LENGTH.pack(len(packed))], memory)
        link.sendall(packed)
        for descriptor in memory:
            os.close(descriptor)


if __name__ == "__main__":
    main()
