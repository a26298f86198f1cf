"""The manual: it builds strictly, and what it prints runs as printed."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.fields import fields_of
from stagectl.report.effects.scenes import scenes
from tests.conftest import CONFIG, ROOT

DOCS = ROOT / ".docs"
SLOW = ("gap record", "gap diagnose")  # in a test of their own
NAMED = re.compile(r'(?m)^ *```yaml title="([\w.-]+\.yaml)"\n(.*?)^ *```', re.DOTALL)
SHELL = re.compile(r"(?m)^ *```sh\n(.*?)^ *```", re.DOTALL)


def printed(page: str) -> list[list[str]]:
    """The commands of a page, in order."""
    blocks = SHELL.findall((DOCS / page).read_text())
    lines = [line.strip() for block in blocks for line in block.splitlines() if line.strip()]
    return [shlex.split(line, comments=True) for line in lines if not line.startswith("#")]


def stagectl(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "HOME": str(folder)}  # a bus of its own
    environment["XDG_CACHE_HOME"] = os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))
    command = [sys.executable, "-m", "stagectl", *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)


def prepared(page: str, folder: Path) -> None:
    """The configuration, and the files that the page tells its reader to write."""
    (folder / "config").symlink_to(CONFIG)
    for name, text in NAMED.findall((DOCS / page).read_text()):
        (folder / name).write_text(text)


@pytest.mark.parametrize(("page", "least"), [("index.md", 10), ("bench.md", 8), ("adding.md", 1)])
def test_every_command_runs_as_printed(page: str, least: int, tmp_path: Path) -> None:
    """In order, in one folder, as a reader would; `make` and the slow ones have tests of their own."""
    prepared(page, tmp_path)
    done = 0
    for words in printed(page):
        if words[0] == "cp":
            (tmp_path / words[2]).write_text((tmp_path / words[1]).read_text())
        if words[0] != "stagectl" or " ".join(words[1:3]) in SLOW:
            continue
        outcome = stagectl(words[1:], tmp_path)
        assert "Traceback" not in outcome.stderr
        assert outcome.returncode == 0 or words[1] == "doctor", (words, outcome.stderr)
        done += 1
    assert done >= least


def test_the_gap_of_the_tour_is_none(tmp_path: Path) -> None:
    """Machine and model are the same there: the slow commands of the tour, and their answer."""
    prepared("index.md", tmp_path)
    commands = [words for words in printed("index.md") if " ".join(words[1:3]) in SLOW]
    assert [words[2] for words in commands] == ["record", "diagnose"]
    said = ""
    for words in commands:
        outcome = stagectl(words[1:], tmp_path)
        assert outcome.returncode == 0, outcome.stderr
        said = outcome.stderr
    assert "none" in said or "no effect" in said, said
    assert (tmp_path / "session" / "diagnosis.html").exists()


def test_the_manual_builds_strictly(tmp_path: Path) -> None:
    """Every link and anchor resolves; pages of effects, reference and commands are there.  Pictures are left blank."""
    environment = {**os.environ, "STAGECTL_MANUAL_PLAIN": "1", "PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "-q", "-f", ".mkdocs.yml", "-d", str(tmp_path / "site")]
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
        assert not re.search(
            r'(src|href)="https?://(?!www\.openapis|squidfunk)[^"]*\.(js|css|woff2?)', page.read_text()
        )


def _tool(name: str) -> Any:
    """A module of tools/manual, which is no package."""
    spec = importlib.util.spec_from_file_location(f"manual_{name}", ROOT / "tools" / "manual" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_lines_below_each_picture_play_its_effect(ball_screw: Setup, tmp_path: Path) -> None:
    """Read back, the stage file with the printed lines is the machine of the picture."""
    tool, played = _tool("effects"), 0
    for name, scene in scenes().items():
        if name in tool.WITHOUT_LINES:
            continue
        path = tmp_path / f"{name}.yaml"
        path.write_text(tool.changed(ball_screw, scene))
        found, base = load_stage(path, judged=False).stage, ball_screw.stage
        meant = scene.change(scene.base(base))
        wanted = dict(fields_of(scene.base(base), meant))
        assert wanted and fields_of(base, found), name
        for place, value in fields_of(base, found):
            if place in wanted and not isinstance(value, str):
                assert np.allclose(value, wanted[place], rtol=1e-6), (name, place)
        played += 1
    assert played == len(scenes()) - len(tool.WITHOUT_LINES) >= 34


def test_the_reference_names_every_entry() -> None:
    """What the schema knows, the reference shows: counted in two ways."""
    from stagectl.config.reference import stage_blocks
    from stagectl.config.schema import stage_schema

    def keys(node: object) -> set[str]:
        if isinstance(node, dict):
            own = set(node.get("properties", {}))
            return own.union(*(keys(one) for one in node.values()), set())
        return set().union(*map(keys, node)) if isinstance(node, list) else set()

    shown = {row.key for block in stage_blocks() for row in block.rows}
    tags = {"law", "kind", "form", "fault"}  # shown with the block's title
    assert keys(stage_schema()) - tags == shown - tags
