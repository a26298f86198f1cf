"""The signed page, with one figure a step: a person reads the HTML, a program the JSON next to it."""

import json
import math
import os
import shlex
import textwrap
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from stagectl.number_format import length, prefix
from stagectl.problem import Problem, ProblemKind
from stagectl.report import interactive
from stagectl.report.figures import FAINT, TARGET, WITH, WITHOUT, drawing, legend_of_each
from stagectl.report.page import Page, Picture, Table, write
from stagectl.units import StageError
from stagectl.workflows.acceptance.result import Acceptance, Outcome, StepResult
from stagectl.workflows.acceptance.traces import Trace

BUT_VIRTUAL = ", on a virtual drive: this says nothing about a machine"
_VIRTUAL = (
    "a virtual drive. With simulation.clock: sync its axis stands still while"
    " the bus is silent; then the distances of kill and silence say how far it came until then, not how it brakes"
)


def free_places(path: Path) -> tuple[Path, Path]:
    """Where `write_pages` puts JSON and HTML, in a folder that exists afterwards.

    Raises OSError where there can be none, StageError where it cannot be written to or something is there already.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if not os.access(path.parent, os.W_OK):
        raise _refused(path.parent, "cannot be written to", "choose another folder with -o")
    places = path.with_suffix(".json"), path.with_suffix(".html")
    for place in places:
        if os.path.lexists(place):
            raise _refused(place, "exists, and is never replaced", "choose another name with -o, or move it away")
    return places


def _refused(place: Path, reason: str, remedy: str) -> StageError:
    return StageError(Problem(f"{place} {reason}", ProblemKind.CONFLICT, file=place, remedy=remedy))


def write_pages(result: Acceptance, signature: dict[str, Any], path: Path) -> tuple[Path, Path]:
    """Write JSON and HTML next to each other, `path` without its suffix; the two files.

    The JSON is the signed one; the page shows its hash.  Raises OSError, and StageError where one is there already.
    """
    machine, human = free_places(path)
    with machine.open("x", encoding="utf-8") as file:
        json.dump(signature, file, indent=2, ensure_ascii=False, allow_nan=False)
        file.write("\n")
    return machine, write(_page(result, signature, machine), human)


def _page(result: Acceptance, signature: dict[str, Any], machine: Path) -> Page:
    missing = [step for step in result.steps if step.outcome.value != "passed"]
    answer = (
        f"Accepted: all {len(result.steps)} steps were done and passed{BUT_VIRTUAL if result.virtual else ''}."
        if result.accepted
        else "NOT ACCEPTED: " + "; ".join(f"{step.name} {step.outcome.value}" for step in missing) + "."
    )
    title, figures = f"Acceptance of {result.stage}", pictures(result.steps, result.unit)
    tables = [_steps(result), Table("Drive", ["", ""], [[name, value] for name, value in result.drive.items()])]
    again = f"stagectl drive accept {result.stage_file} --person {shlex.quote(result.person)}"
    commands = [again, f"stagectl drive verify {machine.name}"]
    return Page(title, answer, _notes(result, signature), figures, tables, commands, result.software)


def _notes(result: Acceptance, signature: dict[str, Any]) -> list[str]:
    drive = _VIRTUAL if result.virtual else "a drive on the bench"
    code = signature["hmac_sha256"]
    return [
        f"{result.person} signed on {result.date}, and answers for each step. The drive is {drive}.",
        f"Stage file {result.stage_file}, SHA-256 {result.stage_sha256}; EDS, SHA-256 {result.eds_sha256}.",
        f"SHA-256 of the content: {signature['sha256']}. "
        + (f"HMAC-SHA-256: {code}." if code else "No key was configured: there is no HMAC."),
        "STO, emergency stop and end switches are no part of this: they are tried by hand, before it.",
    ]


def _steps(result: Acceptance) -> Table:
    rows = []
    for step in result.steps:
        distances = ["" if way is None else length(way, result.unit) for way in (step.measured, step.bound)]
        rows.append([step.name, step.title, step.outcome.value, *distances, step.words])
    return Table("Steps", ["step", "what was tried", "result", "distance", "bound", "what was found"], rows, (1, 2, 5))


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
        for axes in (way, current):
            legend_of_each(axes, fontsize=7, ncols=3, columnspacing=1.0, handlelength=1.4, loc="lower left",
                           bbox_to_anchor=(-0.02, 0.98))  # fmt: skip
    return interactive.picture(figure, f"{step.name}: {step.title}")


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
    of = f"{trace.name}, " if trace.name else ""
    axes.plot(trace.time, trace.current, color=FAINT, linewidth=2.4, label=f"{of}commanded")
    axes.plot(trace.time[: len(trace.flowing)], trace.flowing, color=colour, linewidth=0.9, label=f"{of}measured")


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
    way.axhline(scale * origin, color=FAINT, linestyle=":", label="bound from here")
    if step.measured is not None:
        farthest = scale * (origin + sign * step.measured)
        way.axhline(farthest, color=TARGET, linewidth=1.0, label="farthest measured")
    if step.bound is not None:
        way.axhline(scale * (origin + sign * step.bound), **_dashed("bound"))


def _dashed(label: str) -> dict[str, Any]:
    return {"color": "#b91c1c", "linestyle": "--", "linewidth": 1.0, "label": label}
