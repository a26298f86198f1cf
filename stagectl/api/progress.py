"""Progress on request: a bar on the terminal, a function of the caller, or nothing."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

ProgressOption = bool | Callable[[float, float], object]  # True: a bar; a function of (steps done, steps in all)
Update = Callable[..., None]  # (done, total, title): the total and the title may change on the way
Say = Callable[[str], object]  # takes a message for the user


@contextmanager
def reported(option: ProgressOption, title: str, total: float) -> Iterator[Update]:
    """What a computation calls as it proceeds."""
    if option is True:
        with progress(title, total) as update:
            yield update
    elif option is False:
        yield lambda *_: None
    else:
        yield _without_title(option)


def _without_title(report: Callable[[float, float], object]) -> Update:
    def update(done: float, total: float, *_: str) -> None:
        report(done, total)

    return update


@contextmanager
def progress(title: str, total: float) -> Iterator[Update]:
    """A bar on standard error, with the time left."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=terminal()) as shown:
        task = shown.add_task(title, total=total)

        def update(done: float, total: float, words: str = title) -> None:
            shown.update(task, completed=done, total=total, description=words)

        yield update


@functools.cache
def terminal() -> Console:
    """The one console on standard error: messages and a bar on two of them would overwrite each other."""
    from rich.console import Console

    # Names and paths appear as they are, whatever brackets they hold.
    return Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
