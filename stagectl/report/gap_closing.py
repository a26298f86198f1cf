"""The page of a gap that was closed on the machine: the error before and after, and what each effect gave."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stagectl.gap.effects.library import label
from stagectl.number_format import length, percent, portion
from stagectl.report.figures import WITH, WITHOUT, drawing, embedded, prefixed
from stagectl.report.page import Page, Picture, Table

Result = dict[str, Any]
_WIDTH = 5.2  # inches


def sentence(result: Result) -> str:
    """What was reached, in one line."""
    if not result["rounds"]:
        return f"Nothing was changed: {result['ended']}"
    rms, peak = (
        " -> ".join(length(result[levels][name], result["unit"]) for name in ("before", "after"))
        for levels in ("levels", "peaks")
    )
    gave = ", ".join(
        f"{label(name)} gave {portion(share)}"
        for name, share in sorted(result["shares"].items(), key=lambda item: -item[1])
    )
    return f"Tracking error {rms} rms, {peak} peak, on motions that nothing had seen" + (f"; {gave}" if gave else "")


def notes(result: Result) -> list[str]:
    """How it went and how it ended."""
    lines = [_round(number, done) for number, done in enumerate(result["rounds"], 1)]
    if result["rounds"]:
        ways = (("By the simulated change", "foretold"), ("On the machine", "levels"))
        lines.append(" ".join(_shrunk(where, result[levels], result) for where, levels in ways))
    if dropped := ", ".join(map(label, result["dropped"])):
        lines.append(f"Left to the feedback, as the error is smaller without it: {dropped}.")
    where = "Simulated runs." if result["simulated"] else "Runs on the drive."
    back = "`stage-0.yaml` is the model as it was."
    return [*lines, f"It ended because of this: {result['ended']}.", f"{where} The model is {result['model']}; {back}"]


def _round(number: int, done: Result) -> str:
    """What was found in one round, and where."""
    where = f"It was here: {done['where']}." if done["found"] else "Applied are the fitted values, without an effect."
    closes = f"On its held-out runs {percent(done['foretold'])} of the squared gap closes."
    return f"Round {number}: {done['diagnosis']}. {where} {closes}"


def _shrunk(where: str, levels: dict[str, float], result: Result) -> str:
    before, after = (length(levels[name], result["unit"]) for name in ("before", "after"))
    return f"{where} the error on these motions goes from {before} to {after} rms."


def tables(result: Result) -> list[Table]:
    """Peak and rms of each motion, before, after, and without each effect; then the shares."""
    rows = [
        [
            motion.removeprefix("unseen-"),
            name,
            *(length(row[measure]["mean"], result["unit"]) for measure in ("peak", "rms")),
        ]
        for motion, variants in result["errors"].items()
        for name, row in variants.items()
    ]
    errors = Table("Tracking error on motions that nothing had seen", ["motion", "model", "peak", "rms"], rows)
    shares = [
        [label(name), percent(share), " to ".join(map(percent, result["share_intervals"][name] or ()))]
        for name, share in result["shares"].items()
    ]
    head = ["effect", "share", "95 % interval"]
    return [errors, *([Table("Share of the squared error that went", head, shares)] if shares else [])]


def page(result: Result, commands: list[str]) -> Page:
    """The page of `workflows.gap_closing.close`."""
    caption = "Rms tracking error of each repeat, before and after."
    pictures = [Picture(embedded(errors(result)), caption)] if result["errors"] else []
    title = f"stagectl gap close: {result['stage']}"
    return Page(title, sentence(result), notes(result), pictures, tables(result), commands)


def errors(result: Result) -> Figure:
    """The rms error of each repeat before and after, a row a motion."""
    motions = list(result["errors"])
    everything = np.concatenate(
        [result["errors"][motion][name]["rms"]["values"] for motion in motions for name in ("before", "after")]
    )
    factor, unit = prefixed(everything, result["unit"])
    with drawing(figsize=(_WIDTH, 1.2 + 0.5 * len(motions))) as (figure, axes):
        for row, motion in enumerate(motions):
            for name, colour in (("before", WITHOUT), ("after", WITH)):
                values = factor * np.array(result["errors"][motion][name]["rms"]["values"])
                places = np.full(len(values), float(row))
                axes.plot(values, places, "o", color=colour, markersize=5, label=name if row == 0 else None)
        axes.set_yticks(range(len(motions)), [motion.removeprefix("unseen-").replace("-", " ") for motion in motions])
        axes.set_ylim(len(motions) - 0.5, -0.5)
        axes.set_xlim(left=0.0)
        axes.set_xlabel(f"rms tracking error [{unit}]")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.0 + 0.5 / len(motions)), ncols=2)
    return figure
