"""One picture for each effect: the residual over its coordinate, of a machine with the effect and of one without it."""

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
from stagectl.report.figures import STYLE
from stagectl_studies.effect_pictures import measured_effect
from stagectl_studies.effect_pictures.measured_effect import Residual, Scene

MOST, FEW = 6000, 500  # most points of a picture; up to FEW of them are drawn larger
PERIODS = 512.0  # signal periods of the encoder per turn
STANDSTILL = 1e-2  # of the largest speed: below it a motion has no direction
LEAST_DISPLACEMENT = 4e-5  # rad since a reversal, some counts of the encoder
LONG = 0.5  # s of rest
Flags = NDArray[np.bool_]


class Theme(NamedTuple):
    """Colours of a picture on one background."""

    name: str
    ink: str
    grid: str
    forward: str
    backward: str
    without: str


LIGHT = Theme("light", "#334155", "#e2e8f0", "#0f766e", "#d97706", "#94a3b8")
DARK = Theme("dark", "#cbd5e1", "#334155", "#2dd4bf", "#fbbf24", "#64748b")
THEMES = (LIGHT, DARK)


class Across(NamedTuple):
    """A coordinate as it is drawn."""

    label: str
    of: Callable[[Residual, float], Array]  # of the motion and the travel (m) per rad | m
    log: bool = False


AXES: dict[str, Across] = {
    "velocity": Across("velocity [mm/s]", lambda s, m: s.velocity * m * 1e3),
    "speed": Across("speed [mm/s]", lambda s, m: np.abs(s.velocity) * m * 1e3, True),
    "pace": Across("speed [mm/s]", lambda s, m: np.abs(s.velocity) * m * 1e3),
    "load": Across("magnitude of the current [A]", lambda s, m: np.abs(s.current)),
    "acceleration": Across("acceleration [m/s²]", lambda s, m: s.acceleration * m),
    "since": Across("displacement since the reversal [µm]", lambda s, m: s.since * m * 1e6, True),
    "position": Across("position [mm]", lambda s, m: s.position * m * 1e3),
    "turn": Across("angle of the screw [°]", lambda s, m: np.degrees(s.position) % 360.0),
    "period": Across(
        "position modulo the encoder's signal period", lambda s, m: (s.position * PERIODS / (2.0 * np.pi)) % 1.0
    ),
    "current": Across("current command [A]", lambda s, m: s.current),
    "slope": Across("slope of the current command [A/ms]", lambda s, m: s.slope * 1e-3),
    "error": Across("tracking error [µm]", lambda s, m: s.error * m * 1e6),
    "time": Across("time [s]", lambda s, m: s.time),
    "clock": Across("session clock [s]", lambda s, m: s.time),
}
FREQUENCY = "frequency"
WITHOUT = "without the effect"  # label
RESIDUALS = {
    measured_effect.EFFORT: ("unexplained effort", "N m"),
    measured_effect.CURRENT: ("unexplained current", "A"),
    measured_effect.COMMAND: ("logged minus\nrecomputed command", "A"),
}


