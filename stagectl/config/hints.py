"""Reads the type hints of fields, which are the whole schema of configuration files."""

import types
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from stagectl.units import Tagged, quantity_of


def plain(hint: Any) -> Any:
    """The type without its annotations."""
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def extras_of(hint: Any) -> tuple[Any, ...]:
    """The annotations next to the type."""
    return get_args(hint)[1:] if get_origin(hint) is Annotated else ()


def is_union(kind: Any) -> bool:
    """Whether a plain type is a union, such as one with None."""
    return get_origin(kind) in (Union, types.UnionType)


def without_none(hint: Any) -> Any:
    """The plain type; of a union the first one that is not None."""
    kind = plain(hint)
    return plain(next(part for part in get_args(kind) if part is not type(None))) if is_union(kind) else kind


def tag_of(hint: Any) -> Tagged | None:
    """How the blocks of a tagged union are distinguished; None where `hint` is none."""
    return next((extra for extra in extras_of(hint) if isinstance(extra, Tagged)), None)


def meaning_of(hint: Any) -> str:
    """The meaning of a field that has no `Quantity`; empty where none is annotated."""
    return next((extra for extra in extras_of(hint) if isinstance(extra, str)), "")


def fields_of(hint: Any) -> dict[str, Any]:
    """Hints of a block's fields; a `Quantity` next to the block itself is that of its first field.

    So a harmonic of an effort and one of a position are the same block, with different units.
    """
    kind, quantity = plain(hint), quantity_of(hint)
    hints = get_type_hints(kind, include_extras=True)
    if quantity is not None:
        first = kind._fields[0]
        hints[first] = Annotated[plain(hints[first]), quantity]
    return hints
