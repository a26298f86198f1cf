"""The page of a comparison: the verdict, its figures and tables, and the commands to repeat it."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from stagectl.evaluation import tracking_error, window
from stagectl.recording.hdf5 import open_recording
from stagectl.report import interactive
from stagectl.report.figures import TARGET, WITH, WITHOUT, drawing, embedded, plain_decades, prefixed
from stagectl.report.page import Page, Picture
from stagectl.report.tables.comparison import tables

Result = dict[str, Any]
WIDTH = 5.4  # inches: two fit side by side on a page, with letters as large as the captions


def page(result: Result, commands: list[str]) -> Page:
    """The page of `trials.compare`'s result."""
    names, repeats = [variant["name"] for variant in result["variants"]], len(result["order"])
    answer = next(
        (line for line in result["verdict"] if line.startswith((f"{result['best']} ", f"{result['best']}:"))),
        result["verdict"][-1],
    )
    begin, end = open_recording(Path(result["variants"][0]["recordings"][-1])).meta["steady"]
    where = "simulated" if result["simulated"] else "on the drive"
    order = "one run each" if repeats == 1 else f"{repeats} repeats each, in an order that a Latin square balances"
    about = (
        f"{result['stage']}, {result['trajectory']}, {where}: {len(names)} variants, {order}. "
        f"The tracking error is taken from {begin:.3g} to {end:.3g} s."
    )
    return Page(
        f"stagectl compare: {', '.join(names)}",
        answer,
        [*(line for line in result["verdict"] if line != answer), about, *result["notes"]],
        _pictures(result),
        tables(result),
        commands,
    )


def _pictures(result: Result) -> list[Picture]:
    drawn = [
        Picture(embedded(peaks(result)), "Peak error of each repeat, and their mean (bar), on a logarithmic scale."),
        interactive.picture(errors(result), "Tracking error of the last repeat of each variant. The scales differ."),
    ]
    if result["learned"]:
        drawn.append(Picture(embedded(courses(result["learned"])), "Error over the whole run, trial by trial."))
    return drawn


def _colour(result: Result, name: str) -> str:
    """The first variant, the best one, and all others."""
    if name == result["best"]:
        return WITH
    return WITHOUT if name == result["variants"][0]["name"] else TARGET


def peaks(result: Result) -> Figure:
    """Peak error of each repeat, a row a variant."""
    rows = result["variants"]
    scale, unit = prefixed([variant["peak"]["mean"] for variant in rows], result["unit"])
    with drawing(figsize=(WIDTH, 1.0 + 0.42 * len(rows))) as (figure, axes):
        for place, variant in enumerate(rows):
            colour = _colour(result, variant["name"])
            values = scale * np.array(variant["peak"]["values"])
            spread = np.linspace(-0.18, 0.18, len(values)) if len(values) > 1 else np.zeros(1)
            axes.plot(values, place + spread, "o", color=colour, markersize=4, alpha=0.7, markeredgewidth=0)
            axes.plot([scale * variant["peak"]["mean"]] * 2, [place - 0.3, place + 0.3], color=colour, linewidth=2)
        axes.set_yticks(range(len(rows)), [variant["name"] for variant in rows])
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.grid(False, axis="y")
        axes.set_xscale("log")
        every = np.log10(np.concatenate([scale * np.array(variant["peak"]["values"]) for variant in rows]))
        axes.set_xlim(10 ** (np.floor(2 * every.min() - 0.2) / 2), 10 ** (np.ceil(2 * every.max() + 0.2) / 2))
        plain_decades(axes.xaxis)
        axes.set_xlabel(f"peak error [{unit}]")
    return figure


def errors(result: Result) -> Figure:
    """The last repeat's error over time, a panel a variant."""
    rows = result["variants"]
    size = (WIDTH, 0.6 + 1.0 * len(rows))
    with drawing(len(rows), 1, figsize=size, sharex=True, squeeze=False) as (figure, grid):
        for axes, variant in zip(grid[:, 0], rows, strict=True):
            recording = open_recording(Path(variant["recordings"][-1]))
            time = recording.column("time")
            inside = window(time, recording.meta["steady"])
            error = tracking_error(recording.samples, recording.meta)[inside]
            scale, unit = prefixed(error, result["unit"])
            axes.plot(time[inside], scale * error, color=_colour(result, variant["name"]), linewidth=0.8)
            axes.set_title(variant["name"], loc="left", fontsize=8, pad=2, color=TARGET)
            axes.set_ylabel(f"error [{unit}]")
            reach = 1.15 * scale * float(np.max(np.abs(error)))
            axes.set_ylim(-reach, reach)
        grid[-1, 0].set_xlabel("time [s]")
    return figure


def courses(learned: list[Result]) -> Figure:
    """Error over the whole run of each trial, a line a learning."""
    with drawing(figsize=(WIDTH, 3.1)) as (figure, axes):
        values = [[trial["whole"]["rms"] for trial in course["trials"]] for course in learned]
        scale, unit = prefixed(np.concatenate(values), learned[0]["unit"])
        for colour, course, rms in zip((WITH, TARGET, WITHOUT, "#7c3aed"), learned, values, strict=False):
            trials, kept = scale * np.array(rms), course["kept"]
            axes.plot(range(1, len(rms) + 1), trials, "o-", color=colour, markersize=4, label=course["name"])
            axes.plot(kept, trials[kept - 1], "o", color=colour, markersize=9, fillstyle="none")
        axes.set_yscale("log")
        plain_decades(axes.yaxis)
        axes.xaxis.set_major_locator(mpl.ticker.MaxNLocator(integer=True))
        axes.set(xlabel="trial (ring: the course that is kept)", ylabel=f"rms error [{unit}]")
        axes.legend(fontsize=8)
    return figure
