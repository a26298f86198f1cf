"""The texts of the FMU, each from its template: what its variables are, how its source is built, and model.h.

The last has the translated kernels, the plant's parameters, and where each variable is.  The standard's functions in
fmi3.c know nothing else of the model.
Source: Functional Mock-up Interface 3.0.2, chapters 2.4 and 2.5.
"""

import math
from collections.abc import Iterator
from pathlib import Path

import jinja2

from stagectl.config.stage_file import Setup
from stagectl.interchange.c_code.translation import Translation
from stagectl.interchange.fmu.variables import Leaf, Variable, leaves
from stagectl.kernels import equilibrium, plant_with_effects, stage
from stagectl.recording.metadata import versions
from stagectl.units import Quantity, in_base_units

TYPES = {float: "Float64", int: "Int64"}
OPTIONS = "-std=c99 -O2 -ffp-contract=off"  # the bits of the compiled kernels: products and sums stay apart
_TEMPLATES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent),
    autoescape=lambda name: name is not None and name.endswith(".xml.jinja"),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    keep_trailing_newline=True,
)


def model_description(setup: Setup, variables: list[Variable], identifier: str, token: str) -> str:
    """The text of modelDescription.xml."""
    kind = setup.file.axis.kind
    return _TEMPLATES.get_template("modelDescription.xml.jinja").render(
        name=setup.file.name,
        token=token,
        identifier=identifier,
        period=setup.dt,
        version=versions()["stagectl"],
        units=_units({each.quantity.unit_for(kind) for each in variables}),
        variables=[(TYPES[type(each.start)], _entries(each, k, kind)) for k, each in enumerate(variables)],
        outputs=[reference for reference, each in enumerate(variables) if each.causality == "output"],
    )


def build_description(identifier: str, source: str) -> str:
    """The text of sources/buildDescription.xml."""
    template = _TEMPLATES.get_template("buildDescription.xml.jinja")
    return template.render(identifier=identifier, source=source, options=OPTIONS)


def _units(units: set[str]) -> list[tuple[str, float, dict[str, int]]]:
    """Each unit with its factor and exponents in SI base units."""
    return [(unit, *in_base_units(unit)) for unit in sorted(units - {""})]


def _entries(variable: Variable, reference: int, kind: str) -> dict[str, object]:
    """Attributes of a variable; those that are None are left out."""
    low, high = (type(variable.start)(end) if math.isfinite(end) else None for end in variable.quantity.bounds())
    return {
        "name": variable.name,
        "valueReference": reference,
        "causality": variable.causality,
        "variability": variable.variability,
        "description": variable.quantity.meaning,
        "unit": variable.quantity.unit_for(kind) or None,
        "min": low,
        "max": high,
        "start": _number(variable.start) if variable.causality in ("input", "parameter") else None,
    }


def _number(value: float | int) -> str:
    return repr(value) if math.isfinite(value) else ("INF" if value > 0.0 else "-INF")


def header(setup: Setup, variables: list[Variable]) -> str:
    """The text of model.h."""
    kernels = Translation()
    for kernel in (stage.period, stage.measured, stage.reported, plant_with_effects.opposing, equilibrium.standing):
        kernels.add(kernel)
    each = list(leaves(setup.stage))
    starts = [*((variable.place, variable.start) for variable in variables), *_constants(each)]
    return _TEMPLATES.get_template("model.h.jinja").render(
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
