"""What the reports' pages do in a browser: rows that are searched, figures that are enlarged."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stagectl as sc
from stagectl.report.page import Page, Picture, Section, Table, write
from stagectl.report.panels import Frame, Line, picture
from stagectl.web import assets
from tests.conftest import CONFIG

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SHOTS = os.environ.get("STAGECTL_SCREENSHOTS")  # a folder, for who wants to look
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
IMAGE = "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' width='800' height='400'/%3E"
SECTIONS = (
    Section(
        "Encoder", [], [], [Table("", ["fault", "state"], [["encoder-stuck", "moving"], ["encoder-off", "homing"]])]
    ),
    Section("Bus", [], [], [Table("", ["fault", "state"], [["cable-out", "moving"]])]),
)


@pytest.fixture
def shown(tmp_path: Path) -> Iterator[Any]:
    page = Page(
        "title", "answer", [], [Picture(IMAGE, "one"), Picture(IMAGE, "two")], [], [], {}, SECTIONS, filtered=True
    )
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        view = chromium.new_page(viewport={"width": 1280, "height": 900})
        view.goto(write(page, tmp_path / "page.html").as_uri())
        yield view
        chromium.close()


def test_rows_are_searched_by_words_of_row_and_section(shown: Any) -> None:
    rows = shown.locator("section td:first-child:visible")
    assert rows.all_inner_texts() == ["encoder-stuck", "encoder-off", "cable-out"]
    shown.fill(".filter", "encoder MOVING")
    assert rows.all_inner_texts() == ["encoder-stuck"]
    assert shown.locator("section:visible").count() == 1  # nor a heading without rows
    shown.fill(".filter", "")
    assert rows.count() == 3


def test_a_figure_is_enlarged_by_a_click_or_enter(shown: Any) -> None:
    figure = shown.locator("figure").first
    small = figure.bounding_box()["width"]
    figure.locator("img").click()
    assert figure.bounding_box()["width"] > 1.5 * small
    shown.keyboard.press("Enter")
    assert figure.bounding_box()["width"] == small


@pytest.fixture
def explored(tmp_path: Path) -> Iterator[Any]:
    """Two figures of the same time, the first with a broken curve; one over a frequency, and one over a position."""
    if assets.available() is None:
        pytest.skip("uPlot is not installed")
    time = np.linspace(0.0, 10.0, 501)
    broken = np.where(time > 8.0, np.nan, np.sin(time))
    frames = [Frame("time [s]", "error [µm]", shaded=((2.0, 4.0),)), Frame("time [s]", "current [A]")]
    figures = [
        picture([Line(time, values, "curve")], frame, frame.y)
        for frame, values in zip(frames, (broken, time), strict=True)
    ]
    figures.append(
        picture([Line(time[1:], 9.963e-10 * time[1:])], Frame("frequency [Hz]", "gain", logarithmic=True), "gain")
    )
    figures.append(picture([Line(time, time)], Frame("position [mm]", "error [µm]"), "error"))
    page = Page("title", "answer", [], figures, [], [], {})
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        view = chromium.new_page(viewport={"width": 1280, "height": 900})
        wrong: list[str] = []
        view.on("pageerror", lambda error: wrong.append(str(error)))
        view.on("request", lambda request: wrong.append(request.url) if request.url.startswith("http") else None)
        view.goto(write(page, tmp_path / "page.html").as_uri())
        yield view
        if SHOTS:
            view.screenshot(path=str(Path(SHOTS) / "report.png"), full_page=True)
            view.pdf(path=str(Path(SHOTS) / "report.pdf"))
        chromium.close()
    assert wrong == []


# What a canvas shows as words, each with whether all of it is seen; the last of them under each name.
WORDS = """
window.words = {};
const say = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (words, x, y, ...others) {
  const right = x + this.measureText(words).width, { width, height } = this.canvas;
  window.words[words] = x >= 0 && right <= width && y >= 0 && y <= height;
  return say.call(this, words, x, y, ...others);
};
"""


def drawn(shown: Any) -> list[str]:
    """The picture of each plot's canvas: it changes when the plot shows another time."""
    pictures: list[str] = shown.evaluate("[...document.querySelectorAll('.plots canvas')].map((c) => c.toDataURL())")
    return pictures


def test_plots_of_the_same_time_zoom_together(explored: Any) -> None:
    explored.wait_for_timeout(300)
    whole = drawn(explored)
    assert explored.locator(".u-legend .u-series:first-child:visible").count() == 0  # only curves have names at rest
    assert len(whole) == 3  # what is drawn over a position stays a picture
    assert explored.locator("figure img:visible").count() == 1
    box = explored.locator(".u-over").first.bounding_box()
    explored.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 50)
    explored.mouse.down()
    explored.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 60, steps=5)
    explored.mouse.up()
    explored.wait_for_timeout(200)
    zoomed = drawn(explored)
    assert [a != b for a, b in zip(whole, zoomed, strict=True)] == [True, True, False]
    explored.locator(".plots > div").first.focus()
    explored.keyboard.press("0")
    explored.wait_for_timeout(200)
    assert drawn(explored) == whole
    explored.keyboard.press("+")
    explored.wait_for_timeout(200)
    assert [a != b for a, b in zip(whole, drawn(explored), strict=True)] == [True, True, False]


def test_a_print_holds_the_pictures(explored: Any) -> None:
    assert explored.locator("figure img:visible").count() == 1
    explored.emulate_media(media="print")
    assert explored.locator("figure img:visible").count() == 4
    assert explored.locator(".plots:visible").count() == 0


@pytest.fixture(scope="module")
def tuned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if assets.available() is None:
        pytest.skip("uPlot is not installed")
    return sc.tune(CONFIG / "ball-screw.yaml").save(tmp_path_factory.mktemp("tune") / "tune.html")


@pytest.mark.parametrize("width", [1280, 390])
def test_the_figures_of_a_tuning_zoom_over_the_frequency(tuned: Path, width: int) -> None:
    """With the margins beside their places, as in the picture; the Nyquist plot stays a picture."""
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        view = chromium.new_page(viewport={"width": width, "height": 900})
        wrong: list[str] = []
        view.on("pageerror", lambda error: wrong.append(str(error)))
        view.add_init_script(WORDS)
        view.goto(tuned.as_uri())
        assert view.locator("figure img:visible").count() == 1
        assert view.evaluate("document.documentElement.scrollWidth") <= width
        plots = view.evaluate(
            "[...document.querySelectorAll('[data-plot]')].map((place) => JSON.parse(place.dataset.plot))"
        )
        assert view.locator("h2", has_text="How to do it again").count() == 0  # Python made it, no command
        notes = [note["words"] for plot in plots for panel in plot for note in panel["notes"]]
        assert sum(note.startswith("PM ") for note in notes) == 1 and any(note.startswith("Ms ") for note in notes)
        if SHOTS:
            view.screenshot(path=str(Path(SHOTS) / f"tune-{width}.png"), full_page=True)
        whole = drawn(view)
        for plot in view.locator(".plots > div").all():
            plot.focus()
            for key in ("+", "+", "ArrowRight"):
                view.evaluate("window.words = {}")
                view.keyboard.press(key)
                view.wait_for_timeout(200)
                words = view.evaluate("window.words")
                assert all(words[note] for note in notes if note in words)  # whole, or not at all
        assert drawn(view) != whole
        for plot in view.locator(".plots > div").all():
            plot.focus()
            view.keyboard.press("0")
        view.wait_for_timeout(200)
        assert drawn(view) == whole
        chromium.close()
    assert wrong == []
