"""The XML files of the FMU: what its variables are, and how its source is built.

Source: Functional Mock-up Interface 3.0.2, chapters 2.4 and 2.5.
"""

import math

from stagectl.config.stage_file import Setup
from stagectl.interchange.fmu.templates import TEMPLATES
from stagectl.interchange.fmu.variables import Variable
from stagectl.recording.metadata import versions
from stagectl.units import in_base_units

TYPES = {float: "Float64", int: "Int64"}
OPTIONS = "-std=c99 -O2 -ffp-contract=off"  # the bits of the compiled kernels: products and sums stay apart


def model_description(setup: Setup, variables: list[Variable], identifier: str, token: str) -> str:
    """The text of modelDescription.xml."""
    kind = setup.file.axis.kind
    return TEMPLATES.get_template("modelDescription.xml.jinja").render(
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
    template = TEMPLATES.get_template("buildDescription.xml.jinja")
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
