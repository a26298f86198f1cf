"""The verbs and what they share: error messages, exit codes, ``--json``.

Exit codes: 0 done; 1 a negative result (a fault, a limit reached in motion, a check that failed); 2 not started
(wrong arguments, a motion beyond a limit) or impossible; 130 interrupted.
Each verb imports what it needs itself, and only the module of the verb that was called is loaded: `stagectl status` is
quick, and a process that needs no compiler has none in its memory.
"""

from __future__ import annotations

import importlib
import inspect
import itertools
import os
import shlex
import sys
from keyword import iskeyword
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from stagectl.api.arguments import ArgumentError
from stagectl.cli import INTERRUPTED
from stagectl.cli.options import option
from stagectl.cli.streams import Verb, keep_closed, usage_error
from stagectl.problem import ProblemKind, remedy_of
from stagectl.service.shutdown_signals import interrupting
from stagectl.units import StageError

_ORDERS = ("enable", "disable", "home", "move", "stop", "follow")
# Modules of `stagectl.cli`, in the order of the help, with the verbs and groups that each holds.
VERBS = {
    "motion": ("run", "simulate", "virtual-drive", "demo"),
    "records": ("report", "replay", "export", "import"),
    "identification": ("identify", "tune"),
    "comparison": ("learn", "compare", "effects"),
    "studies": ("reproduce",),
    "service": ("serve", "page", "status", *_ORDERS, "parameters", "fault"),
    "scope": ("scope",),
    "record": ("record",),
    "installation": ("doctor", "service"),
    "faults": ("inject", "selftest"),
    "configuration": ("config",),
    "commission": ("commission",),
    "drive": ("drive",),
    "gap": ("gap",),
}

# What the help lists together, by task; a verb that stands in none is listed at the end.
PANELS = {
    "Model": ("config", "simulate", "tune", "reproduce"),
    "Run": ("demo", "run", "learn", "compare"),
    "Recordings": ("report", "replay", "export", "import"),
    "Identify": ("identify",),
    "Diagnose": ("gap",),
    "Service": (*VERBS["service"], "effects", *VERBS["scope"], "record", "inject", "service", "doctor"),
    "Drive": ("commission", "drive", "virtual-drive", "selftest"),
}
START = """\
Real-time control of a precision stage, its simulator, and the gap between the two.  Where to begin:

  without hardware     stagectl demo                            a virtual stage moves; a page shows how well
                       stagectl serve config/ball-screw.yaml    the same in the browser, live
  a drive on a bench   stagectl drive probe --help              what the drive is; nothing moves
  a log that you have  stagectl import --help                   then: stagectl gap diagnose

`stagectl --help` lists all commands, `stagectl COMMAND --help` says what one does."""


