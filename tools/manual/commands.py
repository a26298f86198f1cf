"""The reference page of the command line, from the commands themselves."""

import inspect
from typing import Any

import typer

from stagectl.cli.app import application

HEAD = """# Commands

This page lists all commands with their options, as `stagectl COMMAND --help` does.

`--json FILE` writes the result as JSON; `--json -` writes it to standard output. Messages for people go to standard
error.

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | a negative result: a fault, a limit reached in motion, a check that failed, an axis that is not in position |
| 2 | not begun: wrong arguments, a file that cannot be read, a motion beyond a limit, no drive that answers |
| 130 | stopped with Ctrl-C; 0 for `serve` and `virtual-drive`, which run until then |

A command that takes longer than two seconds shows its progress and the time left. Where the end is not known, it shows
what it is doing. After a mistake you get one sentence with the cause and what to do, never a traceback: see
[common mistakes](../mistakes.md).

Completion in the shell: `stagectl --install-completion`, once for bash, zsh or fish; then press Tab.
"""


def pages() -> dict[str, str]:
    """Markdown by file name."""
    root = typer.main.get_command(application())
    return {"reference/commands.md": HEAD + "".join(_all(root, "stagectl"))}


def _all(group: Any, name: str) -> list[str]:
    sections = []
    for word, command in sorted(group.commands.items()):
        if getattr(command, "hidden", False):
            continue
        if hasattr(command, "commands"):
            sections += _all(command, f"{name} {word}")
        else:
            sections.append(_command(command, f"{name} {word}"))
    return sections


def _command(command: Any, name: str) -> str:
    shown = [parameter for parameter in command.params if not getattr(parameter, "hidden", False)]
    arguments = [_argument(parameter) for parameter in shown if parameter.param_type_name == "argument"]
    words = inspect.cleandoc(command.help or "")
    text, _, examples = words.partition("Example: ")
    usage = " ".join([name, "[OPTIONS]", *arguments])
    parts = [f"\n## `{name}`\n", text.strip(), f"\n```text\n{usage}\n```\n"]
    if examples:
        parts.append(f"Example:\n\n```sh\n{examples.strip()}\n```\n")
    rows = [f"| {_names(parameter)} | {_cell(parameter)} |" for parameter in shown if getattr(parameter, "help", None)]
    table = ["| option | meaning |", "|---|---|", *rows, ""] if rows else []
    return "\n".join([*parts, *table])


def _argument(parameter: Any) -> str:
    name = parameter.metavar or parameter.name.upper()
    return name if parameter.required else f"[{name}]"


def _names(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return f"`{_argument(parameter)}`"
    value = "" if getattr(parameter, "is_flag", False) else f" {parameter.metavar or parameter.name.upper()}"
    return f"`{', '.join(parameter.opts)}{value}`"


def _cell(parameter: Any) -> str:
    return str(parameter.help).replace("|", "\\|").replace("\n\n", "<br>").replace("\n", " ")
