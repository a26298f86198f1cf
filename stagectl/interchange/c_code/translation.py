"""Kernels and all that they call, as one piece of C."""

from typing import Any

from stagectl.interchange.c_code import types as read
from stagectl.interchange.c_code.expressions import HELPERS, Expressions
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
        function, given, result = read.function_of(kernel), read.parameters(kernel), read.signature(kernel)[-1]
        expressions = Expressions(self.types, function.__globals__, self.add)
        expressions.local.update(given)
        body = Statements(expressions, result)
        try:
            body.block(read.definition(kernel).body)
            head = self._head(function, f"static {self.types.name(result)} {name}", given)
            own = [(local, hint) for local, hint in expressions.local.items() if local not in given]
            variables = [f"{INDENT}{self.types.name(hint)} {local};" for local, hint in own]
            return "\n".join([*head, *variables, *body.lines, "}", ""])
        except TranslationError as error:
            if error.args and str(error.args[0]).startswith(read.PACKAGE):
                raise
            raise TranslationError(f"{function.__module__}.{function.__name__}: {error}") from error

    def _head(self, function: Any, declared: str, given: dict[str, Any]) -> list[str]:
        if RESERVED & set(given):
            raise TranslationError(f"the parameter `{min(RESERVED & set(given))}` has a name that C reserves")
        words = (function.__doc__ or "").split("\n")[0].replace("*/", "* /")
        listed = ", ".join(f"{self.types.name(hint)} {parameter}" for parameter, hint in given.items())
        return [f"/* {function.__module__}: {words} */", f"{declared}({listed}) {{"]
