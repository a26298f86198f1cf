"""One figure a step: position in the stage's unit and current over time, with the bound, under the verdict."""

from __future__ import annotations

import math
import textwrap
from typing import Any

from matplotlib.axes import Axes

from stagectl.number_format import prefix
from stagectl.report.figures import FAINT, TARGET, WITH, WITHOUT, drawing, embedded
from stagectl.report.page import Picture
from stagectl.workflows.acceptance.result import Outcome, StepResult
from stagectl.workflows.acceptance.traces import Trace

_SIZE, _WIDTH = (4.5, 4.4), 62  # inch, and letters in a line of the title
_COLOURS = (WITH, WITHOUT)  # of a step's trials


def pictures(steps: tuple[StepResult, ...], unit: str) -> list[Picture]:
    """The figures of all steps that moved the axis; `unit` is that of their distances: m | rad."""
    return [_picture(step, *_shown(step, unit)) for step in steps if any(trace.time for trace in step.traces)]


def _picture(step: StepResult, scale: float, unit: str) -> Picture:
    with drawing(2, 1, figsize=_SIZE, sharex=True) as (figure, (way, current)):
        verdict = textwrap.fill(f"{step.name} {step.outcome.value}: {step.words}", _WIDTH, max_lines=3)
        colour = TARGET if step.outcome is Outcome.PASSED else "#b91c1c"
        figure.suptitle(verdict, fontsize=9, fontweight="bold", color=colour, x=0.02, y=0.985, ha="left", va="top")
        for trace, shade in zip(step.traces, _COLOURS, strict=False):
            _position(way, trace, shade, scale)
            _current(current, trace, shade)
            _lines(way, current, trace, scale, step)
        event = next((trace.event for trace in step.traces if trace.event), "")
        way.set_ylabel(f"position [{unit}]")
        current.set(ylabel="current [A]", xlabel=f"time after {event} [s]" if event else "time [s]")
        _named(way)
        _named(current)
    return Picture(embedded(figure), f"{step.name}: {step.title}")


def _shown(step: StepResult, unit: str) -> tuple[float, str]:
    """Factor from m | rad, and the unit in which the step's positions read well: deg, or mm, or a smaller one."""
    if unit == "rad":
        return math.degrees(1.0), "deg"
    letter, scale = prefix(max(abs(place) for trace in step.traces for place in trace.position or [0.0]))
    return (scale, f"{letter}m") if letter else (1e3, "mm")


def _position(axes: Axes, trace: Trace, colour: str, scale: float) -> None:
    axes.plot(trace.time, [scale * place for place in trace.position], color=colour, linewidth=1.2, label=trace.name)
    if trace.after:
        time, place = zip(*trace.after, strict=True)
        axes.plot(time, [scale * x for x in place], ".", color=WITHOUT, markersize=2.5, label="read from the drive")


def _current(axes: Axes, trace: Trace, colour: str) -> None:
    axes.plot(trace.time, trace.current, color=FAINT, linewidth=2.4, label="commanded")
    axes.plot(trace.time[: len(trace.flowing)], trace.flowing, color=colour, linewidth=0.9, label="measured")


def _lines(way: Axes, current: Axes, trace: Trace, scale: float, step: StepResult) -> None:
    """What the trial is judged by, and its event as a vertical line."""
    if trace.origin is not None and trace.time:
        _bounds(way, trace, trace.origin, scale, step)
    if trace.least is not None:
        way.axhline(scale * trace.least, **_dashed("right way, far enough"))
    if trace.limit is not None:
        for sign in (1.0, -1.0):
            current.axhline(sign * trace.limit, **_dashed("limit"))
    for axes in (way, current) if trace.event else ():
        axes.axvline(0.0, color=TARGET, linewidth=0.8)


def _bounds(way: Axes, trace: Trace, origin: float, scale: float, step: StepResult) -> None:
    """Where the bound counts from, the farthest that was measured, and the bound, in the direction of the motion."""
    sign = math.copysign(1.0, trace.position[-1] - trace.position[0])
    way.axhline(scale * origin, color=FAINT, linestyle=":", label="bound counts from here")
    if step.measured is not None:
        farthest = scale * (origin + sign * step.measured)
        way.axhline(farthest, color=TARGET, linewidth=1.0, label="farthest measured")
    if step.bound is not None:
        way.axhline(scale * (origin + sign * step.bound), **_dashed("bound"))


def _dashed(label: str) -> dict[str, Any]:
    return {"color": "#b91c1c", "linestyle": "--", "linewidth": 1.0, "label": label}


def _named(axes: Axes) -> None:
    """A legend with each name once."""
    handles, labels = axes.get_legend_handles_labels()
    once = {label: handle for handle, label in zip(handles, labels, strict=True)}
    axes.legend(
        list(once.values()), list(once), fontsize=7, ncols=3, columnspacing=1.0, handlelength=1.4,
        loc="lower left", bbox_to_anchor=(-0.02, 0.98),
    )  # fmt: skip
