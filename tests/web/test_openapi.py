"""The control interface against schemathesis: what its OpenAPI document says is what it does, whatever is asked."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.service.serving import free_port, served

EXAMPLES = 12  # drawn for each operation, beside the systematic ones


def test_schemathesis_finds_nothing(tmp_path: Path) -> None:
    pytest.importorskip("schemathesis", reason="schemathesis is not installed: `pip install -e '.[dev]'`")
    address = f"127.0.0.1:{free_port()}"
    with served(tmp_path, "--tcp", address, "--tcp-may-move") as machine:
        token = (tmp_path / "state" / "token").read_text().strip()
        words = ["run", f"http://{address}/openapi.json", "--header", f"Authorization: Bearer {token}", "--no-color"]
        words += [
            "--phases",
            "examples,coverage,fuzzing",
            "--max-examples",
            str(EXAMPLES),
            "--generation-deterministic",
        ]
        words += ["--max-time", "60", "--request-timeout", "60", "--continue-on-failure"]
        program = "import sys; from schemathesis.cli import schemathesis; sys.exit(schemathesis())"
        done = subprocess.run(
            [sys.executable, "-c", program, *words], cwd=ROOT, capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
        assert machine.axis()["faults"] == 0 and "process_died" not in machine.faults()
        assert "Traceback" not in machine.log
