"""What the reports' pages do in a browser: rows that are searched, figures that are enlarged."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from stagectl.report.page import Page, Picture, Section, Table, write

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
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
        "title", "answer", [], [Picture(IMAGE, "one"), Picture(IMAGE, "two")], [], [], {}, False, SECTIONS, True
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
