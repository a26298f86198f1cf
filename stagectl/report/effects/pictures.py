"""One picture an effect: what the model lacks over the coordinate that orders it, with the effect and without it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import pyplot as plt
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.gap.logs.session import Array
from stagectl.report.effects import measured_effect
from stagectl.report.effects.measured_effect import Scene, Seen
from stagectl.report.figures import STYLE

MOST, FEW = 6000, 500  # points of a picture, and how many of them are drawn larger
PERIODS = 512.0  # signal periods of the encoder per turn
STANDING = 1e-2  # of the largest speed: below, there is no direction
LEAST_WAY = 4e-5  # rad since a reversal, some counts of the encoder
LONG = 0.5  # s of rest
Flags = NDArray[np.bool_]


class Paper(NamedTuple):
    """Colours of a picture on one ground."""

    name: str
    ink: str
    grid: str
    forth: str
    back: str
    without: str


LIGHT = Paper("light", "#334155", "#e2e8f0", "#0f766e", "#d97706", "#94a3b8")
DARK = Paper("dark", "#cbd5e1", "#334155", "#2dd4bf", "#fbbf24", "#64748b")
PAPERS = (LIGHT, DARK)


class Across(NamedTuple):
    """A coordinate as it is drawn."""

    label: str
    of: Callable[[Seen, float], Array]  # of the motion and the travel (m) per rad | m
    log: bool = False


AXES: dict[str, Across] = {
    "velocity": Across("velocity [mm/s]", lambda s, m: s.velocity * m * 1e3),
    "speed": Across("speed [mm/s]", lambda s, m: np.abs(s.velocity) * m * 1e3, True),
    "pace": Across("speed [mm/s]", lambda s, m: np.abs(s.velocity) * m * 1e3),
    "load": Across("current, without its sign [A]", lambda s, m: np.abs(s.current)),
    "acceleration": Across("acceleration [m/s²]", lambda s, m: s.acceleration * m),
    "since": Across("displacement since the reversal [µm]", lambda s, m: s.since * m * 1e6, True),
    "position": Across("position [mm]", lambda s, m: s.position * m * 1e3),
    "turn": Across("position modulo the lead [° of the screw]", lambda s, m: np.degrees(s.position) % 360.0),
    "period": Across(
        "position modulo the encoder's signal period", lambda s, m: (s.position * PERIODS / (2.0 * np.pi)) % 1.0
    ),
    "current": Across("current command that acts [A]", lambda s, m: s.current),
    "slope": Across("slope of the command that acts [A/ms]", lambda s, m: s.slope * 1e-3),
    "error": Across("tracking error [µm]", lambda s, m: s.error * m * 1e6),
    "time": Across("time [s]", lambda s, m: s.time),
    "clock": Across("session clock [s]", lambda s, m: s.time),
}
FREQUENCY = "frequency"
LACKING = {
    measured_effect.EFFORT: ("lacking effort", "N m"),
    measured_effect.CURRENT: ("missing current", "A"),
    measured_effect.COMMAND: ("command less\nthe recomputed one", "A"),
}


def pictures(setup: Setup, scene: Scene, folder: Path) -> list[Path]:
    """The effect's picture on a light and on a dark ground; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    both = measured_effect.seen(setup, scene)
    made = []
    for paper in PAPERS:
        path = folder / f"{scene.name}-{paper.name}.png"
        figure = picture(setup, scene, both, paper)
        figure.savefig(path, dpi=150, transparent=True)
        plt.close(figure)
        made.append(path)
    return made


def picture(setup: Setup, scene: Scene, both: tuple[Seen, Seen], paper: Paper) -> Figure:
    """What the model lacks of `both` machines, with the effect and without it."""
    with rc_context({**STYLE, **_style(paper)}):
        figure, axes = plt.subplots(figsize=(7.4, 2.9))
        if scene.across == FREQUENCY:
            _spectra(axes, scene, both, setup.dt, paper)
        else:
            _points(axes, scene, both, setup.file.axis.travel_per_unit, paper)
        _labelled(axes, scene)
        figure.tight_layout()
    return figure


def _style(paper: Paper) -> dict[Any, Any]:
    names = ("axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color", "text.color")
    return {**dict.fromkeys(names, paper.ink), "grid.color": paper.grid}


