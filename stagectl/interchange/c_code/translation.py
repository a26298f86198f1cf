"""Kernels and all that they call, as one piece of C: their functions, statement by statement."""

import ast
from typing import Any, get_args

from stagectl.interchange.c_code import types as read
from stagectl.interchange.c_code.expressions import HELPERS, Expression, Expressions
from stagectl.interchange.c_code.types import PRELUDE, TranslationError, Types, members, uniform

# A variable of such a name would not compile; those of C alone, as the others are Python's, too.
_RESERVED = frozenset(
    {"auto", "case", "char", "const", "default", "do", "double", "enum", "extern", "goto", "inline", "long", "register"}
    | {"restrict", "short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void"}
    | {"volatile"}
)
_INDENT = "    "


class Statements:
    """The body of one kernel: lines of C, and the variables that they need."""

    def __init__(self, expressions: Expressions, result: Any) -> None:
        self.expressions, self.result = expressions, result
        self.lines: list[str] = []
        self.depth, self.temporaries = 1, 0

    def block(self, body: list[ast.stmt]) -> None:
        """A sequence of statements."""
        for node in body:
            translate = getattr(self, f"_{type(node).__name__.lower()}", None)
            if translate is None:
                raise TranslationError(f"`{ast.unparse(node).splitlines()[0]}` has no translation to C")
            translate(node)

    def _line(self, text: str) -> None:
        self.lines.append(_INDENT * self.depth + text)

    def _nested(self, head: str, body: list[ast.stmt]) -> None:
        self._line(f"{head} {{")
        self.depth += 1
        self.block(body)
        self.depth -= 1
        self._line("}")

    def _expr(self, node: ast.Expr) -> None:
        if not (isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)):  # a docstring
            self._line(f"{self.expressions.of(node.value).code};")

    def _return(self, node: ast.Return) -> None:
        if node.value is None:
            return self._line("return;")
        self._line(f"return {self.expressions.of(node.value).as_(self.result)};")

    def _if(self, node: ast.If) -> None:
        self._nested(f"if ({self.expressions.condition(node.test)})", node.body)
        if node.orelse:
            self._nested("else", node.orelse)

    def _while(self, node: ast.While) -> None:
        if node.orelse:
            raise TranslationError("`else` of a loop has no translation to C")
        self._nested(f"while ({self.expressions.condition(node.test)})", node.body)

    def _for(self, node: ast.For) -> None:
        called = node.iter.func if isinstance(node.iter, ast.Call) else node.iter
        if node.orelse or self.expressions.known(called) is not range or not isinstance(node.target, ast.Name):
            raise TranslationError(f"`for ... in {ast.unparse(node.iter)}`: only a range can be looped over in C")
        assert isinstance(node.iter, ast.Call)
        *start, stop = (self._kept(self.expressions.of(value)) for value in node.iter.args)
        counter = self._temporary(int)
        first = start[0].as_(int) if start else "0"
        self._line(f"for ({counter} = {first}; {counter} < {stop.as_(int)}; {counter}++) {{")
        self.depth += 1
        self._store(node.target, Expression(counter, int))
        self.block(node.body)
        self.depth -= 1
        self._line("}")

    def _break(self, node: ast.Break) -> None:
        self._line("break;")

    def _annassign(self, node: ast.AnnAssign) -> None:
        if node.value is None:
            raise TranslationError(f"`{ast.unparse(node)}` has no translation to C")
        self._store(node.target, self.expressions.of(node.value))

    def _augassign(self, node: ast.AugAssign) -> None:
        value = ast.BinOp(ast.parse(ast.unparse(node.target), mode="eval").body, node.op, node.value)
        self._store(node.target, self.expressions.of(value))

    def _assign(self, node: ast.Assign) -> None:
        if len(node.targets) > 1:
            raise TranslationError(f"`{ast.unparse(node)}` has no translation to C")
        target = node.targets[0]
        if not isinstance(target, ast.Tuple):
            return self._store(target, self.expressions.of(node.value))
        if isinstance(node.value, ast.Tuple):
            parts = [self._kept(self.expressions.of(part)) for part in node.value.elts]
        else:
            parts = _parts(self._kept(self.expressions.of(node.value)))
        for each, part in zip(target.elts, parts, strict=True):
            self._store(each, part)

    def _store(self, target: ast.expr, value: Expression) -> None:
        if isinstance(target, ast.Subscript):
            place = self.expressions.of(target)
            return self._line(f"{place.code} = {value.as_(place.hint)};")
        if not isinstance(target, ast.Name):
            raise TranslationError(f"`{ast.unparse(target)} = ...` has no translation to C")
        if target.id != "_":
            name = self._target(target, value.hint)
            self._line(f"{name} = {value.as_(self.expressions.local[target.id])};")

    def _target(self, target: ast.Name, hint: Any) -> str:
        if target.id in _RESERVED:
            raise TranslationError(f"the variable `{target.id}` has a name that C reserves")
        self.expressions.local.setdefault(target.id, hint)
        return target.id

    def _kept(self, value: Expression) -> Expression:
        """A value that later assignments do not change."""
        name = self._temporary(value.hint)
        self._line(f"{name} = {value.code};")
        return Expression(name, value.hint)

    def _temporary(self, hint: Any) -> str:
        self.temporaries += 1
        name = f"kept{self.temporaries}_"
        self.expressions.local[name] = hint
        return name


def _parts(value: Expression) -> list[Expression]:
    """The parts of a tuple or block."""
    if uniform(value.hint):
        return [Expression(f"{value.code}.at[{k}]", part) for k, part in enumerate(get_args(value.hint))]
    return [Expression(f"{value.code}.{field}", part) for field, part in members(value.hint).items()]


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
            variables = [f"{_INDENT}{self.types.name(hint)} {local};" for local, hint in own]
            return "\n".join([*head, *variables, *body.lines, "}", ""])
        except TranslationError as error:
            if error.args and str(error.args[0]).startswith(read.PACKAGE):
                raise
            raise TranslationError(f"{function.__module__}.{function.__name__}: {error}") from error

    def _head(self, function: Any, declared: str, given: dict[str, Any]) -> list[str]:
        if _RESERVED & set(given):
            raise TranslationError(f"the parameter `{min(_RESERVED & set(given))}` has a name that C reserves")
        words = (function.__doc__ or "").split("\n")[0].replace("*/", "* /")
        listed = ", ".join(f"{self.types.name(hint)} {parameter}" for parameter, hint in given.items())
        return [f"/* {function.__module__}: {words} */", f"{declared}({listed}) {{"]
