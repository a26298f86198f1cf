"""Words that a command does not take: what it takes instead, and the command that shows the rest."""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from stagectl.units import UnitError, factor, unit_in

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
    command = context.command_path if context else " ".join(["stagectl", *_verbs()])
    if extra := re.fullmatch(r"Got unexpected extra arguments?(?:\(s\))? \((.*)\)", words):
        words = _too_many(context, command, extra[1].split())
    for pattern, ours in _WORDS.items():
        words = re.sub(pattern, ours, words).replace("COMMAND", command)
    return f"{words}\nsee: {command} --help"


def _verbs() -> Iterator[str]:
    """The command that was typed, as far as an error does not say it."""
    return (word for word in sys.argv[1:2] if not word.startswith("-"))


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
