"""The verbs, and what they have in common: errors in words, exit codes, ``--json``.

Exit codes: 0 done; 1 a negative result (a fault, a limit reached in motion, a check that failed); 2 it was not begun
(wrong arguments, a motion beyond a limit) or could not be done.
Each verb imports what it needs itself, so that ``stagectl --help`` is quick and a process that needs no compiler
has none in its memory.
"""

from __future__ import annotations

import shlex
import sys
from typing import NoReturn

import typer
from rich.console import Console
from rich.text import Text

from stagectl.cli import (
    comparison,
    configuration,
    drive,
    drive_dump,
    faults,
    gap,
    identification,
    installation,
    motion,
    records,
    scope,
    service,
    studies,
    tuning,
)
from stagectl.units import StageError

_INTERRUPTED = 130  # typer's exit code for Ctrl-C

app = typer.Typer(
    name="stagectl",
    help="Real-time control of a precision stage, its simulator, and the gap between the two.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for group in (motion, records, identification, comparison, tuning, studies, service, scope, installation, faults):
    group.register(app)
app.add_typer(configuration.app, name="config")
app.add_typer(drive.app, name="drive")
app.add_typer(gap.app, name="gap")
drive.app.command("dump")(drive_dump.dump)


def main() -> None:
    """Entry of the command; a user's mistake never ends in a traceback."""
    try:
        app()
    except StageError as error:
        _fail(f"{error}{_next(error)}")
    except OSError as error:  # a result that cannot be written, a disk that is full
        _fail(f"{error.filename or 'the system'}: {error.strerror or error}")
    except KeyboardInterrupt:
        _fail("interrupted")
    except SystemExit as ended:
        if ended.code == _INTERRUPTED:  # typer has taken the interrupt
            _fail("interrupted: what was not written yet is not kept, and nothing else was changed")
        raise


def _next(error: StageError) -> str:
    """The command to type once the file is corrected; empty where no YAML file is at fault."""
    from stagectl.config.source import ConfigError

    problem = error.problems[-1]
    file = problem.file if isinstance(error, ConfigError) and problem.line else None
    if file is None or file.suffix not in (".yaml", ".yml"):
        return ""
    if kind := configuration.kind(file):
        return f"\n{file} is a valid {kind} file, but another kind is expected here: the stage file comes first"
    return f"\ncorrect it, then: stagectl config check {shlex.quote(str(file))}"


def _fail(words: str) -> NoReturn:
    # Text, not markup: brackets and colons of a file must appear unchanged.
    Console(stderr=True, soft_wrap=True).print(Text.assemble(("error:", "bold red"), f" {words}"), highlight=False)
    sys.exit(2)
