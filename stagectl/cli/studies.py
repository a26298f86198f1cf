"""Verbs of the optional distribution ``stagectl-studies`` (tools/studies)."""

from importlib import import_module
from importlib.util import find_spec

import typer

from stagectl.units import StageError

_CONTEXT = {"allow_extra_args": True, "ignore_unknown_options": True}
_VERBS = {  # module of `stagectl_studies.commands`, and the help where it is not installed
    "reproduce": ("reproduce", "Carry out a source paper's experiments on a virtual machine"),
    "exam": ("gap_exam", "Put the diagnosis to sealed trials of an unknown machine"),
    "knock": ("gap_knock", "Test the diagnosis on a real record with a known answer"),
    "fleet": ("gap_fleet", "Diagnose many machines, one folder each"),
}


class MissingStudiesError(StageError):
    """A verb was called whose distribution is not installed."""


def register(app: typer.Typer) -> None:
    """Add `reproduce` to the command line."""
    add(app, "reproduce")


def add(app: typer.Typer, verb: str) -> None:
    """Add a verb of the other distribution, or one that says how to install it."""
    module, words = _VERBS[verb]
    if find_spec("stagectl_studies") is not None:
        app.command(verb)(getattr(import_module(f"stagectl_studies.commands.{module}"), verb))
    else:
        app.command(verb, context_settings=_CONTEXT, help=f"{words}; needs stagectl-studies.")(_missing)


def _missing() -> None:
    raise MissingStudiesError(
        "this command is part of stagectl-studies, which is not installed; in a checkout: pip install ./tools/studies"
    )
