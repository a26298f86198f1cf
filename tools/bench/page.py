"""What the live page costs the service, and whether it grows: ``python tools/bench/page.py [MINUTES]``.

A service on a virtual drive moves to and fro at 2 kHz.  First nobody looks, then chromium does, for so many minutes:
the CPU time of the service process with and without it, the pictures that the page draws a second, and the memory of
both: the largest of either half, as a motion that is laid out takes some for a while.  The processes that the service
starts (control loop, recorder, virtual drive, planner) are counted apart: they run the same without a page.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from stagectl.units import StageError
from stagectl.web.client import ask

ROOT = Path(__file__).parents[2]
SHARE, GROWTH = 4.0, 4096  # % of a core for the whole service process with a viewer, KiB: what is admitted
SINE = "{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 50}"
ALONE, SETTLED, AGAIN = 30.0, 60.0, 55.0  # s without a viewer; after which memory is compared; of one motion
_COUNTED = """
window.pictures = 0;
const clear = CanvasRenderingContext2D.prototype.clearRect;
CanvasRenderingContext2D.prototype.clearRect = function (...place) {
  if (this.canvas.closest("#strip-position")) window.pictures++;
  return clear.apply(this, place);
};
"""
_TICKS = os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Measure, say; exit 1 where it grows or costs more than admitted."""
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    for each in (signal.SIGTERM, signal.SIGHUP):  # ended from outside: the service ends too
        signal.signal(each, lambda number, _: sys.exit(128 + number))
    with tempfile.TemporaryDirectory(prefix="stagectl-") as name:
        folder, port = Path(name), _free_port()
        process = _service(folder, port)
        try:
            _moving(folder)
            alone = _share(process.pid, ALONE)
            told = _watched(process.pid, folder, port, 60.0 * minutes)
        finally:
            process.terminate()
            process.wait()
    good = _say(alone, told)
    sys.exit(0 if good else 1)


def _service(folder: Path, port: int) -> subprocess.Popen[bytes]:
    """A service on a virtual drive."""
    words = ["serve", str(ROOT / "config" / "ball-screw.yaml"), "--socket", str(folder / "control.sock")]
    words += ["--state", str(folder / "state"), "--channel", str(folder / "bus"), "--tcp", f"127.0.0.1:{port}"]
    return subprocess.Popen([sys.executable, "-m", "stagectl", *words], cwd=ROOT)


def _moving(folder: Path) -> None:
    """Its axis moves."""
    _asked(folder, "GET", "status")
    _asked(folder, "POST", "enable")
    _asked(folder, "POST", "trajectory", yaml=SINE, wait=False)


def _asked(folder: Path, method: str, what: str, **body: Any) -> None:
    """Ask until it agrees: it takes its time to come up, and to end a motion."""
    end = time.monotonic() + 600.0
    while True:
        try:
            ask(folder / "control.sock", method, f"/v1/{what}", body or None)
            return
        except (StageError, OSError):
            if time.monotonic() > end:
                raise
            time.sleep(0.5)


def _watched(pid: int, folder: Path, port: int, seconds: float) -> dict[str, float]:
    """What it costs while a browser looks."""
    key = (folder / "state" / "key").read_text().strip()
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page()
        page.add_init_script(_COUNTED)
        _asked(folder, "POST", "trajectory", yaml=SINE, wait=False)
        page.goto(f"http://127.0.0.1:{port}/#{key}")
        page.wait_for_timeout(1e3 * SETTLED)
        _asked(folder, "POST", "trajectory", yaml=SINE, wait=False)
        held, begun, seen = [_memory(pid, page)], time.monotonic(), _pictures(page)
        spent, others = _cpu(pid), _cpu_of_children(pid)
        while (left := begun + seconds - time.monotonic()) > 0.0:
            page.wait_for_timeout(1e3 * min(left, AGAIN))
            _asked(folder, "POST", "trajectory", yaml=SINE, wait=False)
            held.append(_memory(pid, page))
            print(f"{time.monotonic() - begun:6.0f} s  service, page (KiB): {held[-1]}", flush=True)
        took = time.monotonic() - begun
        found = {"share": 100.0 * (_cpu(pid) - spent) / took, "pictures": (_pictures(page) - seen) / took}
        found["others"] = 100.0 * (_cpu_of_children(pid) - others) / took
        browser.close()
    half = max(len(held) // 2, 1)
    growth = np.max(held[-half:], axis=0) - np.max(held[:half], axis=0)
    return {**found, "service": float(growth[0]), "page": float(growth[1])}


def _pictures(page: Any) -> int:
    """How often the page has drawn its first strip."""
    return int(page.evaluate("window.pictures"))


def _memory(pid: int, page: Any) -> tuple[int, int]:
    """Resident memory of the service, and what the page's script holds after a collection (KiB)."""
    text = Path(f"/proc/{pid}/status").read_text()
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    held = session.send("Runtime.getHeapUsage")["usedSize"]
    session.detach()
    return int(text.split("VmRSS:")[1].split()[0]), int(held / 1024)


def _cpu(pid: int) -> float:
    """CPU time of a process (s)."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / _TICKS


def _cpu_of_children(pid: int) -> float:
    """CPU time of the processes that a process has started and of theirs (s): those that run."""
    told = [int(each) for path in Path(f"/proc/{pid}/task").glob("*/children") for each in path.read_text().split()]
    return sum(_cpu(each) + _cpu_of_children(each) for each in told)


def _share(pid: int, seconds: float) -> float:
    before = _cpu(pid)
    time.sleep(seconds)
    return 100.0 * (_cpu(pid) - before) / seconds


def _say(alone: float, told: dict[str, float]) -> bool:
    share = told["share"]
    print(f"service: {share:.1f} % of a core with a viewer ({SHARE:.0f} % admitted), {alone:.1f} % without")
    print(f"the page costs {share - alone:.1f} %; loop, recorder and drive beside it: {told['others']:.1f} %")
    print(f"pictures: {told['pictures']:.0f} a second")
    print(f"growth: service {told['service']:.0f} KiB, page {told['page']:.0f} KiB")
    return share <= SHARE and max(told["service"], told["page"]) <= GROWTH


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    main()
