"""Kernels and all that they call, as one piece of C."""

from __future__ import annotations

from typing import Any

from stagectl.interchange.c_code import kernel as read
from stagectl.interchange.c_code.expression import HELPERS
from stagectl.interchange.c_code.expressions import Expressions
from stagectl.interchange.c_code.statements import INDENT, RESERVED, Statements
from stagectl.interchange.c_code.types import PRELUDE, TranslationError, Types


class Translation:
    """What has been translated so far: structures, and functions after those that they call.

    The C gives the bits of the compiled kernels where the compiler keeps to IEEE 754: no contraction of a product and
    a sum, no fast mathematics.
    """

    def __init__(self) -> None:
        self.types = Types()
        self._functions: dict[str, str] = {}
        self._open: list[str] = []

    def add(self, kernel: Any) -> str:
        """The C name of a kernel, translated with what it calls.

        Raises TranslationError, which names the kernel, for what has no translation.
        """
        name = read.c_name(kernel)
        if name in self._open:
            raise TranslationError(f"{name} calls itself, which has no translation to C")
        if name not in self._functions:
            self._open.append(name)
            self._functions[name] = self._translated(kernel, name)
            self._open.pop()
        return name

    def text(self) -> str:
        """All of it."""
        return "\n".join([PRELUDE, *self.types.definitions.values(), "", HELPERS, *self._functions.values()])

    def _translated(self, kernel: Any, name: str) -> str:
        function = read.function_of(kernel)
        expressions = Expressions(self.types, function.__globals__, self.add)
        expressions.local.update(read.parameters(kernel))
        body = Statements(expressions, read.signature(kernel)[-1])
        try:
            body.block(read.definition(kernel).body)
            return "\n".join([*self._head(kernel, name), *self._variables(kernel, expressions), *body.lines, "}", ""])
        except TranslationError as error:
            if error.args and str(error.args[0]).startswith(read.PACKAGE):
                raise
            raise TranslationError(f"{function.__module__}.{function.__name__}: {error}") from error

    def _head(self, kernel: Any, name: str) -> list[str]:
        function, given = read.function_of(kernel), read.parameters(kernel)
        if RESERVED & set(given):
            raise TranslationError(f"the parameter `{min(RESERVED & set(given))}` has a name that C reserves")
        words = (function.__doc__ or "").split("\n")[0].replace("*/", "* /")
        listed = ", ".join(f"{self.types.name(hint)} {parameter}" for parameter, hint in given.items())
        result = self.types.name(read.signature(kernel)[-1])
        return [f"/* {function.__module__}: {words} */", f"static {result} {name}({listed}) {{"]

    def _variables(self, kernel: Any, expressions: Expressions) -> list[str]:
        given = read.parameters(kernel)
        return [
            f"{INDENT}{self.types.name(hint)} {name};" for name, hint in expressions.local.items() if name not in given
        ]
