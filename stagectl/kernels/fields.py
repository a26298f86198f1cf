"""A field of nested parameters by its dotted place: ``mechanics.cable.slip``."""

from __future__ import annotations

from typing import Any, TypeVar

Block = TypeVar("Block")  # a NamedTuple of parameters


def put(p: Block, place: str, value: Any) -> Block:
    """`p` with the field at the dotted `place` replaced."""
    name, _, rest = place.partition(".")
    block: Any = p
    changed: Block = block._replace(**{name: put(getattr(p, name), rest, value) if rest else value})
    return changed


def get(p: Any, place: str) -> Any:
    """The field of `p` at the dotted `place`."""
    for name in place.split("."):
        p = getattr(p, name)
    return p
