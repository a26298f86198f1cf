"""NamedTuples to values that `json` writes, and back, by the types of their fields.

::

    NamedTuple                   object
    tuple[tuple[str, T], ...]    object
    dict[str, T]                 object
    tuple[T, ...], array         array
    float                        number; NaN and infinity are null, and null is NaN when it comes back
    str, bool, None              themselves
"""

import functools
import math
import types
from collections.abc import Mapping
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from stagectl.problem import below

_UNIONS = (Union, types.UnionType)


class TypedJsonError(ValueError):
    """A JSON `value` at the dotted `place` is not of the `expected` kind."""

    def __init__(self, place: str, value: Any, expected: str) -> None:
        super().__init__(f"{place or 'the file'} = {value!r:.60}; must be {expected}")
        self.place, self.value, self.expected = place, value, expected


def encoded(value: Any, hint: Any) -> Any:
    """A `value` of type `hint` as `json` writes it."""
    hint = _chosen(hint, value)
    if value is None or hint is None:
        return None
    if _is_record(hint):
        return {name: encoded(part, kind) for (name, kind), part in zip(_fields(hint).items(), value, strict=True)}
    if (kind := _named_values(hint)) is not None:
        return {name: encoded(part, kind) for name, part in dict(value).items()}
    if get_origin(hint) is tuple:
        return [encoded(part, kind) for part, kind in zip(value, _kinds(hint, len(value)), strict=True)]
    if get_origin(hint) is np.ndarray:
        return [finite(part) for part in value]
    return finite(value) if hint is float else value


def decoded(data: Any, hint: Any, place: str = "") -> Any:
    """The value of type `hint` that `encoded` turned into `data`; raises TypedJsonError."""
    hint = _chosen(hint, data)
    if hint is None:
        return None
    if _is_record(hint):
        return _record(data, hint, place)
    if (kind := _named_values(hint)) is not None:
        entries = {name: decoded(part, kind, below(place, name)) for name, part in _as(dict, data, place).items()}
        return tuple(entries.items()) if get_origin(hint) is tuple else entries
    if get_origin(hint) is tuple:
        parts = _as(list, data, place)
        kinds = enumerate(zip(parts, _kinds(hint, len(parts)), strict=True))
        return tuple(decoded(part, kind, f"{place}[{k}]") for k, (part, kind) in kinds)
    if get_origin(hint) is np.ndarray:
        return np.array([decoded(part, float, place) for part in _as(list, data, place)])
    return _float(data, place) if hint is float else _as(hint, data, place)


def _record(data: Any, hint: Any, place: str) -> Any:
    fields, given = _fields(hint), _as(dict, data, place)
    missing = [name for name in fields if name not in given and name not in hint._field_defaults]
    unknown = [name for name in given if name not in fields]
    for name in (*missing, *unknown):
        expected = f"an entry of {hint.__name__}" if name in missing else f"one of {', '.join(fields)}"
        raise TypedJsonError(below(place, name), given.get(name), expected)
    return hint(**{name: decoded(part, fields[name], below(place, name)) for name, part in given.items()})


def _is_record(hint: Any) -> bool:
    return isinstance(hint, type) and hasattr(hint, "_field_defaults")


def _named_values(hint: Any) -> Any:
    """The type of the values in a dict, or in a tuple of names with values; None of anything else."""
    args = get_args(hint)
    if get_origin(hint) is dict:
        return args[1]
    pair = get_args(args[0]) if get_origin(hint) is tuple and len(args) == 2 and args[1] is Ellipsis else ()
    return pair[1] if len(pair) == 2 and pair[0] is str and pair[1] is not Ellipsis else None


def _kinds(hint: Any, count: int) -> list[Any]:
    args = get_args(hint)
    return [args[0]] * count if len(args) == 2 and args[1] is Ellipsis else list(args)


@functools.cache
def _fields(record: Any) -> Mapping[str, Any]:
    hints = get_type_hints(record)
    return {name: hints[name] for name in record._fields}


def _chosen(hint: Any, value: Any) -> Any:
    """The member of a union that `value` is of; None where it is None and the union allows that."""
    if get_origin(hint) not in _UNIONS:
        return hint
    members = get_args(hint)
    if value is None and type(None) in members:
        return None
    rest = [member for member in members if member is not type(None)]
    if len(rest) == 1:
        return rest[0]
    kind = tuple if isinstance(value, (list, tuple)) else str if isinstance(value, str) else float
    return next((member for member in rest if (get_origin(member) or member) is kind), rest[0])


_KINDS = {"dict": "an object", "list": "an array", "str": "a text"}


def _as(kind: type, data: Any, place: str) -> Any:
    if not isinstance(data, kind):
        raise TypedJsonError(place, data, _KINDS.get(kind.__name__, kind.__name__))
    return data


def _float(data: Any, place: str) -> float:
    if data is None:
        return math.nan
    if isinstance(data, bool) or not isinstance(data, (int, float)):
        raise TypedJsonError(place, data, "a number or null")
    return float(data)


def plain(value: Any) -> Any:
    """A value of any kind as `json` writes it: records by their fields; NaN and infinity are null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finite(value: float | None) -> float | None:
    """The number as JSON can hold it: infinity and NaN are None."""
    return float(value) if value is not None and math.isfinite(value) else None
