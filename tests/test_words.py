"""No page, help text or README uses a retired word; the glossary lists them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer

from stagectl.cli.app import application
from tests.conftest import ROOT
from tests.printed import tool

GLOSSARY = ROOT / "docs" / "glossary.md"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def retired() -> re.Pattern[str]:
    """The left column of the glossary's last table as one pattern."""
    rows = re.findall(r"^\| (.+?) \| .+ \|$", _parts()[1], re.MULTILINE)[1:]
    words = [word for row in rows for word in row.split(", ")]
    assert len(words) > 30
    return re.compile(r"(?<![\w-])(" + "|".join(map(re.escape, words)) + r")(?![\w-])", re.IGNORECASE)


def _parts() -> list[str]:
    return GLOSSARY.read_text(encoding="utf-8").split("## Words that no page uses")


def prose(text: str) -> str:
    """`text` without code blocks and code spans."""
    return re.sub(r"```.*?```|`[^`\n]+`", " ", text, flags=re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages(page: object) -> None:
    text = _parts()[0] if page == GLOSSARY else str(page.read_text(encoding="utf-8"))  # type: ignore[attr-defined]
    assert sorted(set(retired().findall(prose(text)))) == []


def test_generated_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "tools" / "manual")
    pages: dict[str, str] = {}
    for made in (tool("reference"), tool("commands"), tool("api"), tool("presets")):
        pages |= made.pages()
    pages |= tool("effects").pages(ROOT)
    assert len(pages) >= 12
    assert {name: words for name, text in pages.items() if (words := retired().findall(prose(text)))} == {}


def _helps(command: Any, name: str) -> Iterator[tuple[str, str]]:
    yield name, command.help or ""
    for option in command.params:
        yield f"{name} {option.name}", getattr(option, "help", None) or ""
    for part in getattr(command, "commands", {}).values():
        yield from _helps(part, f"{name} {part.name}")


def test_help() -> None:
    retired_words = {
        where: words
        for where, text in _helps(typer.main.get_command(application()), "stagectl")
        if (words := retired().findall(text))
    }
    assert retired_words == {}
