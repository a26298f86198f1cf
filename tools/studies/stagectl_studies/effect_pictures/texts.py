"""The manual's text on each effect, as `texts.toml` has it."""

import tomllib
from pathlib import Path
from typing import Any, NamedTuple


class EffectText(NamedTuple):
    """One effect in words."""

    name: str  # in the library
    what: str
    size: str  # typical
    mistaken_for: str
    separated_by: str
    lines: str = ""  # why a stage file has no lines for it


class Chapter(NamedTuple):
    """Effects on one page of the manual."""

    file: str  # of the page, without its ending
    title: str
    text: str
    effects: tuple[EffectText, ...]


def chapters() -> tuple[Chapter, ...]:
    """All of them, in their order."""
    tables = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return tuple(_chapter(file, table) for file, table in tables.items())


def _chapter(file: str, table: dict[str, Any]) -> Chapter:
    effects = (EffectText(name, **entries) for name, entries in table.items() if isinstance(entries, dict))
    return Chapter(file, table["title"], table["text"], tuple(effects))
