"""Arguments against the types that a function declares: a slip ends at the call, with the argument's name."""

import contextlib
import functools
import inspect
import numbers
import os
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from types import UnionType
from typing import Annotated, Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin

from stagectl.api.arguments import ArgumentError
from stagectl.problem import meant
from stagectl.units import quantity_of

_SHORT = 40  # characters of a value that a message repeats
P = ParamSpec("P")
R = TypeVar("R")

# What a person calls a value of each type, and the types that it may have: numpy's numbers are numbers, True is none.
_PLAIN: dict[Any, tuple[str, Any]] = {
    type(None): ("", type(None)),
    bool: ("True or False", bool),
    int: ("a whole number", numbers.Integral),
    float: ("a number", numbers.Real),
    str: ("text", str),
    os.PathLike: ("a path", os.PathLike),
    Mapping: ("a dict", Mapping),
    Sequence: ("a list", Sequence),
    Iterable: ("a list", Iterable),
    tuple: ("a tuple", tuple),
    Callable: ("a function", Callable),
}


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """`function`, which first holds its arguments against its annotations.

    Raises ArgumentError for one of another type or beyond the interval of its `Quantity`, and for an unknown name.
    """

    @functools.cache
    def declared() -> tuple[inspect.Signature, dict[str, Any]]:
        hints, known = inspect.get_annotations(function), function.__globals__
        hints.pop("return", None)  # may be known to a type checker alone
        read = {name: eval(hint, known) if isinstance(hint, str) else hint for name, hint in hints.items()}
        return inspect.signature(function), read

    @functools.wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        signature, hints = declared()
        _known(function.__name__, signature, kwargs)
        _few_enough(function.__name__, signature, hints, args)
        with contextlib.suppress(TypeError):  # too few, or one twice: Python says so itself
            for name, value in signature.bind(*args, **kwargs).arguments.items():
                _suits(name, value, hints, signature.parameters[name].kind)
        return function(*args, **kwargs)

    return called


def _known(function: str, signature: inspect.Signature, given: Mapping[str, Any]) -> None:
    kinds = {parameter.kind for parameter in signature.parameters.values()}
    names = [name for name in signature.parameters if name != "self"]
    for name in given if inspect.Parameter.VAR_KEYWORD not in kinds else ():
        if name not in names:
            raise ArgumentError(name, "", f"is no argument of {function}: {meant(name, names, 'it takes')}")


def _few_enough(function: str, signature: inspect.Signature, hints: Mapping[str, Any], given: Sequence[Any]) -> None:
    """Of more arguments than may stand in a row, the first in a wrong place is named, and where it belongs."""
    kinds = {parameter.kind for parameter in signature.parameters.values()}
    by_name = [name for name, one in signature.parameters.items() if one.kind is inspect.Parameter.KEYWORD_ONLY]
    in_a_row = [name for name in signature.parameters if name not in by_name]
    if inspect.Parameter.VAR_POSITIONAL in kinds or len(given) <= len(in_a_row):
        return
    for name, value in zip(in_a_row, given, strict=False):
        _suits(name, value, hints, signature.parameters[name].kind)
    value, first = given[len(in_a_row)], ", ".join(name for name in in_a_row if name != "self") or "none"
    place = _exchanged(value, hints) or f": give it by its name, one of {', '.join(by_name)}" if by_name else ""
    raise ArgumentError(function, "", f"takes {first} in a row, and no further one, {_shown(value)}{place}")


def _suits(name: str, value: Any, hints: Mapping[str, Any], kind: Any) -> None:
    hint = hints.get(name, Any)
    several = kind is inspect.Parameter.VAR_POSITIONAL
    alone = ", each by itself" if several else ""
    for one in value if several else [value]:
        if kind is not inspect.Parameter.VAR_KEYWORD and not fits(one, hint):
            raise ArgumentError(
                name, _shown(one), f"; must be {' or '.join(words(hint))}{alone}{_exchanged(one, hints)}"
            )
        declared = quantity_of(hint)
        if declared and one is not None and not declared.admits(one):
            raise ArgumentError(name, one, f"; must lie in {declared.interval} {declared.unit}".rstrip())


def _exchanged(value: Any, hints: Mapping[str, Any]) -> str:
    """What to do with one of our own results in the place of another argument."""
    ours = hasattr(type(value), "made_by")
    return next((f": give it as `{name}`" for name, hint in hints.items() if ours and fits(value, hint)), "")


def fits(value: Any, hint: Any) -> bool:
    """Whether `value` is of the type that `hint` declares; a text is no list of its letters."""
    kind, inside = get_origin(hint) or hint, get_args(hint)
    if kind is Annotated:
        return fits(value, inside[0])
    if kind in (Union, UnionType):
        return any(fits(value, part) for part in inside)
    if kind is Literal:
        return isinstance(value, str) and value in inside
    if kind is Any:
        return True
    if not isinstance(value, _PLAIN.get(kind, ("", kind))[1]) or (isinstance(value, bool) and kind is not bool):
        return False
    return _holds(value, kind, inside)


def _holds(value: Any, kind: Any, inside: tuple[Any, ...]) -> bool:
    """Whether the members of a container are of the types that it declares."""
    if kind is Mapping:
        return all(fits(key, inside[0]) and fits(entry, inside[1]) for key, entry in value.items())
    if kind is tuple:
        return len(value) == len(inside)  # of arrays, which numpy judges
    if kind in (Sequence, Iterable):
        members = value if isinstance(value, Sequence | Set) else ()  # what can be read once is left unread
        return not isinstance(value, str | bytes) and all(fits(entry, inside[0]) for entry in members)
    return True


def words(hint: Any) -> list[str]:
    """What an argument may be, in words, each once."""
    kind, inside = get_origin(hint) or hint, get_args(hint)
    if kind is Annotated:
        return words(inside[0])
    if kind is Literal:
        return [f"one of {', '.join(inside)}"]
    if kind is Mapping and inside[1] is str:
        return ["a dict of text"]
    if kind in (Union, UnionType):
        return _choices(inside)
    if kind in (Sequence, Iterable):
        return [f"a list of {' or '.join(words(inside[0]))}"]
    if kind is tuple:
        return ["a tuple (time, position)"]
    return [word for word in [_PLAIN[kind][0] if kind in _PLAIN else f"what {kind.made_by} returned"] if word]


def _choices(parts: Sequence[Any]) -> list[str]:
    """A text beside a path is the path's, beside a number it has the number's unit."""
    plain = [get_origin(part) or part for part in parts]
    if os.PathLike in plain:
        parts = [part for part in parts if part is not str]
    several = [part for part in parts if get_origin(part) is Sequence]
    each = list(dict.fromkeys(word for part in parts if part not in several for word in words(part)))
    if float in plain and str in plain:
        each = [word for word in each if word not in ("a number", "text")] + ["a number in SI", "text with its unit"]
    return each + (["a list of them"] if several else [])


def _shown(value: Any) -> str:
    """A value of the wrong type: a short one as it is written."""
    count = f" of {len(value)} entries" if isinstance(value, tuple) else ""
    text, kind = repr(value), f"of type {type(value).__name__}{count}"
    short = value is not None and len(text) <= _SHORT and "\n" not in text
    return f"= {text} {kind}" if short else kind
