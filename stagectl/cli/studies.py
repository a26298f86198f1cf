"""Verbs of the optional distribution ``stagectl-studies`` (tools/studies): `reproduce` and `gap exam`."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

import typer

from stagectl.units import StageError

_CONTEXT = {"allow_extra_args": True, "ignore_unknown_options": True}
_REPRODUCE = "Carry out a source paper's experiments on a virtual machine; needs stagectl-studies."
_EXAM = "Put the diagnosis to sealed trials of an unknown machine; needs stagectl-studies."


class MissingStudiesError(StageError):
    """A verb was called whose distribution is not installed."""


def register(app: typer.Typer) -> None:
    """Add `reproduce` to the command line."""
    if _installed():
        import_module("stagectl_studies.commands.reproduce").register(app)
    else:
        app.command("reproduce", context_settings=_CONTEXT, help=_REPRODUCE)(_missing)


def add_exam(app: typer.Typer) -> None:
    """Add `exam` to the verbs of the gap."""
    if _installed():
        import_module("stagectl_studies.commands.gap_exam").register(app)
    else:
        app.command("exam", context_settings=_CONTEXT, help=_EXAM)(_missing)


def _installed() -> bool:
    return find_spec("stagectl_studies") is not None


def _missing() -> None:
    raise MissingStudiesError(
        "this command is part of stagectl-studies, which is not installed; in a checkout: pip install ./tools/studies"
    )
