"""How an effect is told."""

from __future__ import annotations

from typing import NamedTuple


class Told(NamedTuple):
    """One effect, for a person who has not met it."""

    name: str  # as the diagnosis and the stage file's patch know it
    what: str
    size: str
    rivals: str
    apart: str


class Group(NamedTuple):
    """Effects of one place in the loop."""

    title: str
    words: str
    effects: tuple[Told, ...]
