"""One page of an identification: what was found, how sure, from which captures, and the figures of its method."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from stagectl.config.stage_file import Setup
from stagectl.identification.capture import Capture
from stagectl.identification.result import Characteristic, IdentificationResult
from stagectl.number_format import duration, length
from stagectl.recording.metadata import versions
from stagectl.report.figures import STYLE, TARGET, WITH, WITHOUT, embedded
from stagectl.report.page import Page, Picture, Table

MOST_POINTS = 4000  # of a line; more is not seen
MOST_CAPTURES = 3  # drawn
_FIGURES = {  # the module of `report.methods` that draws a method's figures; least squares has none of its own
    "simultaneous": "simultaneous",
    "frf": "conventional",
    "constant-speed": "conventional",
    "low-speed": "conventional",
    "zero-crossing": "zero_crossing",
    "friction-models": "friction_models",
}


def page(result: dict[str, Any], what: tuple[IdentificationResult, Sequence[Capture], Setup], command: str) -> Page:
    """The page of `result`, as `methods.result` made it of `what`; `command` does it again."""
    found, captures, setup = what
    pictures = _of_the_method(result["method"], found, captures, setup)
    if found.table is not None and not pictures:
        pictures.append(Picture(embedded(characteristic(found.table, setup)), "Friction after a reversal."))
    for one in captures[:MOST_CAPTURES]:
        pictures.append(Picture(embedded(motion(one, setup)), f"What was identified from: {_name(one)}."))
    title, notes = f"stagectl identify {result['method']}: {result['stage']}", [*result["notes"], *_notes(captures)]
    own = _module(result["method"])
    tables = [parameters(result), *(own.tables(found) if hasattr(own, "tables") else [])]
    tables += [*_correlations(result), _captures(captures)]
    return Page(title, answer(result), notes, pictures, tables, [command], versions(), broad=True)


def answer(result: dict[str, Any]) -> str:
    """The parameters in a sentence."""
    words = [
        f"{name.replace('_', ' ')} {_worded(one)}"
        for name, one in result["parameters"].items()
        if one["value"] is not None
    ]
    return f"IdentificationResult: {', '.join(words)}." if words else "No single parameters: see the figures and tables."


def _worded(one: dict[str, Any]) -> str:
    if one["unit"] in ("s", "m"):
        return duration(one["value"]) if one["unit"] == "s" else length(one["value"], "m")
    return f"{one['value']:.4g} {one['unit']}".strip()


def parameters(result: dict[str, Any]) -> Table:
    """Values with their intervals."""
    rows = [
        [f"{name.replace('_', ' ')} [{one['unit']}]".replace(" []", ""), _number(one["value"]), _interval(one)]
        for name, one in result["parameters"].items()
    ]
    return Table("Parameters", ["parameter", "value", "95 % interval"], rows)


def _number(value: float | None) -> str:
    return "not known" if value is None else f"{value:.6g}"


def _interval(one: dict[str, Any]) -> str:
    if one["low"] is None or one["high"] is None:
        return "not known"
    return f"{one['low']:.5g} to {one['high']:.5g}"


def _correlations(result: dict[str, Any]) -> list[Table]:
    told = result.get("identifiability") or {}
    if not {"names", "correlation"} <= set(told):
        return []
    names, matrix = told["names"], told["correlation"]
    rows = [[name, *("" if x is None else f"{x:+.3f}" for x in row)] for name, row in zip(names, matrix, strict=True)]
    return [Table("Correlations: what lies near +1 or -1 moves together", ["", *names], rows)]


def _captures(captures: Sequence[Capture]) -> Table:
    rows = []
    for one in captures:
        current = one.current_column.replace("_", " ")
        rows.append([_name(one), str(len(one.time)), duration(one.dt * len(one.time)), duration(one.dt), current])
    return Table("Captures", ["capture", "rows", "length", "step", "current taken from"], rows)


def _notes(captures: Sequence[Capture]) -> list[str]:
    """What is said of the captures, once where it is the same of several."""
    said: dict[str, list[str]] = {}
    for capture in captures:
        for note in capture.notes:
            said.setdefault(note, []).append(_name(capture))
    return [f"{names[0] if len(names) == 1 else f'{len(names)} captures'}: {note}" for note, names in said.items()]


def _name(capture: Capture) -> str:
    return capture.name.rsplit("/", 1)[-1]


def _module(name: str) -> Any:
    """A method's own report module: ``pictures(found, captures, file)``, and ``tables(found)`` if it has any."""
    module = _FIGURES.get(name)
    return importlib.import_module(f"stagectl.report.methods.{module}") if module else None


def _of_the_method(name: str, found: IdentificationResult, captures: Sequence[Capture], setup: Setup) -> list[Picture]:
    """The figures that a method's own report module draws."""
    own = _module(name)
    return [] if own is None else list(own.pictures(found, list(captures), setup.file))


def motion(capture: Capture, setup: Setup) -> Figure:
    """Position and current of a capture over time."""
    axis = setup.file.axis
    scale, unit = (1e3 * axis.travel_per_unit, "mm") if axis.travel_unit == "m" else (1.0, "rad")
    step = max(1, len(capture.time) // MOST_POINTS)
    with rc_context(STYLE):
        figure, (above, below) = plt.subplots(2, 1, figsize=(5.6, 4.0), sharex=True)
        above.plot(capture.time[::step], scale * capture.position[::step], color=TARGET, linewidth=0.9)
        above.set_ylabel(f"position [{unit}]")
        below.plot(capture.time[::step], capture.current[::step], color=WITHOUT, linewidth=0.9)
        below.set_ylabel(f"{capture.current_column.replace('_', ' ')} [A]")
        below.set_xlabel("time [s]")
        figure.align_ylabels([above, below])
        figure.tight_layout()
    return figure


def characteristic(table: Characteristic, setup: Setup) -> Figure:
    """Friction over the displacement since a reversal, and the elements that it is made of."""
    axis = setup.file.axis
    scale, unit = (1e6 * axis.travel_per_unit, "µm") if axis.travel_unit == "m" else (1e3, "mrad")
    force = "N" if axis.kind == "linear" else "N m"
    with rc_context(STYLE):
        figure, (curve, bars) = plt.subplots(1, 2, figsize=(5.6, 4.0), width_ratios=(4, 3))
        curve.plot(scale * table.displacement, table.force, color=WITH, linewidth=1.4)
        curve.set_xlabel(f"displacement since the reversal [{unit}]")
        curve.set_ylabel(f"friction [{force}]")
        bars.vlines(scale * table.slip, 0.0, table.weight, color=WITH, linewidth=3.0)
        bars.set_xscale("log")
        bars.set_ylim(0.0, 1.1 * float(np.max(table.weight, initial=1e-12)))
        bars.set_xlabel(f"slip [{unit}]")
        bars.set_ylabel(f"weight [{force}]")
        figure.tight_layout()
    return figure
