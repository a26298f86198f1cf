"""The reference page of the command line, from the commands themselves."""

from __future__ import annotations

import inspect
from typing import Any

import typer

from stagectl.cli.app import application

HEAD = """# Commands

Results are JSON with `--json FILE`, `--json -` for standard output; what is for people goes to standard error.

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | the answer is no: a fault, a limit reached in motion, a check that failed, an axis that is not in position |
| 2 | it was not begun: wrong arguments, a file that cannot be read, a motion beyond a limit, no drive that answers |

What takes longer than two seconds shows how far it is and what is left; a search without a known end, what it does. A
mistake ends in one sentence with the cause and what to do, never in a traceback; see [common mistakes](../mistakes.md).

Completion in the shell: `stagectl --install-completion`, once for bash, zsh or fish; then press Tab.
"""


def pages() -> dict[str, str]:
    """Markdown by file name."""
    root = typer.main.get_command(application())
    return {"reference/commands.md": HEAD + "".join(_all(root, "stagectl"))}


def _all(group: Any, name: str) -> list[str]:
    found = []
    for word, command in sorted(group.commands.items()):
        if getattr(command, "hidden", False):
            continue
        if hasattr(command, "commands"):
            found += _all(command, f"{name} {word}")
        else:
            found.append(_command(command, f"{name} {word}"))
    return found


def _command(command: Any, name: str) -> str:
    shown = [one for one in command.params if not getattr(one, "hidden", False)]
    arguments = [_argument(one) for one in shown if one.param_type_name == "argument"]
    words = inspect.cleandoc(command.help or "")
    text, _, examples = words.partition("Example: ")
    usage = " ".join([name, "[OPTIONS]", *arguments])
    parts = [f"\n## `{name}`\n", text.strip(), f"\n```text\n{usage}\n```\n"]
    if examples:
        parts.append(f"Example:\n\n```sh\n{examples.strip()}\n```\n")
    rows = [f"| {_names(one)} | {_cell(one)} |" for one in shown if getattr(one, "help", None)]
    table = ["| option | meaning |", "|---|---|", *rows, ""] if rows else []
    return "\n".join([*parts, *table])


def _argument(one: Any) -> str:
    name = one.metavar or one.name.upper()
    return name if one.required else f"[{name}]"


def _names(one: Any) -> str:
    if one.param_type_name == "argument":
        return f"`{_argument(one)}`"
    value = "" if getattr(one, "is_flag", False) else f" {one.metavar or one.name.upper()}"
    return f"`{', '.join(one.opts)}{value}`"


def _cell(one: Any) -> str:
    return str(one.help).replace("|", "\\|").replace("\n", " ")
