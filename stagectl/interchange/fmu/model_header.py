"""model.h: the translated kernels, the plant's parameters, and where each variable of the FMU is.

The standard's functions in fmi3.c know nothing else of the model.  Its text is model.h.jinja.
"""

import math
from collections.abc import Iterator

from stagectl.config.stage_file import Setup
from stagectl.interchange.c_code.translation import Translation
from stagectl.interchange.fmu.templates import TEMPLATES
from stagectl.interchange.fmu.variables import Leaf, Variable, leaves
from stagectl.kernels import equilibrium, stage
from stagectl.units import Quantity


def header(setup: Setup, variables: list[Variable]) -> str:
    """The text of model.h."""
    kernels = Translation()
    for kernel in (stage.period, stage.measured, stage.reported, equilibrium.standing):
        kernels.add(kernel)
    each = list(leaves(setup.stage))
    starts = [*((variable.place, variable.start) for variable in variables), *_constants(each)]
    return TEMPLATES.get_template("model.h.jinja").render(
        kernels=kernels.text(),
        period=repr(setup.dt),
        substeps=setup.file.simulation.substeps,
        operators=len(setup.stage.friction.operators.weight),
        variables=variables,
        within=_within,
        references={variable: reference for reference, variable in enumerate(variables)},
        arrays=[leaf for leaf in each if not isinstance(leaf.value, int | float)],
        starts=[(place, kernels.types.constant(value, type(value))) for place, value in starts],
    )


def _constants(each: list[Leaf]) -> Iterator[tuple[str, float]]:
    """Place and value of what no variable sets."""
    for leaf in each:
        if leaf.quantity is None and isinstance(leaf.value, int | float):
            yield f"p.{leaf.path}", leaf.value
        elif leaf.quantity is None:
            yield from ((f"{leaf.storage}[{number}]", float(value)) for number, value in enumerate(leaf.value))


def _within(quantity: Quantity) -> str:
    """The condition in C under which `value` is admissible."""
    low, high = quantity.bounds()
    signs = (">" if quantity.interval[0] == "(" else ">=", "<" if quantity.interval[-1] == ")" else "<=")
    ends = [f"value {sign} {end!r}" for sign, end in zip(signs, (low, high), strict=True) if math.isfinite(end)]
    return " && ".join(ends) or "value == value"
