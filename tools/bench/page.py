"""What the live page costs the service, and whether it grows: ``python tools/bench/page.py [MINUTES]``.

A service on a virtual drive moves to and fro at 2 kHz.  First nobody looks, then chromium does, for so many minutes:
the CPU time of the service process with and without it, the pictures that the page draws a second, and the memory of
both: the largest of either half, as a motion that is laid out takes some for a while.  The processes that the service
starts (control loop, recorder, planner) are counted apart: they run the same without a page.
"""

import os
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[2]))

from stagectl.units import StageError
from tests.service.serving import Served, free_port, served

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
    port = free_port()
    with (
        tempfile.TemporaryDirectory(prefix="stagectl-") as name,
        served(Path(name), "--tcp", f"127.0.0.1:{port}") as machine,
    ):
        machine.until(lambda axis: axis["state"] != "connecting")
        machine.ask("POST", "enable")
        _move(machine)
        assert machine.process is not None
        alone = _share(machine.process.pid, ALONE)
        told = _watched(machine, machine.process.pid, port, 60.0 * minutes)
    sys.exit(0 if _say(alone, told) else 1)


def _move(machine: Served) -> None:
    """Go on moving: the motion before this one ends first."""
    end = time.monotonic() + 600.0
    while time.monotonic() < end:
        try:
            machine.ask("POST", "trajectory", yaml=SINE, wait=False)
            return
        except (StageError, OSError):
            time.sleep(0.5)
    raise TimeoutError(machine.log)


def _watched(machine: Served, pid: int, port: int, seconds: float) -> dict[str, float]:
    """What it costs while a browser looks."""
    key = (machine.folder / "state" / "key").read_text().strip()
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page()
        page.add_init_script(_COUNTED)
        _move(machine)
        page.goto(f"http://127.0.0.1:{port}/#{key}")
        page.wait_for_timeout(1e3 * SETTLED)
        _move(machine)
        held, begun, seen = [_memory(pid, page)], time.monotonic(), _pictures(page)
        spent, others = _cpu(pid), _cpu_of_children(pid)
        while (left := begun + seconds - time.monotonic()) > 0.0:
            page.wait_for_timeout(1e3 * min(left, AGAIN))
            _move(machine)
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
    print(f"the page costs {share - alone:.1f} %; loop, recorder and planner beside it: {told['others']:.1f} %")
    print(f"pictures: {told['pictures']:.0f} a second")
    print(f"growth: service {told['service']:.0f} KiB, page {told['page']:.0f} KiB")
    return share <= SHARE and max(told["service"], told["page"]) <= GROWTH


if __name__ == "__main__":
    main()
