"""Figures of the conventional identification: Bode diagrams, force over speed, rolling-friction characteristic.

Source of their form: Simultaneous Identification ..., Figs 2, 4, 5 and 6.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.result import Characteristic, IdentificationResult
from stagectl.report.constants import DENSE, MODEL_POINTS
from stagectl.report.figures import FAINT, TARGET, WITH, WITHOUT, drawing, embedded, legend_of_each
from stagectl.report.page import Picture
from stagectl.units import ROTARY

SHADES = ("#f59e0b", "#0ea5e9", "#8b5cf6", "#0f766e", "#be123c", "#334155")


def pictures(result: IdentificationResult, file: StageFile) -> list[Picture]:
    """The figures of this method on an identification's page."""
    return [Picture(embedded(figure), f"{caption}.") for caption, figure in figures(result, file).items()]


def figures(result: IdentificationResult, file: StageFile) -> dict[str, Figure]:
    """All figures of a conventional method's result, by caption."""
    drawn: dict[str, Figure] = {}
    if "curves" in result.details:
        drawn["Frequency response from current to velocity"] = bode(result, file)
        if result.details["describing"]:
            drawn["Effort per velocity over 4/(π W): separates friction from damping"] = describing(result, file)
    if "spans" in result.details:
        drawn["Constant-speed examination"] = force_over_speed(result, file)
    if "strokes" in result.details and result.table is not None:
        drawn["Rolling-friction characteristic"] = rolling(result, result.table, file)
    return drawn


def bode(result: IdentificationResult, file: StageFile) -> Figure:
    """Gain, phase and coherence of all conditions, and the fitted models (Figs 2 and 4)."""
    with drawing(3, 1, figsize=(7.2, 7.4), sharex=True, height_ratios=[3.0, 2.2, 1.0]) as (
        figure,
        (gain, phase, coherence),
    ):
        for curve, colour in zip(result.details["curves"], _colours(len(result.details["curves"])), strict=True):
            _response((gain, phase, coherence), curve, colour)
        _models(gain, phase, result, file)
        velocity = "rad/(s A)" if file.axis.kind == ROTARY else "m/(s A)"
        gain.set_ylabel(f"gain [dB re 1 {velocity}]")
        phase.set_ylabel("phase [deg]")
        coherence.set(ylabel="coherence", xlabel="frequency [Hz]", ylim=(-0.05, 1.08))
        gain.set_xscale("log")
        gain.legend(loc="lower left", fontsize=8, ncols=2, columnspacing=1.2, handlelength=1.6)
    return figure


def _colours(count: int) -> list[str]:
    return [SHADES[k % len(SHADES)] for k in range(count)]


def _response(axes: tuple[Axes, Axes, Axes], curve: dict[str, Any], colour: str) -> None:
    """One condition: sound lines filled, poor ones hollow, bars of two standard deviations."""
    gain, phase, coherence = axes
    frequency, sound = np.array(curve["frequency"]), np.array(curve["sound"])
    size = np.array(curve["gain"])
    spread = np.array([0.0 if x is None else x for x in curve["deviation"]]) / size
    decibel, degrees = 20.0 * np.log10(size), np.degrees(curve["phase"])
    bars = np.minimum(2.0 * spread / np.sqrt(2.0), 0.9)
    dense = len(frequency) > DENSE
    marks: dict[str, Any] = {"linewidth": 0.8, "marker": "o", "color": colour}
    marks |= {"linestyle": "none", "markersize": 2.5} if dense else {"linestyle": "-", "markersize": 4}
    label = f"{curve['amplitude']:.3g} A {curve['kind']}{', axis moving' if curve['moving'] else ''}"
    for panel, values, half in ((gain, decibel, 8.69 * bars), (phase, degrees, np.degrees(bars))):
        panel.errorbar(frequency[sound], values[sound], half[sound], elinewidth=0.7, label=label, **marks)
        panel.plot(frequency[~sound], values[~sound], "o", color=colour, markerfacecolor="none", markersize=3)
    known = [(f, c) for f, c in zip(curve["frequency"], curve["coherence"], strict=True) if c is not None]
    if known:
        coherence.plot(*np.array(known).T, **marks)


def _models(gain: Axes, phase: Axes, result: IdentificationResult, file: StageFile) -> None:
    """Kt/(J s + D) by the gain's curve fit, and by the fit that is taken."""
    lowest = min(min(curve["frequency"]) for curve in result.details["curves"])
    highest = max(max(curve["frequency"]) for curve in result.details["curves"])
    frequency = np.geomspace(lowest, highest, MODEL_POINTS)
    fits = {row["name"]: row for row in result.details["fits"]}
    shown = [("identified", result.details["fits"][-1], TARGET, "-")]
    if "gain curve" in fits:
        amplitude = fits["gain curve"]["amplitude"]
        shown.append((f"curve fit at {amplitude:.3g} A", fits["gain curve"], FAINT, "--"))
    for name, row, colour, dashes in shown:
        response = file.motor.force_constant / (2j * np.pi * frequency * row["inertia"] + row["viscous"])
        style: dict[str, Any] = {"color": colour, "linestyle": dashes, "linewidth": 1.2, "zorder": 1}
        label = f"{name}: J = {row['inertia']:.3g}, D = {row['viscous']:.3g}"
        gain.plot(frequency, 20.0 * np.log10(np.abs(response)), label=label, **style)
        phase.plot(frequency, np.degrees(np.angle(response)), **style)


