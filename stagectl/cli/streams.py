"""What every command does with its words, with results that go to one place, and with streams that are closed."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Any

from typer.core import TyperCommand

from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError

_NEGATIVE = re.compile(r"-\.?[0-9]")
_RESULTS = ("output", "json", "report", "write", "state")  # options that name where a result goes


class Verb(TyperCommand):
    """A command whose results have places of their own, and for which ``-5 mm`` is a quantity and no option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The words that begin as a negative number go behind a ``--``, except what an option takes."""
        takes = {name for one in self.params if not getattr(one, "is_flag", True) for name in one.opts}
        negative = [
            place
            for place, word in enumerate(args)
            if _NEGATIVE.match(word) and "--" not in args[:place] and (not place or args[place - 1] not in takes)
        ]
        if negative and any(one.param_type_name == "argument" for one in self.params):
            rest = [word for place, word in enumerate(args) if place not in negative]
            cut = rest.index("--") if "--" in rest else len(rest)
            args = [*rest[:cut], "--", *(args[place] for place in negative), *rest[cut + 1 :]]
        return super().parse_args(ctx, args)

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
