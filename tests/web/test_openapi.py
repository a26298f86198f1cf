"""The control interface against schemathesis: what its OpenAPI document says is what it does, whatever is asked."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.web.client import ask
from tests.conftest import ROOT
from tests.service.serving import Served, free_port, served

EXAMPLES = int(os.environ.get("STAGECTL_LONG", "2"))  # drawn for each operation, beside the systematic ones
SYSTEMATIC = "examples,coverage"
SECRET = "nobody may read this"
UNMOVED = ("state", "homed", "faults", "fault", "words")  # of an axis that nobody has ordered anything


def fuzzed(document: str, *words: str, phases: str = f"{SYSTEMATIC},fuzzing") -> subprocess.CompletedProcess[str]:
    """Schemathesis over the whole document, once: with a time to spend it would draw the same examples again."""
    words = ("run", document, "--no-color", *words)
    words += ("--phases", phases, "--max-examples", str(EXAMPLES), "--generation-deterministic")
    words += ("--request-timeout", "60", "--continue-on-failure")
    program = "import sys; from schemathesis.cli import schemathesis; sys.exit(schemathesis())"
    command = [sys.executable, "-c", program, *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)


def files(folder: Path) -> dict[str, int]:
    """What there is below, but for the log and what is being served, with its size."""
    return {str(path): path.stat().st_size for path in folder.rglob("*") if path.is_file() and path.name != "log"}


def test_schemathesis_finds_nothing(tmp_path: Path) -> None:
    pytest.importorskip("schemathesis", reason="schemathesis is not installed: `pip install -e '.[dev]'`")
    address = f"127.0.0.1:{free_port()}"
    with served(tmp_path, "--tcp", address, "--tcp-may-move") as machine:
        token = (tmp_path / "state" / "token").read_text().strip()
        done = fuzzed(f"http://{address}/openapi.json", "--header", f"Authorization: Bearer {token}")
        assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
        assert machine.axis()["faults"] == 0 and "process_died" not in machine.faults()
        assert "Traceback" not in machine.log


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Served, str]]:
    """A service that nobody moves over TCP, with a recording that not everybody may read; and its address."""
    folder, address = tmp_path_factory.mktemp("guarded"), f"127.0.0.1:{free_port()}"
    with served(folder, "--tcp", address) as machine:
        machine.ask("POST", "recordings", name=SECRET, before=0.0, seconds=1.0)
        machine.ask("POST", "enable")
        machine.until(lambda axis: not machine.ask("GET", "recordings")[0]["going_on"])
        yield machine, address


@pytest.mark.parametrize("token", ["", "Authorization: Bearer %s"], ids=["stranger", "reader"])
def test_without_rights_nothing_is_read_nothing_moves_and_nothing_is_left(
    guarded: tuple[Served, str], tmp_path: Path, token: str
) -> None:
    """A stranger is told that the token is missing; a reader changes nothing; neither leaves a trace."""
    pytest.importorskip("schemathesis", reason="schemathesis is not installed: `pip install -e '.[dev]'`")
    machine, address = guarded
    document = tmp_path / "openapi.json"  # which a stranger would not be given
    document.write_text(json.dumps(ask(machine.socket, "GET", "/openapi.json")))
    secret = (machine.folder / "state" / "token").read_text().strip()
    before, held, there = machine.heard(), machine.descriptors(), files(machine.folder)
    words = ["--header", token % secret] if token else []
    words += ["--url", f"http://{address}", "--checks", "not_a_server_error", "--mode", "positive"]
    done = fuzzed(str(document), *words, phases=SYSTEMATIC)  # requests that an owner's key would have carried out
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    if not token:
        assert SECRET not in done.stdout + done.stderr
    after = machine.heard()
    assert {key: after[key] for key in UNMOVED} == {key: before[key] for key in UNMOVED}
    assert abs(after["reference"] - before["reference"]) == 0.0
    assert machine.ask("GET", "parameters") and machine.holds_no_more_than(held)
    assert files(machine.folder) == there
    assert "Traceback" not in machine.log
