"""The command `scope`: curves of a running service.

A capture is lines of text: a lane for each channel, with its range and its unit.  A character of a curve has two
columns and four rows of dots, which show the range of each column.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

from stagectl.api.arguments import quantity, terminal
from stagectl.cli.options import FirstAxis, Json, Socket, argument, option
from stagectl.cli.service import answered, ask_service
from stagectl.cli.show import console, emit
from stagectl.named_values import names_of
from stagectl.number_format import duration, length
from stagectl.units import Quantity
from stagectl.web.limits import LONGEST_SCOPE, SHORTEST_SCOPE

_TIME = Quantity("s", f"[{SHORTEST_SCOPE:g}, {LONGEST_SCOPE:g}]", "time of a capture")
_SHARE = Quantity("", "[0, 1]", "share of a capture")


def scope(
    channels: Annotated[
        list[str] | None,
        argument("[CHANNEL]...", "Up to 16; default: error measured_current. Several axes: x.error y.error."),
    ] = None,
    span: Annotated[str, option("--span TIME", "Length of a capture.")] = "1 s",
    trigger: Annotated[
        str | None, option("--trigger CONDITION", "For example 'error > 1 um'; <: falls below, =: crosses.")
    ] = None,
    before: Annotated[str, option("--before SHARE", "Part of the capture before the trigger.")] = "20 %",
    once: Annotated[bool, option("--once", "Take one capture and exit.")] = False,
    show: Annotated[bool, option("--list", "List the channels with units and meanings.")] = False,
    axis: FirstAxis = "",
    socket: Socket = None,
    json: Json = None,
) -> None:
    """Show curves of the running service in the terminal; each point is a minimum and a maximum.

    Example: stagectl scope error current --trigger "error > 0.1 um" --once
    """
    if show:
        _list(axis, socket, json)
        return
    from stagectl.web.capture_client import captures
    from stagectl.web.capture_client import trigger as read
    from stagectl.web.client import default_socket

    names = names_of(channels) or ["error", "measured_current"]
    once = once or json is not None
    wanted = read(trigger) if trigger else None
    request = {
        "axis": axis,
        "channels": names,
        "span": quantity("span", span, _TIME, "it such as '1 s'"),
        "before": quantity("before", before, _SHARE, "it such as '20 %' or 0.2"),
        "points": 100_000 if json is not None else 2 * max(terminal().width - 12, 20),
        "trigger": wanted,
        "mode": ("single" if trigger else "auto") if once else "normal" if trigger else "auto",
    }
    seen = _waited(captures(socket or default_socket(), request), wanted, axis)
    answered(lambda: _watched(seen, names, axis, once, json))


def _waited(seen: Any, trigger: dict[str, str] | None, axis: str) -> Iterator[Any]:
    """The captures alone; while no trigger comes, a line says what its channel does."""
    from stagectl.web.capture_client import WithoutTrigger

    said = ""
    for machine, one in seen:
        if trigger is None or not isinstance(one, WithoutTrigger):
            yield machine, one
            continue
        name = trigger["channel"]
        low, high = (_value(end, _about(machine, axis)[1][name]["unit"]) for end in one)
        words = f"waiting for the trigger; so far {name} lies between {low} and {high}; Ctrl-C ends"
        if words != said:
            console.print(words)
        said = words


def _watched(seen: Any, names: list[str], axis: str, once: bool, json: str | None) -> None:
    from rich.live import Live
    from rich.text import Text

    if once:
        machine, capture = next(seen)
        axis, about = _about(machine, axis)
        console.print(Text("\n".join(lines(capture, _full(machine, axis, names), about, terminal().width))))
        emit(_as_json(capture, names, axis, about), json)
        return
    with Live(Text("waiting for the trigger; Ctrl-C ends"), console=terminal(), refresh_per_second=10) as live:
        try:
            for machine, capture in seen:
                shown = lines(capture, _full(machine, axis, names), _about(machine, axis)[1], terminal().width)
                live.update(Text("\n".join(shown)))
        except KeyboardInterrupt:
            return


def _about(machine: dict[str, Any], axis: str) -> tuple[str, dict[str, Any]]:
    """Name of the axis and all channels; its own also by their full names."""
    name = axis or next(iter(machine))
    channels: dict[str, Any] = machine[name]["channels"]
    return name, {**channels, **{f"{name}.{channel}": about for channel, about in channels.items()}}


def _full(machine: dict[str, Any], axis: str, names: list[str]) -> list[str]:
    """The channels with the name of their axis, where there are several."""
    first = "" if len(machine) == 1 else f"{axis or next(iter(machine))}."
    return [name if "." in name else f"{first}{name}" for name in names]


def _as_json(capture: Any, names: list[str], axis: str, about: dict[str, Any]) -> dict[str, Any]:
    from stagectl.typed_json import finite

    channels = {
        name: {"unit": about[name]["unit"], "low": [*map(finite, low)], "high": [*map(finite, high)]}
        for name, low, high in zip(names, capture.low, capture.high, strict=True)
    }
    times = {"step": capture.step, "triggered": capture.triggered, "time": capture.time.tolist()}
    return {"axis": axis, **times, "channels": channels}


def _list(axis: str, socket: Path | None, json: str | None) -> None:
    known = ask_service(socket, "GET", "/v1/channels")
    for name, channels in known.items():
        if axis in ("", name):
            for channel, about in channels.items():
                print(f"{name}  {channel:17} {about['unit'] or '-':6} {about['meaning']}")
    emit(known, json)


_MARGIN = 12  # characters left of the curve
_LANE = 6  # lines
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))  # Unicode braille: rows from above, left and right
_BLANK = 0x2800


def lines(capture: Any, names: list[str], about: dict[str, Any], width: int) -> list[str]:
    """The lanes, then the axis of time with the trigger at 0."""
    size = (max(width - _MARGIN - 1, 10), _LANE if len(names) <= 4 else 3)
    text = []
    for name, low, high in zip(names, capture.low, capture.high, strict=True):
        unit, bounds = about[name]["unit"], bounds_of(low.tolist(), high.tolist())
        text.append(f"{name} {_value(float(low.min()), unit)} to {_value(float(high.max()), unit)}")
        lane = curve(low.tolist(), high.tolist(), bounds, size)
        marks = [_value(bounds[1], unit), *[""] * (len(lane) - 2), _value(bounds[0], unit)]
        text += [f"{mark:>{_MARGIN - 1}} {line}" for mark, line in zip(marks, lane, strict=True)]
    return [*text, _times(capture, size[0])]


def _times(capture: Any, width: int) -> str:
    start, end = float(capture.time[0]), float(capture.time[-1]) + capture.step
    first, last = duration(start), duration(end)
    place = round(-start / (end - start) * width) if end > start else 0
    text = list(first + " " * (width - len(first) - len(last)) + last)
    mark = "^ trigger" if capture.triggered else ""
    if mark and len(first) < place < width - len(last) - len(mark):
        text[place : place + len(mark)] = list(mark)
    return " " * _MARGIN + "".join(text)


def _value(value: float, unit: str) -> str:
    if unit in ("m", "rad"):
        return length(value, unit) if value else f"0 {unit}"
    if unit in ("m/s", "rad/s"):
        return f"{length(value, unit[:-2])}/s" if value else f"0 {unit}"
    if unit == "s":
        return duration(value)
    return f"{value:.3g} {unit}".strip()


def curve(low: Sequence[float], high: Sequence[float], bounds: tuple[float, float], size: tuple[int, int]) -> list[str]:
    """Lines of characters, ``size`` = (characters, lines), with what lies between `low` and `high` (n,).

    Neighbours are joined, so that a steep flank is a line and not single dots.  NaN leaves its column empty.
    """
    import numpy as np

    width, height = size
    starts = np.arange(2 * width) * len(low) // (2 * width)
    ends = np.stack([np.fmax.reduceat(high, starts), np.fmin.reduceat(low, starts)])  # of all that falls into a column
    share = (bounds[1] - ends) / (bounds[1] - bounds[0])
    first, last = np.floor(np.clip(4 * height * share, 0, 4 * height - 1))  # rows of dots, from above
    before, nothing = np.roll([first, last], 1, axis=1), np.isnan(first + last)
    before[:, 0] = before[:, np.roll(nothing, 1)] = np.nan
    row = np.arange(4 * height)[:, None]
    dots = ~nothing & (row >= np.fmin(first, before[1])) & (row <= np.fmax(last, before[0]))
    cells = _BLANK + np.einsum("hrwc,rc->hw", dots.reshape(height, 4, width, 2).astype(np.int64), _DOTS)
    return ["".join(map(chr, line)) for line in cells.tolist()]


def bounds_of(low: Sequence[float], high: Sequence[float]) -> tuple[float, float]:
    """Lowest and highest of all, never the same."""
    known = [value for value in (*low, *high) if not math.isnan(value)]
    bottom, top = (min(known), max(known)) if known else (0.0, 0.0)
    gap = 0.05 * (top - bottom) or max(abs(top) * 1e-3, 1e-12)
    return bottom - gap, top + gap
