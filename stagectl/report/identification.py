"""The page of an identification: parameters with intervals, captures, and the figures of its method."""

import importlib
from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from stagectl.config.stage_file import Setup
from stagectl.identification.capture import Capture
from stagectl.identification.result import Characteristic, IdentificationResult
from stagectl.number_format import duration, length
from stagectl.report import interactive
from stagectl.report.constants import MOST_CAPTURES, MOST_POINTS
from stagectl.report.figures import TARGET, WITH, WITHOUT, displacement_unit, drawing, effort_unit, embedded, weights
from stagectl.report.page import Page, Picture, Table
from stagectl.report.tables.identification import parameters

_FIGURES = {  # the module of `report.methods` whose `pictures` are a method's; least squares has none of its own
    "simultaneous": "simultaneous",
    "frf": "conventional",
    "constant-speed": "conventional",
    "low-speed": "conventional",
    "zero-crossing": "zero_crossing",
    "friction-models": "friction_models",
}


def page(result: dict[str, Any], source: tuple[IdentificationResult, Sequence[Capture], Setup], command: str) -> Page:
    """The page of the JSON `result` of `methods.result`, and its `source`; `command` repeats the identification."""
    identified, captures, setup = source
    pictures: list[Picture] = []
    if module := _FIGURES.get(result["method"]):
        drawn = importlib.import_module(f"stagectl.report.methods.{module}")
        pictures += drawn.pictures(identified, setup.file)
    if identified.table is not None and not pictures:
        pictures.append(Picture(embedded(characteristic(identified.table, setup)), "Friction after a reversal."))
    for capture in captures[:MOST_CAPTURES]:
        pictures.append(interactive.picture(motion(capture, setup), f"Position and current of {_name(capture)}."))
    title, notes = f"stagectl identify {result['method']}: {result['stage']}", [*result["notes"], *_notes(captures)]
    shown = [parameters(result), *_correlations(result), _captures(captures)]
    return Page(title, answer(result), notes, pictures, shown, [command])


def answer(result: dict[str, Any]) -> str:
    """The parameters in a sentence."""
    words = [
        f"{name.replace('_', ' ')} {_value_text(parameter)}"
        for name, parameter in result["parameters"].items()
        if parameter["value"] is not None
    ]
    return f"Found: {', '.join(words)}." if words else "No single parameters: see the figures and tables."


def _value_text(parameter: dict[str, Any]) -> str:
    value, unit = parameter["value"], parameter["unit"]
    if unit in ("s", "m"):
        return duration(value) if unit == "s" else length(value, "m")
    return f"{value:.4g} {unit}".strip()


def _correlations(result: dict[str, Any]) -> list[Table]:
    reported = result.get("identifiability") or {}
    if not {"names", "correlation"} <= set(reported):
        return []
    names, matrix = reported["names"], reported["correlation"]
    rows = [[name, *("" if x is None else f"{x:+.3f}" for x in row)] for name, row in zip(names, matrix, strict=True)]
    return [Table("Correlations: a pair near +1 or -1 is not separated by this motion", ["", *names], rows)]


def _captures(captures: Sequence[Capture]) -> Table:
    rows = [
        [_name(one), str(n), duration(one.dt * n), duration(one.dt), one.current_column.replace("_", " ")]
        for one in captures
        for n in [len(one.time)]
    ]
    return Table("Captures", ["capture", "rows", "length", "step", "current taken from"], rows)


def _notes(captures: Sequence[Capture]) -> list[str]:
    """Notes on the captures; one that several share is given once."""
    names_of: dict[str, list[str]] = {}
    for capture in captures:
        for note in capture.notes:
            names_of.setdefault(note, []).append(_name(capture))
    return [f"{names[0] if len(names) == 1 else f'{len(names)} captures'}: {note}" for note, names in names_of.items()]


def _name(capture: Capture) -> str:
    return capture.name.rsplit("/", 1)[-1]


def motion(capture: Capture, setup: Setup) -> Figure:
    """Position and current of a capture over time."""
    axis = setup.file.axis
    scale, unit = (1e3 * axis.travel_per_unit, "mm") if axis.travel_unit == "m" else (1.0, "rad")
    step = max(1, len(capture.time) // MOST_POINTS)
    with drawing(2, 1, figsize=(5.6, 4.0), sharex=True) as (figure, (above, below)):
        above.plot(capture.time[::step], scale * capture.position[::step], color=TARGET, linewidth=0.9)
        above.set_ylabel(f"position [{unit}]")
        below.plot(capture.time[::step], capture.current[::step], color=WITHOUT, linewidth=0.9)
        below.set(ylabel=f"{capture.current_column.replace('_', ' ')} [A]", xlabel="time [s]")
    return figure


def characteristic(table: Characteristic, setup: Setup) -> Figure:
    """Friction over the displacement since a reversal, and its stop operators."""
    scale, unit = displacement_unit(setup.file.axis)
    force = effort_unit(setup.file.axis.kind)
    with drawing(1, 2, figsize=(5.6, 4.0), width_ratios=(4, 3)) as (figure, (curve, bars)):
        curve.plot(scale * table.displacement, table.force, color=WITH, linewidth=1.4)
        curve.set(xlabel=f"displacement since the reversal [{unit}]", ylabel=f"friction [{force}]")
        weights(bars, table.weight, table.slip, (scale, unit, force))
    return figure
