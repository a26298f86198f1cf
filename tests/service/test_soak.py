"""A few seconds of `tools/soak.py`: an hour of it is the tool's own business."""

from __future__ import annotations

import re
import subprocess
import sys

from tests.conftest import ROOT


def test_the_real_time_process_keeps_its_memory_and_loses_no_row() -> None:
    done = subprocess.run([sys.executable, ROOT / "tools" / "soak.py", "5"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    written, kept, lost = map(int, re.findall(r"(\d+) rows, (\d+) recorded, (\d+) lost", done.stdout)[0])
    assert written == kept > 5 * 2000
    assert lost == 0
