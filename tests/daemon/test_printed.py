"""The README's commands of a service, as printed, against a service that runs."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

from tests.conftest import ROOT
from tests.daemon.serving import served

BLOCK = re.search(r"## As a service\n\n```\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)


def test_the_commands_of_the_service_run_as_printed(tmp_path: Path) -> None:
    """`serve` is how the service was started; `doctor` may find something, and says so by its exit code."""
    assert BLOCK is not None
    commands = [shlex.split(line, comments=True) for line in BLOCK[1].splitlines()]
    assert commands[0][1] == "serve" and len(commands) >= 6
    with served(tmp_path) as machine:
        machine.until(lambda axis: axis["state"] == "disabled")
        environment = {**os.environ, "STAGECTL_SOCKET": str(machine.socket)}
        for words in (one for one in commands if one[1] != "serve"):
            done = subprocess.run(
                [sys.executable, "-m", *words], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300
            )
            assert done.returncode == 0 or (words[1] == "doctor" and done.returncode == 1), (words, done.stderr)
            assert "Traceback" not in done.stderr
        assert abs(machine.axis()["position"] - 10e-3) < 1e-6
