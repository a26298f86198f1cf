"""The verbs, and what they have in common: errors in words, exit codes, ``--json``.

Exit codes: 0 done; 1 the answer is no (a limit, a fault, a check that failed); 2 it could not be done.
Each verb imports what it needs itself, so that ``stagectl --help`` is quick and a process that needs no compiler
has none in its memory.
"""

from __future__ import annotations

import sys

import typer
from rich.console import Console

from stagectl.cli import configuration, motion, records
from stagectl.units import StageError

app = typer.Typer(
    name="stagectl",
    help="Real-time control of a precision stage, its simulator, and the gap between the two.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for group in (motion, records):
    group.register(app)
app.add_typer(configuration.app, name="config")


def main() -> None:
    """Entry of the command; a user's mistake never ends in a traceback."""
    try:
        app()
    except StageError as error:
        Console(stderr=True, soft_wrap=True).print(f"[bold red]error:[/] {_escaped(str(error))}", highlight=False)
        sys.exit(2)
    except KeyboardInterrupt:
        Console(stderr=True).print("interrupted")
        sys.exit(2)


def _escaped(text: str) -> str:
    from rich.markup import escape

    return escape(text)
