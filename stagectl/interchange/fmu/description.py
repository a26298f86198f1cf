"""The XML files of the FMU: what its variables are, and how its source is built.

Source: Functional Mock-up Interface 3.0.2, chapters 2.4 and 2.5.
"""

import math
from xml.etree import ElementTree

from stagectl.config.stage_file import Setup
from stagectl.interchange.fmu.variables import Variable
from stagectl.recording.metadata import versions
from stagectl.units import in_base_units

TYPES = {float: "Float64", int: "Int64"}
OPTIONS = "-std=c99 -O2 -ffp-contract=off"  # the bits of the compiled kernels: products and sums stay apart
VERSION = "3.0"


def model_description(setup: Setup, variables: list[Variable], identifier: str, token: str) -> str:
    """The text of modelDescription.xml."""
    root = ElementTree.Element(
        "fmiModelDescription", fmiVersion=VERSION, modelName=setup.file.name, instantiationToken=token,
        description=f"The stage {setup.file.name} behind its drive, at a control period of {setup.dt:g} s",
        generationTool=f"stagectl {versions()['stagectl']}", variableNamingConvention="structured",
    )  # fmt: skip
    state = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
    _child(root, "CoSimulation", modelIdentifier=identifier, fixedInternalStepSize=repr(setup.dt), **state)
    _units(_child(root, "UnitDefinitions"), {each.quantity.unit_for(setup.file.axis.kind) for each in variables})
    _child(_child(root, "LogCategories"), "Category", name="logStatusError", description="what went wrong")
    _child(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=repr(setup.dt))
    listed, structure = _child(root, "ModelVariables"), _child(root, "ModelStructure")
    for reference, variable in enumerate(variables):
        _child(listed, TYPES[type(variable.start)], **_entries(variable, reference, setup.file.axis.kind))
    outputs = [str(reference) for reference, variable in enumerate(variables) if variable.causality == "output"]
    for output in outputs:
        _child(structure, "Output", valueReference=output, dependencies="")
    for output in outputs:
        _child(structure, "InitialUnknown", valueReference=output)
    return _text(root)


def build_description(identifier: str, source: str) -> str:
    """The text of sources/buildDescription.xml."""
    root = ElementTree.Element("fmiBuildDescription", fmiVersion=VERSION)
    configuration = _child(root, "BuildConfiguration", modelIdentifier=identifier)
    _child(_child(configuration, "SourceFileSet", language="C99", compilerOptions=OPTIONS), "SourceFile", name=source)
    _child(configuration, "Library", name="m", external="true", description="the C library's mathematics")
    return _text(root)


def _entries(variable: Variable, reference: int, kind: str) -> dict[str, str]:
    low, high = variable.quantity.bounds()
    unit = variable.quantity.unit_for(kind)
    ends = {"min": low, "max": high}
    start = variable.causality in ("input", "parameter")
    return {
        "name": variable.name,
        "valueReference": str(reference),
        "causality": variable.causality,
        "variability": variable.variability,
        "description": variable.quantity.meaning,
        **({"unit": unit} if unit else {}),
        **{name: _number(type(variable.start)(end)) for name, end in ends.items() if math.isfinite(end)},
        **({"start": _number(variable.start)} if start else {}),
    }


def _units(parent: ElementTree.Element, units: set[str]) -> None:
    for unit in sorted(units - {""}):
        scale, exponents = in_base_units(unit)
        entries = {name: str(exponent) for name, exponent in exponents.items()}
        _child(_child(parent, "Unit", name=unit), "BaseUnit", factor=repr(scale), **entries)


def _number(value: float | int) -> str:
    return repr(value) if math.isfinite(value) else ("INF" if value > 0.0 else "-INF")


def _child(parent: ElementTree.Element, tag: str, /, **entries: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, entries)


def _text(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