class Verbs(TyperGroup):
    """A group whose help is a list in plain text: rich would take three times as long as all the rest."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Without a verb, show where to begin, or the help of a group; typer would leave that to rich."""
        if not args and self.no_args_is_help and not ctx.resilient_parsing:
            typer.echo(ctx.get_help() if ctx.parent else START)
            ctx.exit(2)
        return super().parse_args(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Usage, purpose, options and verbs."""
        super(TyperGroup, self).format_help(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Each verb with the whole first paragraph of its help; those of `stagectl` itself by task."""
        left = {name: self.get_command(ctx, name) for name in self.list_commands(ctx)}
        for title, names in ({} if ctx.parent else PANELS).items():
            _listed(formatter, title, {name: left.pop(name) for name in names if name in left})
        _listed(formatter, "Commands", left)


def _listed(formatter: Any, title: str, commands: dict[str, Any]) -> None:
    if commands:
        with formatter.section(title):
            formatter.write_dl(
                [(name, inspect.cleandoc(command.help or "").split("\n\n")[0]) for name, command in commands.items()],
                col_max=14,
            )


def application(word: str = "") -> typer.Typer:
    """The command line; only the module that has the verb `word`, where there is one."""
    app = typer.Typer(
        name="stagectl",
        cls=Verbs,
        help="Real-time control of a precision stage, its simulator, and the gap between the two.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_root)
    for name in [name for name, verbs in VERBS.items() if word in verbs] or VERBS:
        _add(app, importlib.import_module(f"stagectl.cli.{name}"), VERBS[name])
    _dress(app)
    return app


def _dress(app: typer.Typer) -> None:
    """Give each group, and each command in it, our class."""
    for command in app.registered_commands:
        command.cls = Verb
    for group in app.registered_groups:
        group.cls = Verbs
        if group.typer_instance is not None:
            _dress(group.typer_instance)


def _add(app: typer.Typer, module: Any, verbs: tuple[str, ...]) -> None:
    """Add verbs and groups by the names that they have in `module`, where ``virtual-drive`` is ``virtual_drive``."""
    if hasattr(module, "register"):  # verbs of another distribution
        module.register(app)
        return
    for verb in verbs:
        entry = getattr(module, f"{verb}_" if iskeyword(verb) else verb.replace("-", "_"))
        if isinstance(entry, typer.Typer):
            app.add_typer(entry, name=verb)
        else:
            app.command(verb)(entry)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"stagectl {version('stagectl')}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool, option("--version", "Show the version and exit.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """Keep a single verb from becoming the whole command."""


def main() -> None:
    """Entry of the command; a user's mistake never ends in a traceback."""
    keep_closed()
    os.environ.setdefault("MPLBACKEND", "Agg")  # figures go into pages: no window, no toolkit in memory
    try:
        _end(_run())
    except typer.TyperException as error:  # words that are no command, or that a command does not take
        _fail(usage_error(error))
    except ArgumentError as error:
        _fail(f"--{error}" + (f"; add --{error.needs}" if error.needs else ""))
    except StageError as error:
        from stagectl.cli.show import with_stage

        stopped = any(problem.kind is ProblemKind.STOPPED for problem in error.problems)
        _fail(with_stage(_with_next(error)), INTERRUPTED if stopped else 2)
    except OSError as error:  # a result that cannot be written, a disk that is full
        advice = remedy_of(error)
        _fail(f"{error.filename or 'the system'}: {error.strerror or error}{advice and f'; {advice}'}")
    except KeyboardInterrupt:
        _fail("interrupted", INTERRUPTED)
    except typer.Abort:  # the end of the input where an answer was due
        _fail("aborted: nothing has changed", 1)


def _run() -> object:
    """The exit code of the command.

    A callback from C swallows an interrupt, as in numba's compiler, whose next step then fails: that is one, too.
    """
    verbs = application(*sys.argv[1:2])
    with interrupting() as came:
        sys.unraisablehook = _unless_interrupted
        try:
            return verbs(standalone_mode=False)
        except Exception as error:
            if came and not isinstance(error, StageError | OSError | typer.TyperException | typer.Abort):
                return INTERRUPTED
            raise
        finally:
            sys.unraisablehook = sys.__unraisablehook__


def _unless_interrupted(lost: sys.UnraisableHookArgs) -> None:
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)


def _end(code: object) -> NoReturn:
    """Exit as the verb says; typer has taken an interrupt."""
    if code == INTERRUPTED:
        _fail("interrupted: unwritten results are lost, nothing else has changed", INTERRUPTED)
    sys.exit(code if isinstance(code, int) else 0)


def _with_next(error: StageError) -> str:
    """The error, and the command to type once the YAML file at fault is corrected."""
    if "stagectl.config.source" not in sys.modules:  # no file was read
        return str(error)
    from stagectl.cli import configuration
    from stagectl.config.source import ConfigError

    problem = error.problems[-1]
    file = problem.file if isinstance(error, ConfigError) and problem.line else None
    if file is None or file.suffix not in (".yaml", ".yml"):
        named = file is None or (file.suffix == ".csv" and str(file) not in sys.argv)  # by a trajectory
        return str(error) if named else f"{error.problems[0]}{_OTHER_FILE}"
    exchanged = any(one.reason.startswith("belongs to a ") for one in error.problems)  # else it is wrong on this axis
    if exchanged and (kind := configuration.kind(file)):
        other = "stage" if kind == "trajectory" else "trajectory"
        place = _place(file)
        both = place == _HERE and sum(word.endswith((".yaml", ".yml")) for word in sys.argv[1:]) > 1
        remedy = "the stage file comes first" if both else "see --help"
        return f"{file} is a valid {kind} file, but {place} takes a {other} file: {remedy}"
    return f"{error}\ncorrect it, then: stagectl config check {shlex.quote(str(file))}"


def _place(file: object) -> str:
    """Where a file was given: the option before it, or the place of an argument."""
    before = (one for one, other in itertools.pairwise(sys.argv) if other == str(file) and one.startswith("--"))
    return next(before, _HERE)


_HERE = "this place"
_OTHER_FILE = "\na stage or trajectory file (.yaml) belongs here: see the command with --help"


def _fail(words: str, code: int = 2) -> NoReturn:
    from rich.console import Console
    from rich.text import Text

    # Text, not markup: brackets and colons of a file must appear unchanged.
    Console(stderr=True, soft_wrap=True).print(Text.assemble(("error:", "bold red"), f" {words}"), highlight=False)
    sys.exit(code)
