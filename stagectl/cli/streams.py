"""The words of every command: as it takes them, and what to say of those that it does not; streams that are closed."""

import contextlib
import os
import re
import sys
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand

from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError, UnitError, factor, unit_in

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


_SI = {"FREQUENCY": "Hz", "ANGLE": "rad", "TIME": "s", "CURRENT": "A", "SPEED": "m/s", "ACCELERATION": "m/s^2"}
_WORDS = {  # of the parser, and ours
    r"No such option: (-[0-9.])\S*": r"\1... is taken for an option: write -- before it, as in `COMMAND -- -10mm`",
    r"'([^']*)' is not readable\.": r"'\1' is not readable: see `ls -l \1`; `chmod u+r \1` where it is yours",
    r"is not a valid int(eger)?( range)?\.": "must be a whole number",
    r"is not a valid float( range)?\.": "must be a number",
}


def usage_error(error: typer.TyperException) -> str:
    """What is wrong with the words that were typed, and the command that shows which are right."""
    words = error.format_message() if hasattr(error, "format_message") else str(error)
    context = getattr(error, "ctx", None)
    verb = [word for word in sys.argv[1:2] if not word.startswith("-")]
    command = context.command_path if context else " ".join(["stagectl", *verb])
    if extra := re.fullmatch(r"Got unexpected extra arguments?(?:\(s\))? \((.*)\)", words):
        words = _too_many(context, command, extra[1].split())
    for pattern, ours in _WORDS.items():
        words = re.sub(pattern, ours, words).replace("COMMAND", command)
    return f"{words}\nsee: {command} --help"


def _too_many(context: Any, command: str, extra: list[str]) -> str:
    """What the command takes, and the option that one of the words was probably meant for."""
    arguments = [one for one in context.command.params if one.param_type_name == "argument"]
    taken = " ".join(one.metavar or one.name.upper() for one in arguments)
    typed = [*(str(context.params[one.name]) for one in arguments), *extra]
    meant = next((words for word in typed if (words := _option(context.command, word))), "")
    alone = f"{taken}{' alone' if len(arguments) == 1 else ''}" if taken else "options only"
    return f"`{command}` takes {alone}" + (f": give `{meant}`" if meant else f", not {' '.join(typed)}")


def _option(command: Any, word: str) -> str:
    """An option of the `command` that takes a `word` of this kind, with it; empty where there is none."""
    options = {one.metavar: one.opts for one in reversed(command.params) if one.param_type_name == "option"}
    for metavar, unit in _SI.items():
        with contextlib.suppress(UnitError):
            if metavar in options and unit_in(word) and factor(unit_in(word), unit):
                return f"{options[metavar][0]} {word}"
    if Path(word).suffix or unit_in(word):
        return ""
    short = next((name for name in options.get("FOLDER", ()) if name == "-o"), "")
    axis = "--axis" if ["--axis"] in options.values() and re.fullmatch(r"\w+", word) else ""
    return f"{short or axis} {word}" if short or axis else ""
