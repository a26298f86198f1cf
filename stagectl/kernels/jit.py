"""The one place that says how a kernel is compiled.

The same source runs in two ways and gives the same bits:

* **compiled** by numba, for simulator, identification and gap: fast in loops, a second to start;
* **interpreted**, for the daemon's real-time process: no numba in memory, starts at once, and one law step
  of plain floats costs a few microseconds.  ``STAGECTL_KERNELS=interpreted`` selects it.

Kernels are NamedTuple in, NamedTuple out.  They use `math` only, multiply instead of `**`, and keep floats
float: an int in a float's place would compile a second version, in the middle of a cycle.  Arrays come from the
caller: no kernel makes one, nor assigns a slice.
"""

from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")

INTERPRETED = os.environ.get("STAGECTL_KERNELS", "compiled") == "interpreted"


def source_hash() -> str:
    """Hash of all kernel sources: numba's own cache key does not see an edit in another file."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


if INTERPRETED:

    def kernel(function: Callable[P, R]) -> Callable[P, R]:
        """Interpreted: the function itself."""
        return function

    def table(values: Iterable[float]) -> Any:
        """Constant floats that a kernel indexes; a tuple, as numpy's scalars would slow every sum down."""
        return tuple(float(value) for value in values)

    def states(count: int) -> Any:
        """`count` zeroed floats that a kernel changes in place."""
        return [0.0] * count

    def cold() -> bool:
        """Whether the first use will have to compile: never."""
        return False

else:
    _CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stagectl" / source_hash()
    try:
        _CACHE.mkdir(parents=True, exist_ok=True)
        os.environ["NUMBA_CACHE_DIR"] = str(_CACHE)
        _cached = os.access(_CACHE, os.W_OK)
    except OSError:  # a service without a home: compile at each start
        _cached = False

    import numba  # after its cache directory is known
    import numpy

    # Two rollouts run side by side in two threads (nogil).  No kernel allocates: without reference counts and with
    # every call inlined, a period costs a third.
    _compile = functools.partial(numba.njit, cache=_cached, nogil=True, forceinline=True, _nrt=False)

    def kernel(function: Callable[P, R]) -> Callable[P, R]:
        """Compiled by numba at the first call, kept on disk under the hash of all kernels."""
        compiled: Any = _compile(function)
        return cast("Callable[P, R]", compiled)

    def table(values: Iterable[float]) -> Any:
        """Constant floats that a kernel indexes."""
        return numpy.array([float(value) for value in values], dtype=numpy.float64)

    def states(count: int) -> Any:
        """`count` zeroed floats that a kernel changes in place."""
        return numpy.zeros(count)

    def cold() -> bool:
        """Whether the first use will have to compile: nothing of this version is on disk yet."""
        return not any(_CACHE.rglob("*.nbi"))
