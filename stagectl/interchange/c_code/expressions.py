"""Expressions of the kernels in C, each with its type, and what Python's own functions are there."""

import ast
import builtins
import inspect
import math
from collections.abc import Callable
from typing import Any, NamedTuple, get_args

from stagectl.interchange.c_code.types import ARRAY, TranslationError, Types, members, signature, type_of, uniform

MATH = {  # functions of floats that give a float
    math.copysign: "copysign", math.exp: "exp", math.expm1: "expm1", math.log: "log", math.log1p: "log1p",
    math.sin: "sin", math.cos: "cos", math.sqrt: "sqrt", math.pow: "pow",
}  # fmt: skip
WHOLE = {math.floor: "floor", math.ceil: "ceil"}  # of a float; an int in Python
BUILTINS = (*MATH, *WHOLE, float, int, abs, min, max, len)
# As Python and numba choose: the first one unless the other is beyond it.
HELPERS = """static inline double min_double(double a, double b) { return b < a ? b : a; }
static inline double max_double(double a, double b) { return b > a ? b : a; }
static inline int64_t min_int64_t(int64_t a, int64_t b) { return b < a ? b : a; }
static inline int64_t max_int64_t(int64_t a, int64_t b) { return b > a ? b : a; }
"""
ARITHMETIC = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
NOTHING = object()  # what is not known before the kernel runs


class Expression(NamedTuple):
    """An expression in C and its type."""

    code: str
    hint: Any

    def as_(self, hint: Any) -> str:
        """The code where `hint` is wanted; an int may stand for a float."""
        if self.hint == hint:
            return self.code
        if (self.hint, hint) == (int, float):
            return f"(double)({self.code})"
        raise TranslationError(f"{self.code} is of type {self.hint}, where {hint} is wanted")


def numeric(value: Expression) -> Any:
    """The type of a number."""
    if value.hint not in (int, float):
        raise TranslationError(f"{value.code} is of type {value.hint}, where a number is wanted")
    return value.hint


def common(values: list[Expression]) -> Any:
    """The type in which numbers meet."""
    return int if all(numeric(value) is int for value in values) else float


def builtin(called: Any, values: list[Expression]) -> Expression:
    """A call of one of BUILTINS."""
    if called in (min, max):
        return _extreme(called.__name__, values)
    if called in MATH:
        return Expression(f"{MATH[called]}({', '.join(value.as_(float) for value in values)})", float)
    (value,) = values
    if called in WHOLE:
        return Expression(f"(int64_t){WHOLE[called]}({value.as_(float)})", int)
    if called is len:
        return Expression(f"{_array(value)}.length", int)
    if called is abs:
        return Expression(f"{'fabs' if numeric(value) is float else 'llabs'}({value.code})", value.hint)
    return Expression(f"({'double' if called is float else 'int64_t'})({value.code})", called)


def _extreme(name: str, values: list[Expression]) -> Expression:
    hint = common(values)
    kind = "double" if hint is float else "int64_t"
    code = values[0].as_(hint)
    for value in values[1:]:
        code = f"{name}_{kind}({code}, {value.as_(hint)})"
    return Expression(code, hint)


def _array(value: Expression) -> str:
    if value.hint is not Any:
        raise TranslationError(f"len({value.code}): only an array of type {ARRAY} has a length in C")
    return value.code


