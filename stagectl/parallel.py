"""One function over many items at once: kernels release the interpreter lock, so that threads use all cores."""

import os
from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_parallel(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """`function` of each item, in the order of the items, as many at once as there are cores.

    The first exception, in that order, is raised here; items that have not begun by then are cancelled.
    """
    waiting = list(items)
    if len(waiting) < 2 or cores() == 1:
        return [function(item) for item in waiting]
    with ThreadPoolExecutor(min(cores(), len(waiting))) as pool:
        return list(pool.map(function, waiting))


def once_for_each(function: Callable[[A], B], items: Sequence[A], keys: Sequence[Hashable]) -> list[B]:
    """As `in_parallel`, but items with equal `keys` share what the function makes of the first of them."""
    first = dict(zip(reversed(keys), reversed(items), strict=True))
    found = dict(zip(first, in_parallel(function, first.values()), strict=True))
    return [found[key] for key in keys]