def pictures(setup: Setup, scene: Scene, folder: Path) -> list[Path]:
    """Write the effect's picture for a light and for a dark background; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    both = measured_effect.residuals(setup, scene)
    files = []
    for theme in THEMES:
        path = folder / f"{scene.name}-{theme.name}.png"
        figure = picture(setup, scene, both, theme)
        figure.savefig(path, dpi=150, transparent=True)
        plt.close(figure)
        files.append(path)
    return files


def picture(setup: Setup, scene: Scene, both: tuple[Residual, Residual], theme: Theme) -> Figure:
    """The residuals of `both` machines, with the effect and without it."""
    with rc_context({**STYLE, **_style(theme)}):
        figure, axes = plt.subplots(figsize=(7.4, 2.9))
        if scene.across == FREQUENCY:
            _spectra(axes, scene, both, setup.dt, theme)
        else:
            _points(axes, scene, both, setup.file.axis.travel_per_unit, theme)
        _labelled(axes, scene)
        figure.tight_layout()
    return figure


def _style(theme: Theme) -> dict[Any, Any]:
    names = ("axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color", "text.color", "legend.labelcolor")
    return {**dict.fromkeys(names, theme.ink), "grid.color": theme.grid}


def _points(axes: Axes, scene: Scene, both: tuple[Residual, Residual], scale: float, theme: Theme) -> None:
    across = AXES[scene.across]
    for run, has_effect in ((both[1], False), (both[0], True)):
        x = across.of(run, scale)
        y = run.residual * np.sign(run.velocity) if _along_motion(scene) else run.residual
        kept = _kept(scene, run, x)
        for label, colour, rows in groups(run, scene, theme) if has_effect else [(WITHOUT, theme.without, kept)]:
            chosen = np.flatnonzero(rows & kept)
            chosen = chosen[:: max(1, len(chosen) // MOST)]
            size = 1.8 if len(chosen) > FEW else 4.0
            axes.plot(x[chosen], y[chosen], ".", color=colour, markersize=size, label=label)
    if across.log:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")


def _along_motion(scene: Scene) -> bool:
    """Whether the effort is drawn along the motion."""
    return scene.opposing or scene.across == "clock"


def _kept(scene: Scene, run: Residual, x: Array) -> Flags:
    """Rows that are drawn: those in motion, where the coordinate is one of the motion."""
    share = {"clock": 0.97, "time": -1.0, "current": -1.0, "slope": -1.0, "error": -1.0}.get(scene.across, STANDSTILL)
    speed = np.abs(run.velocity)
    kept: Flags = speed > share * speed.max()
    if scene.across == "since":  # without the end of a stroke, where the axis decelerates to a standstill
        ending = (speed < 0.2 * speed.max()) & (run.acceleration * run.velocity < 0.0)
        kept = ~ending & (run.since > LEAST_DISPLACEMENT)
    if scene.zoom is not None:
        kept &= (x > scene.zoom[0]) & (x < scene.zoom[1])
    return kept


def groups(run: Residual, scene: Scene, theme: Theme) -> list[tuple[str, str, Flags]]:
    """Groups of the points of the machine with the effect: label, colour, rows."""
    if scene.across == "clock":
        return [("with it", theme.forward, np.full(len(run.time), True))]
    labels, first = {
        "gain": (("accelerating", "decelerating"), run.acceleration * run.velocity > 0.0),
        "pace": (("fast", "slow"), np.abs(run.velocity) > 0.6 * np.abs(run.velocity).max()),
        "rest": (("after a long rest", "after a short rest"), run.rest > LONG),
        "direction": (("forward", "backward"), run.velocity > 0.0),
    }[scene.colours]
    return [
        (f"with it, {labels[0]}", theme.forward, first),
        (f"with it, {labels[1]}", theme.backward, ~first),
    ]


def _spectra(axes: Axes, scene: Scene, both: tuple[Residual, Residual], dt: float, theme: Theme) -> None:
    largest = 0.0
    for run, colour, label in zip(both[::-1], (theme.without, theme.forward), (WITHOUT, "with it"), strict=True):
        frequency, amplitude = measured_effect.spectrum(run.residual, dt)
        if scene.channel == measured_effect.CURRENT:
            amplitude = amplitude / measured_effect.spectrum(run.current, dt)[1]
        rows = (frequency >= 5.0) & (frequency <= 500.0)
        largest = max(largest, float(amplitude[rows].max()))
        label = label if amplitude[rows].max() > 1e-9 else f"{label}: none"
        axes.loglog(frequency[rows], amplitude[rows], color=colour, linewidth=1.2, label=label)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_ylim(bottom=largest * 1e-4)


def _labelled(axes: Axes, scene: Scene) -> None:
    name, unit = RESIDUALS[scene.channel]
    if _along_motion(scene):
        name = f"{name}\nalong the motion"
    if scene.across == FREQUENCY:
        name, unit = (f"{name}\nover the command", "A/A") if unit == "A" else (name, f"{unit}/√Hz")
    axes.set_xlabel("frequency [Hz]" if scene.across == FREQUENCY else AXES[scene.across].label)
    axes.set_ylabel(f"{name} [{unit}]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.0)
    for handle in axes.get_legend().legend_handles:  # type: ignore[union-attr]
        if isinstance(handle, Line2D) and handle.get_marker() == ".":
            handle.set_markersize(9.0)
