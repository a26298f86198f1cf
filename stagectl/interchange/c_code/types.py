"""Kernels as the translator reads them, and their types in C: numbers, blocks, tuples, arrays that the caller owns.

A type is what the kernel's annotation says: a block is a NamedTuple, and `Any` is an array of floats.
"""

import ast
import inspect
import math
import textwrap
from typing import Any, get_args, get_type_hints

from stagectl.units import StageError

PACKAGE = "stagectl.kernels"
SCALARS = {float: "double", int: "int64_t", bool: "bool"}
ARRAY = "array"  # of doubles
PRELUDE = f"""#include <math.h>
#include <stdbool.h>
#include <stdint.h>

typedef struct {{ double *at; int64_t length; }} {ARRAY};
"""


class TranslationError(StageError):
    """Something in a kernel that has no translation to C."""


def function_of(kernel: Any) -> Any:
    """The Python function of a kernel, whether compiled, not yet compiled or interpreted.

    Raises TranslationError for anything else.
    """
    function = getattr(kernel, "py_func", getattr(kernel, "__wrapped__", kernel))
    if not inspect.isfunction(function) or not function.__module__.startswith(PACKAGE):
        raise TranslationError(f"{kernel!r} is not a function of {PACKAGE}")
    return function


def c_name(kernel: Any) -> str:
    """Its name in C: module and function."""
    function = function_of(kernel)
    return f"{function.__module__.rsplit('.', 1)[-1]}_{function.__name__}"


def parameters(kernel: Any) -> dict[str, Any]:
    """Types of its parameters, by their names."""
    function = function_of(kernel)
    hints = get_type_hints(function)
    missing = [name for name in inspect.signature(function).parameters if name not in hints]
    if missing or "return" not in hints:
        raise TranslationError(f"{c_name(kernel)} has no type for {', '.join(missing) or 'its result'}")
    return {name: hints[name] for name in inspect.signature(function).parameters}


def signature(kernel: Any) -> tuple[Any, ...]:
    """Types of its parameters, and of its result."""
    return (*parameters(kernel).values(), get_type_hints(function_of(kernel))["return"])


def definition(kernel: Any) -> ast.FunctionDef:
    """Its source, parsed."""
    (parsed,) = ast.parse(textwrap.dedent(inspect.getsource(function_of(kernel)))).body
    assert isinstance(parsed, ast.FunctionDef)
    return parsed


def members(hint: Any) -> dict[str, Any]:
    """Fields of a block, and the parts ``_0``, ``_1``, ... of a tuple, with their types."""
    if isinstance(hint, type) and hasattr(hint, "_fields"):
        hints = get_type_hints(hint)
        return {name: hints[name] for name in hint._fields}
    parts = get_args(hint)
    if not parts or ... in parts:
        raise TranslationError(f"the type {hint} has no translation to C")
    return {f"_{number}": part for number, part in enumerate(parts)}


def uniform(hint: Any) -> bool:
    """Whether this is a tuple of equal parts, which may be indexed by a variable."""
    parts = get_args(hint)
    return len(parts) > 0 and all(part == parts[0] for part in parts)


class Types:
    """Names of the types that are used; `definitions` are those of their structures, each after what it needs."""

    def __init__(self) -> None:
        self.definitions: dict[str, str] = {}

    def name(self, hint: Any) -> str:
        """The type's name in C."""
        if hint is Any:
            return ARRAY
        if hint in SCALARS:
            return SCALARS[hint]
        if hint is type(None):
            return "void"
        parts = {field: self.name(part) for field, part in members(hint).items()}
        name = "_".join(["tuple", *parts.values()])
        if isinstance(hint, type) and hasattr(hint, "_fields"):
            name = f"{hint.__module__.rsplit('.', 1)[-1]}_{hint.__name__}"
        elif uniform(hint):
            name = f"tuple{len(parts)}_{parts['_0']}"
            parts = {f"at[{len(parts)}]": parts["_0"]}
        lines = [f"    {kind} {field};" for field, kind in parts.items()]
        self.definitions.setdefault(name, "\n".join(["typedef struct {", *lines, f"}} {name};"]))
        return name

    def constant(self, value: Any, hint: Any) -> str:
        """A value of this type, as an expression."""
        if hint in SCALARS:
            return _number(value, hint)
        if hint is Any:
            raise TranslationError("an array as a constant has no translation to C")
        parts = ", ".join(self.constant(*part) for part in zip(value, members(hint).values(), strict=True))
        return f"({self.name(hint)}){{{f'{{{parts}}}' if uniform(hint) else parts}}}"


def type_of(value: Any) -> Any:
    """The type of a constant: a number, a block or a tuple of such."""
    if type(value) in SCALARS or hasattr(value, "_fields"):
        return type(value)
    if isinstance(value, tuple):
        return tuple[tuple(type_of(part) for part in value)]  # type: ignore[misc]
    raise TranslationError(f"a constant of type {type(value).__name__} has no translation to C")


def _number(value: Any, hint: Any) -> str:
    if hint is bool:
        return "true" if value else "false"
    if hint is int:
        return f"INT64_C({value})"
    number = float(value)
    if math.isfinite(number):
        return repr(number)
    return "NAN" if math.isnan(number) else ("INFINITY" if number > 0.0 else "-INFINITY")
