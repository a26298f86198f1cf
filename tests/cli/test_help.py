"""Every verb tells how it is used: an example, a machine-readable result, completion, exit codes."""

from __future__ import annotations

import datetime
import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from stagectl.cli.app import application
from stagectl.identification.catalogue import METHODS
from stagectl.units import StageError
from stagectl.web.client import ask
from tests.cli.conftest import Command
from tests.conftest import CONFIG, SOURCES

ROOT: Any = typer.main.get_command(application())


def verbs(group: Any = ROOT, name: str = "") -> Iterator[tuple[str, Any]]:
    for word, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from verbs(command, f"{name}{word} ")
        elif not command.hidden:
            yield f"{name}{word}", command


VERBS = dict(verbs())


@pytest.mark.parametrize("name", VERBS)
def test_this_verb_has_help_with_an_example_and_results_for_machines(name: str, command: Command) -> None:
    code, out, _ = command(*name.split(), "--help")
    assert code == 0 and "Usage:" in out
    assert f"stagectl {name}" in (VERBS[name].help or "").partition("Example:")[2]
    assert any("--json" in param.opts for param in VERBS[name].params)


def test_the_methods_of_identify_are_listed_before_one_is_named() -> None:
    (method,) = [param for param in VERBS["identify"].params if param.name == "method"]
    assert all(f"\n\n{name}: {about.words}" in method.help for name, about in METHODS.items())


def test_all_verbs_were_walked() -> None:
    """Those that go on until they are stopped, those of a group, and one deep in it."""
    assert len(VERBS) >= 44
    assert {"serve", "virtual-drive", "service install", "fault list", "gap watch", "config schema"} <= set(VERBS)


def _answers(socket: Path) -> bool:
    time.sleep(0.1)
    try:
        return bool(ask(socket, "GET", "/v1/status"))
    except StageError:
        return False


@pytest.mark.parametrize("verb", ["virtual-drive", "serve"])
def test_what_goes_on_tells_a_line_of_json_each(verb: str, tmp_path: Path) -> None:
    """From its first words on; nothing else is on standard output."""
    stage = shutil.copytree(CONFIG, tmp_path / "config") / "ball-screw.yaml"
    places = ["--socket", str(tmp_path / "control"), "--state", str(tmp_path)] if verb == "serve" else []
    command = [sys.executable, "-m", "stagectl", verb, str(stage), "--channel", str(tmp_path / "bus"), *places]
    environment = {**os.environ, "PYTHONPATH": SOURCES}
    with subprocess.Popen([*command, "--json", "-"], stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            assert process.stdout is not None
            first = json.loads(process.stdout.readline())
            while verb == "serve" and not _answers(tmp_path / "control"):
                assert process.poll() is None
        finally:
            process.terminate()
        rest = [json.loads(line) for line in process.stdout]
    assert process.returncode == 0
    for event in (first, *rest):
        assert set(event) == {"time", "words"}
        assert datetime.datetime.fromisoformat(event["time"]).tzinfo is not None
    assert {"virtual-drive": "virtual drive of ball-screw", "serve": "live page: http://127.0.0.1:"}[verb] in first[
        "words"
    ]


def test_installing_tells_what_it_did(command: Command, tmp_path: Path) -> None:
    done = []
    for words in (("install", CONFIG / "ball-screw.yaml", "--no-start"), ("remove",)):
        code, out, said = command("service", *words, "--root", tmp_path, "--json", "-")
        assert code == 0, said
        done.append(json.loads(out)["done"])
        assert done[-1] == [line for line in said.splitlines() if line]
    unit = tmp_path / "etc/systemd/system/stagectl.service"
    assert f"wrote {unit}" in done[0]
    assert f"removed {unit}" in done[1]


def test_a_schema_goes_where_it_is_sent(command: Command, tmp_path: Path) -> None:
    _, printed, _ = command("config", "schema", "trajectory")
    code, out, said = command("config", "schema", "trajectory", "--json", tmp_path / "schema.json")
    assert (code, out) == (0, ""), said
    assert json.loads((tmp_path / "schema.json").read_text()) == {"written_by": "stagectl", **json.loads(printed)}


def test_completion_knows_the_verbs() -> None:
    """As bash asks for it, with the cursor behind ``stagectl dr``."""
    asked = {"_STAGECTL_COMPLETE": "complete_bash", "COMP_WORDS": "stagectl dr", "COMP_CWORD": "1"}
    done = subprocess.run(
        [sys.executable, "-c", "import sys; sys.argv[0] = 'stagectl'; from stagectl.cli import main; main()"],
        env={**asked, "PATH": "/usr/bin:/bin", "PYTHONPATH": SOURCES},
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
