"""model.h: the translated kernels, the plant's parameters, and where each variable of the FMU is.

The standard's functions in fmi3.c know nothing else of the model.
"""

import math
from typing import Any

from stagectl.config.stage_file import Setup
from stagectl.interchange.c_code.translation import Translation
from stagectl.interchange.fmu.variables import Leaf, Variable, leaves, storage
from stagectl.kernels import equilibrium, stage
from stagectl.units import Quantity


def header(setup: Setup, variables: list[Variable]) -> str:
    """The text of model.h."""
    kernels = Translation()
    for kernel in (stage.period, stage.measured, stage.reported, equilibrium.standing):
        kernels.add(kernel)
    each = list(leaves(setup.stage))
    parts = [
        kernels.text(),
        f"#define PERIOD {setup.dt!r} /* s, control period */",
        f"#define SUBSTEPS {setup.file.simulation.substeps} /* integration steps of a period */",
        f"#define OPERATORS {len(setup.stage.friction.operators.weight)}",
        f"#define VARIABLES {len(variables)}",
        _structure(each),
        _pointed(each),
        _started(kernels, each, variables),
        _place("number", "double", float, variables),
        _place("whole", "int64_t", int, variables),
        _admitted(variables),
        _table(variables),
    ]
    return "\n".join(parts)


def _arrays(each: list[Leaf]) -> dict[str, Any]:
    return {leaf.path: leaf.value for leaf in each if not isinstance(leaf.value, int | float)}


def _structure(each: list[Leaf]) -> str:
    """The structure `model`; arrays stand in it, so that a copy of it is a copy of all."""
    arrays = [f"    double {storage(path)}[{len(values)}];" for path, values in _arrays(each).items()]
    return "\n".join([
        "",
        "typedef struct {",
        "    plant_Stage p;",
        "    plant_State x;",
        "    plant_Noise noise;",
        "    int64_t periods; /* since the start */",
        "    double begin, time, command, start_position, session_time, measured, reported;",
        "    double stops[OPERATORS];",
        *arrays,
        "} model;",
        "",
    ])  # fmt: skip


def _pointed(each: list[Leaf]) -> str:
    """What a copy needs: its arrays are its own, and what follows from parameters follows again."""
    lines = [
        f"    m->p.{path} = (array){{m->{storage(path)}, {len(values)}}};" for path, values in _arrays(each).items()
    ]
    slip, rate = storage("friction.operators.slip"), storage("friction.operators.rate")
    return "\n".join([
        "static void model_ready(model *m) {",
        *lines,
        "    m->x.stops = (array){m->stops, OPERATORS};",
        f"    for (int j = 0; j < OPERATORS; j++) m->{rate}[j] = 1.0 / m->{slip}[j];",
        "}",
        "",
    ])  # fmt: skip


def _started(kernels: Translation, each: list[Leaf], variables: list[Variable]) -> str:
    """Start values of all variables, and the constants of the model."""
    lines = [_assigned(kernels, variable.place, variable.start) for variable in variables]
    for leaf in each:
        if leaf.quantity is None and isinstance(leaf.value, int | float):
            lines.append(_assigned(kernels, f"p.{leaf.path}", leaf.value))
        elif leaf.quantity is None:
            places = (f"{storage(leaf.path)}[{number}]" for number in range(len(leaf.value)))
            lines += [_assigned(kernels, *pair) for pair in zip(places, map(float, leaf.value), strict=True)]
    return "\n".join(["static void model_start(model *m) {", *lines, "}", ""])


def _assigned(kernels: Translation, place: str, value: float | int) -> str:
    return f"    m->{place} = {kernels.types.constant(value, type(value))};"


def _place(name: str, kind: str, hint: Any, variables: list[Variable]) -> str:
    """Where the variable of a value reference is; NULL for one of another type."""
    cases = [
        f"    case {reference}: return &m->{variable.place};"
        for reference, variable in enumerate(variables)
        if type(variable.start) is hint
    ]
    return _switch(f"static {kind} *model_{name}(model *m, uint32_t reference)", cases, "0")


def _admitted(variables: list[Variable]) -> str:
    """Whether a variable may have a value."""
    cases = [
        f"    case {reference}: return {_within(variable.quantity)};"
        for reference, variable in enumerate(variables)
        if variable.settable
    ]
    return _switch("static bool model_admits(uint32_t reference, double value)", cases, "false")


def _switch(head: str, cases: list[str], otherwise: str) -> str:
    lines = [f"{head} {{", "    switch (reference) {", *cases, f"    default: return {otherwise};", "    }", "}", ""]
    return "\n".join(lines)


def _within(quantity: Quantity) -> str:
    low, high = quantity.bounds()
    signs = (">" if quantity.interval[0] == "(" else ">=", "<" if quantity.interval[-1] == ")" else "<=")
    ends = [f"value {sign} {end!r}" for sign, end in zip(signs, (low, high), strict=True) if math.isfinite(end)]
    return " && ".join(ends) or "value == value"


def _table(variables: list[Variable]) -> str:
    """Names, when each may be set (2: always, 1: until the motion begins, 0: never), and the admissible range."""
    rows = [
        f'    {{"{variable.name}", {variable.settable}, "{variable.quantity.interval}"}},' for variable in variables
    ]
    head = "static const struct { const char *name; int settable; const char *range; } TABLE[VARIABLES] = {"
    return "\n".join([head, *rows, "};", ""])
