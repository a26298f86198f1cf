"""A recording that is interrupted while the service begins it is ended, not left to go on unattended."""

from __future__ import annotations

import subprocess
import sys

INTERRUPTED = """
import os, signal
from stagectl.cli import record
from stagectl.service.shutdown_signals import interrupting

def asked(_, method, path, body=None):
    print(method, path, flush=True)
    if path == "/v1/recordings":
        os.kill(os.getpid(), signal.SIGTERM)  # any thread that does not hold it back takes it
        for _ in range(1000):
            pass
    return {"axis": "axis", "file": "r.h5", "path": "r.h5"}

record.ask_service = asked
with interrupting():
    record._recorded({"axis": "", "name": "", "before": 0.0, "seconds": 1.0}, True, None)
"""


def test_a_signal_while_the_service_begins_ends_the_recording() -> None:
    ran = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.splitlines()[-1] == "POST /v1/recordings/end?axis=axis"