def describing(result: IdentificationResult, file: StageFile) -> Figure:
    """Re(Kt/H) over the fundamental of the velocity's sign by its amplitude: slope Tc, intercept D."""
    with drawing(figsize=(7.2, 4.2)) as (figure, axes):
        rows = result.details["describing"]
        unit = "N m s/rad" if file.axis.kind == ROTARY else "N s/m"
        for row, colour in zip(rows, _colours(len(rows)), strict=True):
            over, effort = np.array(row["relay_over_velocity"]), np.array(row["effort"])
            line = np.array([0.0, over.max() * 1.05])
            if row["presliding"]:
                axes.plot(over, effort, "o", color=FAINT, markerfacecolor="none", markersize=4)
                continue
            axes.plot(over, effort, "o", color=colour, markersize=4, label=f"{row['frequency']:g} Hz")
            axes.plot(line, row["viscous"] + row["coulomb"] * line, color=colour, linewidth=0.8)
        if any(row["presliding"] for row in rows):
            axes.plot([], [], "o", color=FAINT, markerfacecolor="none", markersize=4, label="in presliding")
        axes.set_xlabel(
            f"4/(π W) [{'s/rad' if file.axis.kind == ROTARY else 's/m'}], W the velocity amplitude, with harmonics"
        )
        axes.set_ylabel(f"Re(Kt/H) [{unit}]")
        straight = [row for row in rows if not row["presliding"]] or rows
        axes.set(
            xlim=(0.0, 1.5 * max(max(row["relay_over_velocity"]) for row in straight)),
            ylim=(0.0, 1.5 * max(max(row["effort"]) for row in straight)),
        )
        axes.legend(fontsize=8, ncols=2, title="intercept D, slope Tc", title_fontsize=8)
    return figure


def force_over_speed(result: IdentificationResult, file: StageFile) -> Figure:
    """Mean force of each span over its speed with the line, and the residual (Fig. 5)."""
    with drawing(2, 1, figsize=(7.2, 5.6), sharex=True, height_ratios=[2.6, 1.0]) as (figure, (force, residuals)):
        spans, values = result.details["spans"], result.parameters
        speed = np.array([span["speed"] for span in spans])
        offset = values["offset"].value if "offset" in values else 0.0
        unit = values["coulomb"].unit
        for sign in sorted({float(np.sign(v)) for v in speed}):
            line = np.array([0.0, sign * np.max(np.abs(speed))])
            model = values["viscous"].value * line + sign * values["coulomb"].value + offset
            force.plot(line, model, color=TARGET, linewidth=1.0)
        force.plot(speed, [span["force"] for span in spans], "o", color=WITH, markersize=5)
        force.set_ylabel(f"mean force [{unit}]")
        force.set_title(
            f"D = {values['viscous'].value:#.4g} {values['viscous'].unit}, "
            f"intercepts +{result.details['coulomb_positive']:#.4g} and "
            f"−{result.details['coulomb_negative']:#.4g} {unit}",
            loc="left",
            fontsize=9,
            color=TARGET,
        )
        bars = [2.0 * span["deviation"] * 1e3 for span in spans]
        residual = np.array(result.details["residual"]) * 1e3
        residuals.errorbar(
            speed, residual, bars, color=WITH, linestyle="none", marker="o", markersize=4, elinewidth=0.8
        )
        residuals.axhline(0.0, color=TARGET, linewidth=0.8)
        residuals.set(ylabel=f"residual [m{unit}]", xlabel=f"speed [{'rad/s' if file.axis.kind == ROTARY else 'm/s'}]")
    return figure


def rolling(result: IdentificationResult, table: Characteristic, file: StageFile) -> Figure:
    """Force along the direction over the travel since a reversal: measured strokes and the model (Fig. 6)."""
    with drawing(1, 2, figsize=(7.4, 3.8), sharey=True, width_ratios=[1.3, 1.0]) as (figure, (whole, near)):
        scale, unit = file.axis.travel_per_unit, file.axis.travel_unit
        offset = result.parameters["offset"].value
        for axes in (whole, near):
            for stroke in result.details["strokes"]:
                colour, name = (WITH, "upwards") if stroke["direction"] > 0.0 else (WITHOUT, "downwards, mirrored")
                force = np.array(stroke["force"]) - stroke["direction"] * offset
                axes.plot(_micro(stroke["displacement"], scale), force, ".", color=colour, markersize=2, label=name)
            longest = max(max(stroke["displacement"]) for stroke in result.details["strokes"])
            model = np.append(table.force, table.force[-1])
            way = np.append(table.displacement, max(longest, table.displacement[-1]))
            axes.plot(_micro(way, scale), model, color=TARGET, linewidth=1.3, label="stop operators")
            axes.set_xlabel(f"travel since the reversal [µ{unit}]")
        near.set_xlim(0.0, float(_micro([table.displacement[-1]], scale)[0]))
        near.set_title("where it bends", loc="left", fontsize=9, color=TARGET)
        whole.set_ylabel(f"force without offset [{result.parameters['coulomb'].unit}]")
        legend_of_each(whole, loc="lower right", fontsize=8, markerscale=3)
    return figure


def _micro(displacement: Any, scale: float) -> NDArray[np.float64]:
    return np.asarray(displacement, dtype=np.float64) * scale * 1e6
