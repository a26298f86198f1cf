"""The page of one run: tracking error, curves over time, and the commands to repeat it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl import evaluation
from stagectl.drives.drive import Fault
from stagectl.number_format import length
from stagectl.recording.hdf5 import Recording
from stagectl.report.figures import WITH, WITHOUT
from stagectl.report.page import Page, Picture, Table
from stagectl.report.panels import CONVENTIONAL, TRUTH, Frame, Line, picture

BUCKETS = 1500  # points of a curve: each the lowest and the highest of its rows
_CURRENTS = (
    ("measured_current", "measured", TRUTH),
    ("current", "command", WITH),
    ("friction", "friction compensation", WITHOUT),
    ("feedforward", "feedforward", CONVENTIONAL),
)
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
Array = NDArray[np.float64]


def page(recording: Recording, commands: Sequence[str]) -> Page:
    """The page of a recording, of a machine or simulated."""
    samples, meta = recording.samples, recording.meta
    result = evaluation.evaluate(samples, meta)
    return Page(
        f"{result['stage']}: {result['trajectory']}",
        answer(result, samples),
        _notes(result, meta),
        _pictures(samples, meta),
        [Table("In figures", ["", ""], _rows(result, meta))],
        [*commands, f"stagectl replay {shlex.quote(str(recording.path))}"],
        {name: str(version) for name, version in meta["versions"].items()},
        broad=True,
        config={file["name"]: file["text"] for file in meta["files"].values()},
    )


def answer(result: dict[str, Any], samples: NDArray[Any]) -> str:
    """The result of the run in a sentence."""
    unit, error = result["unit"], result["tracking_error"]
    fault = next((Fault(int(code)) for code in samples["fault"] if code != Fault.NONE), None)
    if fault is not None:
        at = float(samples["time"][np.flatnonzero(samples["fault"] != Fault.NONE)[0]])
        return f"Stopped after {at:.3g} s: {fault.name.lower().replace('_', ' ')}."
    if result["open_loop"]:
        low, high = (length(end, unit) for end in result["travelled"])
        return f"The loop was open; the axis moved from {low} to {high}."
    if error["peak"] is None:
        return "The run ended before the window in which its error is evaluated."
    settled = "" if result["in_position"] else " At the end the axis did not settle in position."
    return f"The stage tracks within {length(error['peak'], unit)}, rms {length(error['rms'], unit)}.{settled}"


def _notes(result: dict[str, Any], meta: dict[str, Any]) -> list[str]:
    window = f"{result['steady'][0]:.3g} to {result['steady'][1]:.3g} s, shaded"
    simulated = "Simulated, on the stage model." if "tracking_error_true" in result else "Recorded."
    return [
        f"{simulated} {meta['created']}, Ts {1e3 * meta['dt']:g} ms, nd = {result['nd']}, nm = {result['nm']}. The "
        f"error is the reference minus the measured position, both at the instant of the latch, over {window}.",
    ]


def _rows(result: dict[str, Any], meta: dict[str, Any]) -> list[list[str]]:
    unit, rows = result["unit"], []
    for name, words in (
        ("tracking_error", "tracking error"),
        ("tracking_error_true", "of the simulated true position"),
    ):
        error = result.get(name)
        if error and error["peak"] is not None:
            rows += [[f"{words}, {kind}", length(error[kind], unit)] for kind in ("peak", "rms")]
    low, high = (length(end, unit) for end in result["travelled"])
    return [
        *rows,
        ["travelled", f"{low} to {high}"],
        ["peak current", f"{result['peak_current']:.3g} A"],
        ["cycles at the current limit", f"{result['saturated_cycles']} of {result['cycles']}"],
        ["late cycles", f"{result['late_cycles']} of {result['cycles']}"],
        ["duration", f"{result['cycles'] * meta['dt']:.4g} s"],
    ]


def _pictures(samples: NDArray[Any], meta: dict[str, Any]) -> list[Picture]:
    scale, unit = meta["axis"]["travel_per_unit"], meta["axis"]["travel_unit"]
    reference = evaluation.latched_reference(samples, meta)
    error = np.where(evaluation.closed(samples), (reference - samples["measured"]) * scale, np.nan)
    steady = tuple(meta["steady"])
    inside = evaluation.window(samples["time"], meta["steady"])
    places = [("target", samples["reference"] * scale, WITHOUT), ("actual", samples["measured"] * scale, WITH)]
    currents = [(label, samples[name], colour) for name, label, colour in _CURRENTS]
    return [
        _drawn(samples, places, ("position", unit), (steady,)),
        _drawn(samples, [("", error, WITH)], ("tracking error", unit), (steady,), within=error[inside]),
        _drawn(samples, currents, ("current", "A"), (steady,)),
    ]


def _drawn(
    samples: NDArray[Any],
    curves: Sequence[tuple[str, Array, str]],
    quantity_unit: tuple[str, str],
    shaded: tuple[tuple[float, float], ...],
    within: Array | None = None,
) -> Picture:
    """Curves over time in a suitable unit; the values `within` decide the height where they are given."""
    quantity, unit = quantity_unit
    known = [(label, values, colour) for label, values, colour in curves if np.isfinite(values).any()]
    scaling = within if within is not None and np.isfinite(within).any() else np.concatenate([y for _, y, _ in known])
    largest = float(np.nanmax(np.abs(scaling), initial=0.0))
    size, prefix = _prefix(largest)
    lines = []
    for label, values, colour in known:
        time, extremes = thinned(samples["time"], values / size)
        lines.append(Line(time, extremes, label, colour, width=0.9))
    factor = 1.4 if within is None else 1.6  # room for the legend; for values outside the window
    room = (-factor * largest / size, factor * largest / size) if largest else None
    frame = Frame(
        "time [s]", f"{quantity} [{prefix}{unit}]", ylim=room, shaded=shaded, legend="upper center", columns=2
    )
    return picture(lines, frame, f"{quantity.capitalize()} over time.")


def _prefix(largest: float) -> tuple[float, str]:
    return next(
        ((size, name) for size, name in _PREFIXES if largest >= size), _PREFIXES[-1] if largest else _PREFIXES[0]
    )


def thinned(time: Array, values: Array) -> tuple[Array, Array]:
    """Lowest and highest of each bucket: no peak is lost."""
    rows = math.ceil(len(values) / BUCKETS)
    if rows < 2:
        return time, values
    whole = len(values) // rows * rows
    buckets = values[:whole].reshape(-1, rows)
    extremes = np.column_stack([np.fmin.reduce(buckets, axis=1), np.fmax.reduce(buckets, axis=1)]).ravel()
    return np.repeat(time[:whole:rows], 2), extremes
