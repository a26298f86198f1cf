"""The one place that says how a kernel is compiled.

The same source runs in two ways and gives the same bits:

* **compiled** by numba, for simulator, identification and gap: fast in loops, a second to load at the first call of a
  kernel, and on a new machine longer to compile;
* **interpreted**, for the daemon's real-time process: no numba in memory, starts at once, and one law step
  of plain floats costs a few microseconds.  ``STAGECTL_KERNELS=interpreted`` selects it.

A process may also begin interpreted and load numba when that pays (`interpret_first`).

Kernels are NamedTuple in, NamedTuple out.  They use `math` only, multiply instead of `**`, and keep floats
float: an int in a float's place would compile a second version, in the middle of a cycle.  Arrays come from the
caller: no kernel makes one, nor assigns a slice.
"""

from __future__ import annotations

import functools
import os
import sys
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, ClassVar, ParamSpec, TypeVar, cast

from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError

P = ParamSpec("P")
R = TypeVar("R")

_CHOSEN = os.environ.get("STAGECTL_KERNELS") or "compiled"
if _CHOSEN not in ("compiled", "interpreted"):
    raise StageError(Problem("", ProblemKind.VALUE, "STAGECTL_KERNELS", _CHOSEN, choices=("compiled", "interpreted")))
INTERPRETED = _CHOSEN == "interpreted"


def source_hash() -> str:
    """Hash of all kernel sources: numba's own cache key does not see an edit in another file."""
    import hashlib  # the real-time process does without

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

    def cold(name: str = "") -> bool:
        """Whether the first use will have to compile: never."""
        return False

    def interpret_first(rows: int) -> None:
        """Interpret kernels at first: always so here."""

    def interprets(values: Any) -> bool:
        """Whether a kernel that is given these `values` will be interpreted: always."""
        return True

else:
    _CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stagectl" / source_hash()
    try:
        _CACHE.mkdir(parents=True, exist_ok=True)
        os.environ["NUMBA_CACHE_DIR"] = str(_CACHE)
        _cached = os.access(_CACHE, os.W_OK)
    except OSError:  # a service without a home: compile at each start
        _cached = False

    import numpy

    class _Process:
        """How kernels are called in this process."""

        interpreting = False  # inside an interpreted kernel: what it calls is interpreted, too
        rows = 0  # that may still be interpreted before numba is loaded
        loaded = False
        lock = threading.Lock()
        kernels: ClassVar[list[Any]] = []

    def kernel(function: Callable[P, R]) -> Callable[P, R]:
        """Compiled by numba at the first call, kept on disk under the hash of all kernels."""

        @functools.wraps(function)
        def call(*values: Any) -> Any:
            if _Process.interpreting:
                return function(*values)  # type: ignore[call-arg]
            if not (_Process.rows and interprets(values)):
                return dispatcher(call)(*values)
            _Process.rows -= _rows(values)
            _Process.interpreting = True
            try:
                return function(*values)  # type: ignore[call-arg]
            finally:
                _Process.interpreting = False

        _Process.kernels.append(call)
        return cast("Callable[P, R]", call)

    def dispatcher(call: Any) -> Any:
        """The compiled form of a kernel, under which other kernels find it, too."""
        try:
            return call.compiled
        except AttributeError:
            _compile()
            return call.compiled

    def _boxed(kind: Any, value: Any, context: Any) -> Any:
        """A named tuple of a kernel's result, made without a line of Python, in which Ctrl-C would raise.

        numba calls the class, and does not look whether that has raised: the process would crash.
        """
        from numba.core.boxing import box_tuple

        constants = context.env_manager
        new, made = (constants.read_const(constants.add_const(item)) for item in (tuple.__new__, kind.instance_class))
        values = box_tuple(kind, value, context)
        result = context.pyapi.call_function_objargs(new, [made, values])
        context.pyapi.decref(values)
        return result

    def _compile() -> None:
        """Make numba know all kernels; each is compiled, or read from disk, at its first call."""
        import numba
        import numba.core.boxing  # enters its own way first
        from numba.core.pythonapi import _boxers

        for kind in (numba.types.NamedTuple, numba.types.NamedUniTuple):
            _boxers.functions[kind] = _boxed
        config: Any = numba.config
        config.CACHE_DIR = str(_CACHE)  # a program that had loaded numba before kept it beside the sources
        # Two rollouts run side by side in two threads (nogil).  No kernel allocates: without reference counts and with
        # every call inlined, a period costs a third.
        compiler: Any = functools.partial(numba.njit, cache=_cached, nogil=True, forceinline=True, _nrt=False)
        with _Process.lock:
            for call in _Process.kernels:
                call.compiled = compiler(call.__wrapped__)
                call._numba_type_ = call.compiled._numba_type_
                names = vars(sys.modules[call.__module__])
                if call.__name__ in names and names[call.__name__] is call:  # from now on without the way round
                    names[call.__name__] = call.compiled
            _Process.rows, _Process.loaded = 0, True
            _Process.kernels.clear()

    def interpret_first(rows: int) -> None:
        """Interpret kernels until they have gone through `rows`: a short motion is done before numba is loaded."""
        _Process.rows = 0 if _Process.loaded else rows

    def interprets(values: Any) -> bool:
        """Whether a kernel that is given these `values` will be interpreted."""
        return _Process.rows > 0 and _rows(values) <= _Process.rows

    def _rows(values: Any) -> int:
        """Length of the longest array or list among `values`, and in their parts; at least 1."""
        if isinstance(values, tuple):
            return max((_rows(value) for value in values), default=1)
        return len(values) if isinstance(values, list | numpy.ndarray) else 1

    def table(values: Iterable[float]) -> Any:
        """Constant floats that a kernel indexes."""
        return numpy.array([float(value) for value in values], dtype=numpy.float64)

    def states(count: int) -> Any:
        """`count` zeroed floats that a kernel changes in place."""
        return numpy.zeros(count)

    def cold(name: str = "") -> bool:
        """Whether the first use of kernels whose `name` begins so has to compile: none of this version is on disk."""
        return not any(_CACHE.rglob(f"{name}*.nbi"))
