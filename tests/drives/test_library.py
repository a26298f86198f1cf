"""The canopen library without python-can: what the real-time process does not load, and what still works with it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.conftest import ROOT

NEITHER = """
import sys
import stagectl.realtime.axes
print(sorted({"can", "asyncio", "numpy", "numba", "scipy", "yaml"} & set(sys.modules)))
"""
BOTH = """
import sys
from stagectl.drives.canopen.library import canopen
from stagectl.drives.bus.can_plugin import EmbeddedBus
heard = []
here, there = canopen.Network(EmbeddedBus(channel=sys.argv[1])), canopen.Network(EmbeddedBus(channel=sys.argv[1]))
there.connect()
there.subscribe(0x123, lambda identifier, data, stamp: heard.append(bytes(data)))
here.connect()
here.send_message(0x123, b"true")
while not heard:
    pass
here.disconnect()
there.disconnect()
print(heard)
"""


def printed(program: str, *words: str) -> str:
    environment = {**os.environ, "STAGECTL_KERNELS": "interpreted"}
    done = subprocess.run(
        [sys.executable, "-c", program, *words], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_the_real_time_process_imports_neither_python_can_nor_asyncio() -> None:
    assert printed(NEITHER) == "[]"


def test_the_librarys_own_network_still_reaches_python_can(tmp_path: Path) -> None:
    """Its notifier calls a listener that was derived from our stand-in."""
    assert printed(BOTH, str(tmp_path)) == "[b'true']"


def test_what_the_library_logs_does_not_appear_beside_our_words() -> None:
    program = (
        "import logging, stagectl.drives.canopen.library; logging.getLogger('canopen.sdo.client').error('no answer')"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
