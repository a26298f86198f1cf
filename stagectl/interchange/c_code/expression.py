"""One expression in C, and what Python's own functions are there."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from stagectl.interchange.c_code.types import ARRAY, TranslationError

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
