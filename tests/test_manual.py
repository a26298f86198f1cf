"""The manual: it builds strictly, and its pictures and tables are what they say.  `test_printed` types its commands."""

from __future__ import annotations

import inspect
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright
from stagectl_studies.effect_pictures.scenes import scenes

from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.inference.patch_fields import fields_of
from tests.conftest import ROOT, SOURCES
from tests.printed import tool


def test_the_manual_builds_strictly(tmp_path: Path) -> None:
    """Every link and anchor resolves; pages of effects, reference and commands are there.  Pictures are left blank."""
    environment = {**os.environ, "STAGECTL_MANUAL_PLAIN": "1", "PYTHONPATH": SOURCES, "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "-q", "-f", "mkdocs.yml", "-d", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    site = tmp_path / "site"
    stage = (site / "reference" / "stage.html").read_text()
    assert "effort of one ampere, Kt" in stage and "(0, 1e6]" in stage
    effects = "".join(path.read_text() for path in (site / "effects").glob("*.html"))
    for name in ("viscous_asymmetry", "encoder_interpolation", "current_quantisation", "controller"):
        assert f'id="{name}"' in effects
        assert f"pictures/{name}-dark.png" in effects
    assert "stagectl drive probe" in (site / "reference" / "commands.html").read_text()
    for page in site.rglob("*.html"):
        text = page.read_text()
        assert not re.search(r'<script[^>]*src="https?://|href="https?://[^"]*\.(css|woff2?)', text), page
    _search_works_from_a_folder(site / "index.html")


def _search_works_from_a_folder(page: Path) -> None:
    """In a browser without a network, where there is one."""
    chromium = shutil.which("chromium")
    if chromium is None:
        return
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        tab = browser.new_context(offline=True).new_page()
        tab.goto(page.as_uri())
        tab.locator(".md-search__input").click()
        tab.keyboard.type("backlash")
        first = tab.locator(".md-search-result__item a").first
        first.wait_for(timeout=60_000)
        assert "effects/" in str(first.get_attribute("href"))
        browser.close()


def test_the_lines_below_each_picture_play_its_effect(ball_screw: Setup, tmp_path: Path) -> None:
    """Read back, the stage file with the printed lines is the machine of the picture."""
    maker, played = tool("effects"), 0
    for name, scene in scenes().items():
        if not EFFECTS[name].in_stage_file:
            continue
        path = tmp_path / f"{name}.yaml"
        path.write_text(maker.changed(ball_screw, scene))
        read_back, base = load_stage(path, designed=False).stage, ball_screw.stage
        wanted = dict(fields_of(scene.base(base), scene.change(scene.base(base))))
        assert wanted and fields_of(base, read_back), name
        for place, value in fields_of(base, read_back):
            if place in wanted and not isinstance(value, str):
                assert np.allclose(value, wanted[place], rtol=1e-6), (name, place)
        played += 1
    assert played == sum(effect.in_stage_file for effect in EFFECTS.values()) >= 34


def test_the_reference_names_every_entry() -> None:
    """What the schema knows, the reference shows: counted in two ways."""
    from stagectl.config.schema import stage_schema

    def keys(node: object) -> set[str]:
        if isinstance(node, dict):
            own = set(node.get("properties", {}))
            return own.union(*(keys(child) for child in node.values()), set())
        return set().union(*map(keys, node)) if isinstance(node, list) else set()

    shown = {row.key for block in tool("file_entries").stage_blocks() for row in block.rows}
    tags = {"law", "kind", "form", "fault"}  # shown with the block's title
    assert keys(stage_schema()) - tags == shown - tags


def test_the_python_reference_shows_no_words_of_built_in_types() -> None:
    """A field's docstring is that of its value's type: it says nothing of the field."""
    page = tool("api").pages()["reference/api.md"]
    built_in = {str(inspect.getdoc(kind)).splitlines()[0] for kind in (str, bool, tuple, dict, type(Path()))}
    rows = re.findall(r"^\| `\w+` \| (.+) \|$", page, re.MULTILINE)
    assert len(rows) > 50
    assert built_in.isdisjoint(rows)


def test_links_of_readme_and_manual_lead_somewhere_in_the_repository() -> None:
    """As they are followed where the sources are shown; of the manual's own pages some are made when it is built."""
    made = ("effects/", "reference/", "drives.md")
    followed = 0
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if "://" in target or (page.parent.name == "docs" and target.startswith(made)):
                continue
            assert (page.parent / target).exists(), f"{page.name}: {target}"
            followed += 1
    assert followed >= 25