class Expressions:
    """The expressions of one kernel, whose local variables are `local`.

    `name_of` gives the C name of another kernel, and translates it.
    """

    def __init__(self, types: Types, scope: dict[str, Any], name_of: Callable[[Any], str]) -> None:
        self.types, self.scope, self.name_of = types, scope, name_of
        self.local: dict[str, Any] = {}

    def of(self, node: ast.expr) -> Expression:
        """One expression."""
        known = self.known(node)
        if known is not NOTHING:
            return self.constant(known)
        translate = getattr(self, f"_{type(node).__name__.lower()}", None)
        if translate is None:
            raise TranslationError(f"`{ast.unparse(node)}` has no translation to C")
        found: Expression = translate(node)
        return found

    def constant(self, value: Any) -> Expression:
        """A value that is known before the kernel runs."""
        return Expression(self.types.constant(value, type_of(value)), type_of(value))

    def known(self, node: ast.expr) -> Any:
        """What a name, or a module's or constant's attribute, stands for; NOTHING for what the kernel computes."""
        if isinstance(node, ast.Constant):
            value: Any = node.value
            return value
        if isinstance(node, ast.Name) and node.id not in self.local:
            if node.id not in self.scope and not hasattr(builtins, node.id):
                raise TranslationError(f"`{node.id}` is not known")
            return self.scope.get(node.id, getattr(builtins, node.id, None))
        if isinstance(node, ast.Attribute):
            owner = self.known(node.value)
            return NOTHING if owner is NOTHING else getattr(owner, node.attr)
        return NOTHING

    def condition(self, node: ast.expr) -> str:
        """What is true or false."""
        return self.of(node).as_(bool)

    def _name(self, node: ast.Name) -> Expression:
        return Expression(node.id, self.local[node.id])

    def _attribute(self, node: ast.Attribute) -> Expression:
        owner = self.of(node.value)
        return Expression(f"{owner.code}.{node.attr}", members(owner.hint)[node.attr])

    def _subscript(self, node: ast.Subscript) -> Expression:
        owner = self.of(node.value)
        if owner.hint is Any or uniform(owner.hint):
            part = float if owner.hint is Any else get_args(owner.hint)[0]
            return Expression(f"{owner.code}.at[{self.of(node.slice).as_(int)}]", part)
        if not isinstance(node.slice, ast.Constant):
            raise TranslationError(f"`{ast.unparse(node)}`: a tuple of unequal parts takes a constant index")
        place = f"_{node.slice.value!r}"
        return Expression(f"{owner.code}.{place}", members(owner.hint)[place])

    def _tuple(self, node: ast.Tuple) -> Expression:
        parts = [self.of(part) for part in node.elts]
        return self.tuple_of(parts, tuple[tuple(part.hint for part in parts)])  # type: ignore[misc]

    def tuple_of(self, parts: list[Expression], hint: Any) -> Expression:
        """A tuple or block of this type."""
        wanted = members(hint).values()
        code = ", ".join(part.as_(each) for part, each in zip(parts, wanted, strict=True))
        return Expression(f"({self.types.name(hint)}){{{f'{{{code}}}' if uniform(hint) else code}}}", hint)

    def _unaryop(self, node: ast.UnaryOp) -> Expression:
        if isinstance(node.op, ast.Not):
            return Expression(f"(!{self.condition(node.operand)})", bool)
        if isinstance(node.op, ast.USub):
            operand = self.of(node.operand)
            return Expression(f"(-{operand.code})", numeric(operand))
        raise TranslationError(f"`{ast.unparse(node)}` has no translation to C")

    def _binop(self, node: ast.BinOp) -> Expression:
        left, right = self.of(node.left), self.of(node.right)
        hint = common([left, right])
        if isinstance(node.op, ast.Pow):
            return Expression(f"pow({left.as_(float)}, {right.as_(float)})", float)
        if type(node.op) not in ARITHMETIC:
            raise TranslationError(f"`{ast.unparse(node)}` has no translation to C")
        if isinstance(node.op, ast.Div):
            hint = float
        return Expression(f"({left.as_(hint)} {ARITHMETIC[type(node.op)]} {right.as_(hint)})", hint)

    def _compare(self, node: ast.Compare) -> Expression:
        if len(node.ops) > 1 or type(node.ops[0]) not in COMPARISONS:
            raise TranslationError(f"`{ast.unparse(node)}` has no translation to C")
        left, right = self.of(node.left), self.of(node.comparators[0])
        hint = common([left, right])
        return Expression(f"({left.as_(hint)} {COMPARISONS[type(node.ops[0])]} {right.as_(hint)})", bool)

    def _boolop(self, node: ast.BoolOp) -> Expression:
        sign = " && " if isinstance(node.op, ast.And) else " || "
        return Expression(f"({sign.join(map(self.condition, node.values))})", bool)

    def _ifexp(self, node: ast.IfExp) -> Expression:
        yes, no = self.of(node.body), self.of(node.orelse)
        hint = float if {yes.hint, no.hint} == {int, float} else yes.hint
        return Expression(f"({self.condition(node.test)} ? {yes.as_(hint)} : {no.as_(hint)})", hint)

    def _call(self, node: ast.Call) -> Expression:
        called = self.known(node.func)
        values = [self.of(value) for value in node.args]
        if called in BUILTINS:
            if node.keywords:
                raise TranslationError(f"`{ast.unparse(node)}` has no translation to C")
            return builtin(called, values)
        named = {str(entry.arg): self.of(entry.value) for entry in node.keywords}
        arguments = self._bound(called, values, named)
        if isinstance(called, type):
            return self.tuple_of(arguments, called)
        return self._kernel(called, arguments)

    def _bound(self, called: Any, values: list[Expression], named: dict[str, Expression]) -> list[Expression]:
        """The arguments in order; defaults are constants."""
        if not callable(called):
            raise TranslationError(f"{called!r} cannot be called in C")
        bound = inspect.signature(called).bind(*values, **named)
        bound.apply_defaults()
        return [value if isinstance(value, Expression) else self.constant(value) for value in bound.arguments.values()]

    def _kernel(self, called: Any, arguments: list[Expression]) -> Expression:
        name = self.name_of(called)
        *wanted, result = signature(called)
        code = ", ".join(value.as_(hint) for value, hint in zip(arguments, wanted, strict=True))
        return Expression(f"{name}({code})", result)
