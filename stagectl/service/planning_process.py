"""Planning as a process of its own: ``python -m stagectl.service.planning_process DESCRIPTOR``.

What a client wrote is read, and computed with, only here: however large or slow it is, the service can kill it.  The
rows come back in shared memory.

::

    service -- Task ----> planning
            <- Motion, descriptor of its rows; or the problems why not
"""

import contextlib
import os
import sys
from multiprocessing.connection import Connection
from multiprocessing.reduction import send_handle

import numpy as np
from numpy.typing import NDArray

from stagectl.service.child_process import confine
from stagectl.service.limits import PLANNING_MEMORY
from stagectl.service.planning import Motion, Refusal, Task, rows_of
from stagectl.units import StageError


def _answer(task: Task) -> tuple[Motion, NDArray[np.float64]] | tuple[Refusal, None]:
    """The motion and its rows (n, 8); or why it cannot be laid out."""
    try:
        return rows_of(task)
    except StageError as error:
        return Refusal(error.problems or (str(error),)), None
    except (ArithmeticError, ValueError) as error:
        words = f"a number of the motion is too large or too small to compute with ({error}): correct it"
    except (MemoryError, RecursionError) as error:
        words = f"the trajectory is too large to be planned ({type(error).__name__}): divide it"
    except ImportError as error:  # a computer without the compiler: the service goes on with interpreted kernels
        raise SystemExit(f"the kernels cannot be compiled here: {error}") from error
    return Refusal((words,)), None


def main() -> None:
    """Entry of the process: one task after the other, until the service closes its end."""
    confine(PLANNING_MEMORY)
    link = Connection(int(sys.argv[1]))
    with contextlib.suppress(EOFError, OSError):
        while True:
            said, rows = _answer(link.recv())
            link.send(said)
            if rows is not None:
                with open(os.memfd_create("stagectl-rows"), "wb", buffering=0) as memory:
                    memory.write(rows.data)
                    send_handle(link, memory.fileno(), None)


if __name__ == "__main__":
    main()
