"""The moving picture of the README: ``python tools/manual/live_page.py [FILE.webp]``, docs/live-page.webp unless named.

A service on a virtual drive moves to and fro while chromium looks at its live page.  Pictures are taken as fast as the
browser gives them, and each is shown as long as it stood: the animation runs at the speed of the axis.
"""

from __future__ import annotations

import io
import itertools
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from PIL import Image
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.conftest import ROOT
from tests.service.serving import Served, free_port, served

MOTION = "{type: sine, amplitude: 10 mm, frequency: 0.5 Hz, periods: 30}"
SHOWN = 6.0  # s of motion: whole periods of it, so that the end meets the beginning
SIZE, SCALE = {"width": 1280, "height": 860}, 0.75  # of the window (pixels); 960 pixels wide on most screens
SPAN = 5  # s that the curves show
FILLED = SPAN + 2.0  # s of motion until they fill their plots
QUALITY = 60  # of WebP, 0 to 100: letters stay sharp


class Frame(NamedTuple):
    """One picture and the time at which it was taken (s)."""

    picture: Image.Image
    time: float


def recorded(machine: Served, port: int) -> list[Frame]:
    """The page of a moving axis for `SHOWN` seconds."""
    key = (machine.folder / "state" / "key").read_text().strip()
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport=SIZE, device_scale_factor=SCALE)
        page.goto(f"http://127.0.0.1:{port}/#{key}")
        machine.until(lambda axis: axis["state"] != "connecting")
        machine.ask("POST", "enable")
        machine.ask("POST", "trajectory", yaml=MOTION, wait=False)
        page.select_option("#strip-span", str(SPAN))
        machine.until(lambda axis: axis["state"] == "moving")
        page.wait_for_timeout(1e3 * FILLED)
        frames = list(_frames(lambda: page.screenshot(type="jpeg", quality=95)))
        browser.close()
    return frames


def _frames(shot: Callable[[], bytes]) -> list[Frame]:
    frames: list[Frame] = []
    while not frames or frames[-1].time < frames[0].time + SHOWN:
        now = time.monotonic()
        frames.append(Frame(Image.open(io.BytesIO(shot())), now))
    return frames


def write(frames: list[Frame], path: Path) -> None:
    """As an animation that begins again; the last frame only says how long the one before it stood."""
    lasting = [round(1e3 * (after.time - frame.time)) for frame, after in itertools.pairwise(frames)]
    first, *others = [frame.picture for frame in frames[:-1]]
    first.save(path, save_all=True, append_images=others, duration=lasting, loop=0, quality=QUALITY, method=6)


def main() -> None:
    """The command."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "live-page.webp"
    port = free_port()
    with (
        tempfile.TemporaryDirectory(prefix="stagectl-") as name,
        served(Path(name), "--tcp", f"127.0.0.1:{port}") as machine,
    ):
        frames = recorded(machine, port)
    write(frames, path)
    print(f"{path}: {len(frames) - 1} pictures, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