def _points(axes: Axes, scene: Scene, both: tuple[Seen, Seen], scale: float, paper: Paper) -> None:
    across = AXES[scene.across]
    for one, seen_with in ((both[1], False), (both[0], True)):
        x = across.of(one, scale)
        y = one.lacking * np.sign(one.velocity) if scene.opposing or scene.across == "clock" else one.lacking
        kept = _kept(scene, one, x)
        for label, colour, rows in groups(one, scene, paper) if seen_with else [("without it", paper.without, kept)]:
            chosen = np.flatnonzero(rows & kept)
            chosen = chosen[:: max(1, len(chosen) // MOST)]
            size = 1.8 if len(chosen) > FEW else 4.0
            axes.plot(x[chosen], y[chosen], ".", color=colour, markersize=size, label=label)
    if across.log:
        axes.set_xscale("log")


def _kept(scene: Scene, one: Seen, x: Array) -> Flags:
    """Rows that are drawn: those in motion, where the coordinate is one of the motion."""
    share = {"clock": 0.97, "time": -1.0, "current": -1.0, "slope": -1.0, "error": -1.0}.get(scene.across, STANDING)
    kept: Flags = np.abs(one.velocity) > share * np.abs(one.velocity).max()
    if scene.across == "since":  # but for the end of a stroke, where the axis comes to a stand
        ending = (np.abs(one.velocity) < 0.2 * np.abs(one.velocity).max()) & (one.acceleration * one.velocity < 0.0)
        kept = ~ending & (one.since > LEAST_WAY)
    if scene.zoom is not None:
        kept &= (x > scene.zoom[0]) & (x < scene.zoom[1])
    return kept


def groups(one: Seen, scene: Scene, paper: Paper) -> list[tuple[str, str, Flags]]:
    """What the points of the machine with the effect are told apart by: label, colour, rows."""
    if scene.across == "clock":
        return [("with it", paper.forth, np.full(len(one.time), True))]
    if scene.colours == "gain":
        faster = one.acceleration * one.velocity > 0.0
        return [("with it, getting faster", paper.forth, faster), ("with it, getting slower", paper.back, ~faster)]
    if scene.colours == "pace":
        fast = np.abs(one.velocity) > 0.6 * np.abs(one.velocity).max()
        return [("with it, fast", paper.forth, fast), ("with it, slow", paper.back, ~fast)]
    if scene.colours == "rest":
        long = one.rest > LONG
        return [("with it, after a short rest", paper.back, ~long), ("with it, after a long one", paper.forth, long)]
    forth = one.velocity > 0.0
    return [("with it, forth", paper.forth, forth), ("with it, back", paper.back, ~forth)]


def _spectra(axes: Axes, scene: Scene, both: tuple[Seen, Seen], dt: float, paper: Paper) -> None:
    largest = 0.0
    for one, colour, label in zip(both[::-1], (paper.without, paper.forth), ("without it", "with it"), strict=True):
        frequency, amplitude = measured_effect.spectrum(one.lacking, dt)
        if scene.channel == measured_effect.CURRENT:
            amplitude = amplitude / measured_effect.spectrum(one.current, dt)[1]
        rows = (frequency >= 5.0) & (frequency <= 500.0)
        largest = max(largest, float(amplitude[rows].max()))
        label = label if amplitude[rows].max() > 1e-9 else f"{label}: none"
        axes.loglog(frequency[rows], amplitude[rows], color=colour, linewidth=1.2, label=label)
    axes.set_ylim(bottom=largest * 1e-4)


def _labelled(axes: Axes, scene: Scene) -> None:
    lacking, unit = LACKING[scene.channel]
    if scene.opposing or scene.across == "clock":
        lacking = f"{lacking}\nalong the motion"
    if scene.across == FREQUENCY:
        lacking, unit = (f"{lacking}\nover the command", "A/A") if unit == "A" else (lacking, f"{unit}/√Hz")
    axes.set_xlabel("frequency [Hz]" if scene.across == FREQUENCY else AXES[scene.across].label)
    axes.set_ylabel(f"{lacking} [{unit}]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.0)
    for handle in axes.get_legend().legend_handles:  # type: ignore[union-attr]
        if isinstance(handle, Line2D) and handle.get_marker() == ".":
            handle.set_markersize(9.0)
