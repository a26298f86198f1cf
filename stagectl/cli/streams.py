"""Standard streams that the shell has closed (``2>&-``), and results of one command that go to one place."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from typer.core import TyperCommand

from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError

_RESULTS = ("output", "json", "report", "write", "state")  # options that name where a result goes


class Verb(TyperCommand):
    """A command whose results have places of their own."""

    def invoke(self, ctx: Any) -> Any:
        """Run it.  Raises StageError where two options name one file, of which one result alone would be left."""
        seen: dict[Path, str] = {}
        for name in _RESULTS:
            if not isinstance(value := ctx.params.get(name), str | Path) or str(value) == "-":
                continue
            other = seen.setdefault(Path(value).resolve(), name)
            if other != name:
                reason = f"--{other} and --{name} both name {value}: one result would replace the other"
                remedy = "give each a file of its own"
                raise StageError(Problem(reason, ProblemKind.REPEATED, remedy=remedy, file=Path(value)))
        return super().invoke(ctx)


def keep_closed() -> None:
    """Let nothing take the number of a closed stream: what is meant for it would go into the first file opened.

    Messages to a closed standard error go nowhere, not to standard output.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    sys.stderr = sys.stderr or os.fdopen(2, "w", encoding="utf-8", closefd=False)


def check_output() -> None:
    """Raises StageError where a result is to go to a standard output that is closed."""
    if sys.stdout is None:
        remedy = "leave out `>&-`, or name a file instead of -"
        raise StageError(Problem("standard output is closed", ProblemKind.FILE, remedy=remedy))
