"""How the exam's loops are compiled: by numba, kept on disk under the hash of the exam's own sources."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def _folder() -> Path:
    """Cache folder; its name is a hash of all sources, as numba does not see an edit in a file that is called."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "stagectl-exam" / digest.hexdigest()[:16]


_FOLDER = _folder()
try:
    _FOLDER.mkdir(parents=True, exist_ok=True)
    _CACHED = os.access(_FOLDER, os.W_OK)
except OSError:  # a service without a home: compile at each start
    _CACHED = False


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compiled at the first call, inlined into its caller.  Division by zero gives inf as in IEEE 754.

    Without numba's reference counts, which would cost ten times the physics: whoever calls allocates.
    """
    config, compiler = cast("Any", numba.config), cast("Any", numba.njit)
    before = config.CACHE_DIR
    config.CACHE_DIR = str(_FOLDER)
    try:
        options = {"cache": _CACHED, "error_model": "numpy", "forceinline": True, "_nrt": False}
        made = compiler(**options)(function)
    finally:
        config.CACHE_DIR = before
    return cast("Callable[P, R]", made)
