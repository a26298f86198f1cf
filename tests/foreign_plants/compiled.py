"""numba's compiler, typed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """`function` as machine code; division by zero follows IEEE 754.

    Nothing is cached: numba's cache does not see that a function of another file has changed.
    """
    return cast(F, numba.njit(error_model="numpy")(function))
