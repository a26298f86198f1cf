"""The page of one run: tracking error, curves over time, and the commands to repeat it."""

import math
import shlex
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stagectl import evaluation
from stagectl.number_format import duration, length
from stagectl.recording.extremes import extremes
from stagectl.recording.hdf5 import Recording
from stagectl.recording.replay import check_ran
from stagectl.report.constants import ALL_ROWS
from stagectl.report.figures import WITH, WITHOUT, prefixed
from stagectl.report.page import Page
from stagectl.report.panels import CONVENTIONAL, TRUTH, Frame, Line, picture, stacked
from stagectl.report.tables import run as tables

_CURRENTS = (
    ("measured_current", "measured", TRUTH),
    ("current", "command", WITH),
    ("friction", "friction compensation", WITHOUT),
    ("feedforward", "feedforward", CONVENTIONAL),
)
_CAPTIONS = {
    "position": "Position: the reference, and what the encoder measured.",
    "tracking error": "Tracking error: the reference minus the measured position.",
    "current": "Current: what the drive measured, the command, and the parts of the command.",
}
Array = NDArray[np.float64]


def page(recording: Recording, commands: Sequence[str]) -> Page:
    """The page of a recording, of a machine or simulated.  Raises RecordingError for one that was imported."""
    check_ran(recording, "law and no tracking error to report")
    samples, meta = recording.filled("report").samples, recording.meta
    result = {**evaluation.evaluate(samples, meta), "lost_rows": recording.lost_rows}
    return Page(
        f"{result['stage']}: {result['trajectory']}",
        tables.answer(result, samples),
        _notes(result, meta, len(samples)),
        [picture(lines, frame, caption) for lines, frame, caption in _panels(samples, meta)],
        [tables.achieved(result, meta)],
        [*commands, f"stagectl replay {shlex.quote(str(recording.path))}"],
        {name: str(version) for name, version in meta["versions"].items()},
        config={file["name"]: file["text"] for file in meta["files"].values()},
    )


def _notes(result: dict[str, Any], meta: dict[str, Any], rows: int) -> list[str]:
    window = f"{result['steady'][0]:.3g} to {result['steady'][1]:.3g} s, shaded"
    simulated = "Simulated, on the stage model." if "tracking_error_true" in result else "Recorded."
    return [
        f"{simulated} {meta['created']}, Ts {1e3 * meta['dt']:g} ms, nd = {result['nd']}, nm = {result['nm']}. The "
        f"error is the reference minus the measured position, both at the instant of the latch, over {window}.",
        *([f"The curves show the lowest and the highest of every {size} rows."] if (size := _bucket(rows)) > 1 else []),
    ]


def figure(recording: Recording) -> Figure:
    """Position, tracking error and current over time, as far as the recording has them."""
    return stacked([(lines, frame) for lines, frame, _ in _panels(recording.samples, recording.meta)])


_Panel = tuple[list[Line], Frame, str]  # with its caption
_Curve = tuple[str, Array, str]  # label, values and colour


def _panels(samples: NDArray[Any], meta: dict[str, Any]) -> list[_Panel]:
    scale, unit = meta["axis"]["travel_per_unit"], meta["axis"]["travel_unit"]
    names, time, steady = samples.dtype.names or (), samples["time"], tuple(meta["steady"])
    places = [
        (name, samples[name] * scale, colour)
        for name, colour in (("reference", TRUTH), ("measured", WITH))
        if name in names
    ]
    currents = [(label, samples[name], colour) for name, label, colour in _CURRENTS if name in names]
    currents = [curve for curve in currents if np.isfinite(curve[1]).any()]
    shown = [_drawn(time, places, ("position", unit), steady)]
    if {"reference", "closed"} <= set(names):
        error = np.where(evaluation.closed(samples), evaluation.tracking_error(samples, meta), np.nan)
        inside = evaluation.window(time, meta["steady"])
        if np.isfinite(error).any():  # an open loop has none
            late = evaluation.started(samples, meta)
            drawn = _drawn(time, [("", error, WITH)], ("tracking error", unit), steady, error[inside & late])
            shown.append(_with_peak(drawn, time, error, unit))
    return [*shown, *([_drawn(time, currents, ("current", "A"), steady)] if currents else [])]


def _with_peak(drawn: _Panel, time: Array, error: Array, unit: str) -> _Panel:
    """The panel, and in words a peak that lies outside of it."""
    lines, frame, caption = drawn
    peak = int(np.nanargmax(np.abs(error)))
    shown = np.max(np.abs(lines[0].y[np.isfinite(lines[0].y)]))
    if frame.ylim is None or shown <= max(map(abs, frame.ylim)):
        return drawn
    words = f"{length(abs(error[peak]), unit)} at {duration(time[peak])}"
    place = (float(time[peak]), frame.ylim[0 if error[peak] < 0.0 else 1])
    return lines, frame._replace(outside=(words, place)), f"{caption} Its peak lies outside: {words}."


def _drawn(
    time: Array, curves: list[_Curve], about: tuple[str, str], steady: tuple[float, float], within: Array | None = None
) -> _Panel:
    """Curves `about` a quantity and its unit over time; the values `within` decide the height where they are given."""
    quantity, plain = about
    known = [(label, values, colour) for label, values, colour in curves if np.isfinite(values).any()]
    scaling = within if within is not None and np.isfinite(within).any() else np.concatenate([y for _, y, _ in known])
    low, high = float(np.nanmin(scaling)), float(np.nanmax(scaling))
    largest = max(abs(low), abs(high))
    scale, unit = prefixed(largest, plain)
    lines = []
    for number, (label, values, colour) in enumerate(known):
        below = number == 0 and len(known) > 1  # broad, as the others lie on it
        lines.append(Line(*thinned(time, values * scale), label, colour, width=2.4 if below else 0.9))
    factor = 1.4 if within is None else 1.6  # room for the legend; for values outside the window
    middle, half = 0.5 * (low + high), 0.5 * (high - low) or 0.1 * largest
    room = ((middle - factor * half) * scale, (middle + factor * half) * scale) if largest else None
    frame = Frame("time [s]", f"{quantity} [{unit}]", ylim=room, shaded=(steady,), legend="upper center", columns=2)
    return lines, frame, _CAPTIONS[quantity]


def thinned(time: Array, values: Array) -> tuple[Array, Array]:
    """All rows; of a run of more than `ALL_ROWS` the lowest and the highest of each bucket: no peak is lost."""
    size = _bucket(len(values))
    if size == 1:
        return time, values
    whole = len(values) // size * size
    buckets = extremes(values[:whole, None], 0, size)
    return np.repeat(time[:whole:size], 2), np.column_stack([buckets.low[0], buckets.high[0]]).ravel()


def _bucket(rows: int) -> int:
    """Rows that two points of a curve stand for; 1 where each row has a point."""
    return 1 if rows <= ALL_ROWS else math.ceil(2 * rows / ALL_ROWS)
