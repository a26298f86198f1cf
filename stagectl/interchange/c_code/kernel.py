"""A kernel as the translator reads it: its source, its types, and what its names stand for."""

from __future__ import annotations

import ast
import inspect
import textwrap
from typing import Any, get_type_hints

from stagectl.interchange.c_code.types import TranslationError

PACKAGE = "stagectl.kernels"


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
