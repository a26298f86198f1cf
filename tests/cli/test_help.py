"""Every verb tells how it is used: an example, a machine-readable result, completion, exit codes."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from stagectl.cli.app import app
from tests.cli.conftest import Command
from tests.conftest import CONFIG

ROOT: Any = typer.main.get_command(app)
# What runs until it is stopped, prints a schema or a report that is a page, or changes the machine.
WITHOUT_JSON = {"virtual-drive", "demo", "serve", "service install", "service remove", "config schema", "gap watch"}


def verbs(group: Any = ROOT, name: str = "") -> Iterator[tuple[str, Any]]:
    for word, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from verbs(command, f"{name}{word} ")
        elif not command.hidden:
            yield f"{name}{word}", command


VERBS = dict(verbs())


@pytest.mark.parametrize("name", VERBS)
def test_help_has_an_example_of_this_verb(name: str) -> None:
    assert f"stagectl {name}" in (VERBS[name].help or "").partition("Example:")[2]


def test_results_for_machines() -> None:
    without = {name for name, verb in VERBS.items() if not any("--json" in one.opts for one in verb.params)}
    assert without <= WITHOUT_JSON


def test_completion_knows_the_verbs() -> None:
    """As bash asks for it, with the cursor behind ``stagectl dr``."""
    asked = {"_STAGECTL_COMPLETE": "complete_bash", "COMP_WORDS": "stagectl dr", "COMP_CWORD": "1"}
    done = subprocess.run(
        [sys.executable, "-c", "import sys; sys.argv[0] = 'stagectl'; from stagectl.cli import main; main()"],
        env={**asked, "PATH": "/usr/bin:/bin", "PYTHONPATH": str(CONFIG.parent)},
        capture_output=True,
        text=True,
        timeout=300,  # the machine is shared
    )
    assert "drive" in done.stdout.split(), done.stderr


def test_a_check_for_machines(command: Command, tmp_path: Path) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text("type: sine\n")
    code, out, _ = command("config", "check", CONFIG / "ball-screw.yaml", bad, tmp_path / "none.yaml", "--json", "-")
    good, wrong, missing = json.loads(out)["files"]
    assert code == 2
    assert (good["code"], wrong["code"], missing["code"]) == (0, 1, 2)
    assert "phase margin" in good["words"] and good["errors"] == []
    assert any("amplitude is missing" in line for line in wrong["errors"])
    assert shlex.quote(good["file"]).endswith("ball-screw.yaml")
