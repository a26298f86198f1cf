"""The moving picture of the README: ``python tools/manual/live_page.py [FILE.webp]``, docs/live-page.webp unless named.

A service on a virtual drive moves to and fro while chromium looks at its live page.  Each picture that the browser
draws is shown as long as it stood: the animation runs at the speed of the axis.
"""

import base64
import io
import itertools
import shutil
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from PIL import Image
from playwright.sync_api import Page, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.conftest import ROOT
from tests.service.serving import Served, free_port, served

MOTION = "{type: sine, amplitude: 10 mm, frequency: 0.5 Hz, periods: 60}"
SHOWN = 6.0  # s of motion: whole periods of it, so that the end meets the beginning
SIZE = {"width": 1280, "height": 860}  # of the window, pixels
WIDTH = 960  # of the pictures, pixels
INTERVAL = 0.1  # s between two pictures at least: the file stays small
SPAN = 5  # s that the curves show
SETTLED = 5.0  # s until a page that was opened leaves the processor to the axis
FILLED = 65.0  # s of motion until they fill their plots, and the start has left the loop's last minute
QUALITY = 60  # of WebP, 0 to 100: letters stay sharp


class Frame(NamedTuple):
    """One picture and the time at which it was taken (s)."""

    picture: Image.Image
    time: float


def recorded(page: Page, machine: Served, port: int) -> list[Frame]:
    """The live page of a moving axis for `SHOWN` seconds."""
    key = (machine.folder / "state" / "key").read_text().strip()
    machine.until(lambda axis: axis["state"] != "connecting")
    page.goto(f"http://127.0.0.1:{port}/#{key}")
    page.wait_for_timeout(1e3 * SETTLED)
    machine.ask("POST", "enable")
    machine.ask("POST", "trajectory", yaml=MOTION, wait=False)
    page.select_option("#strip-span", str(SPAN))
    machine.until(lambda axis: axis["state"] == "moving")
    page.wait_for_timeout(1e3 * FILLED)
    return _screencast(page)


def _screencast(page: Page) -> list[Frame]:
    """What the browser draws during `SHOWN` seconds: it sends the next picture when the last one is acknowledged."""
    frames: list[Frame] = []
    session = page.context.new_cdp_session(page)

    def keep(event: dict) -> None:
        picture = Image.open(io.BytesIO(base64.b64decode(event["data"])))
        frames.append(Frame(picture, event["metadata"]["timestamp"]))
        session.send("Page.screencastFrameAck", {"sessionId": event["sessionId"]})

    session.on("Page.screencastFrame", keep)
    session.send("Page.startScreencast", {"format": "jpeg", "quality": 95, "maxWidth": WIDTH, "maxHeight": WIDTH})
    page.wait_for_timeout(1e3 * SHOWN)
    session.send("Page.stopScreencast")
    return _thinned(sorted(frames, key=lambda frame: frame.time))  # they do not always come in order


def _thinned(frames: list[Frame]) -> list[Frame]:
    kept = frames[:1]
    for frame in frames[1:]:
        if frame.time >= kept[-1].time + INTERVAL:
            kept.append(frame)
    return kept


def write(frames: list[Frame], path: Path) -> None:
    """As an animation that begins again; the last frame only says how long the one before it stood."""
    lasting = [round(1e3 * (after.time - frame.time)) for frame, after in itertools.pairwise(frames)]
    first, *others = [frame.picture for frame in frames[:-1]]
    first.save(path, save_all=True, append_images=others, duration=lasting, loop=0, quality=QUALITY, method=6)


def main() -> None:
    """The command."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "live-page.webp"
    port = free_port()
    with sync_playwright() as driver, tempfile.TemporaryDirectory(prefix="stagectl-") as name:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport=SIZE)  # a browser that starts takes the processor from a loop that runs
        with served(Path(name), "--tcp", f"127.0.0.1:{port}") as machine:
            frames = recorded(page, machine, port)
        browser.close()
    write(frames, path)
    print(f"{path}: {len(frames) - 1} pictures, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
