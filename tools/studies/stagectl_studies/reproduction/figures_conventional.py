"""Figures of the ball-screw paper, as panels: conventional identification (Figs. 2 to 6)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.identification.result import Characteristic
from stagectl.report.figures import TARGET, WITH, WITHOUT
from stagectl.report.page import Picture
from stagectl.report.panels import CONVENTIONAL, SHADES, TRUTH, Frame, Line, picture
from stagectl_studies.reproduction.published import INERTIA, VISCOUS
from stagectl_studies.reproduction.step_response import StepResponse, rise
from stagectl_studies.reproduction.stribeck import StribeckExamination, torque

Array = NDArray[np.float64]
Model = tuple[float, float]  # inertia (kg m^2), viscous (N m s/rad)
_HERTZ = "frequency [Hz]"


def linear(frequency: Array, force_constant: float, model: Model) -> NDArray[np.complex128]:
    """``Kt / (J s + D)``, rad/(s A)."""
    return np.asarray(force_constant / (2j * np.pi * frequency * model[0] + model[1]), dtype=np.complex128)


def responses(curves: list[dict[str, Any]], force_constant: float, model: Model) -> list[Picture]:
    """Fig. 2: gain, phase and coherence at several amplitudes, and with the axis kept moving."""
    gains, phases, coherences = [], [], []
    still = [line for line in curves if not line["moving"]]
    for curve in (*still, *(line for line in curves if line["moving"])):
        f, sound = np.array(curve["frequency"]), np.array(curve["sound"])
        moving = curve["moving"]
        colour = WITH if moving else SHADES[min(still.index(curve), len(SHADES) - 1)]
        label = "axis kept moving" if moving else f"R = {curve['amplitude']:g} A"
        style, width = ("." if moving else ".-"), 1.0
        gains.append(Line(f[sound], 20 * np.log10(np.array(curve["gain"])[sound]), label, colour, style, width))
        phases.append(Line(f[sound], np.degrees(np.array(curve["phase"])[sound]), label, colour, style, width))
        seen = np.array([np.nan if x is None else x for x in curve["coherence"]])
        coherences.append(Line(f, seen, label, colour, style, width))
    f = np.geomspace(1.0, 250.0, 200)
    response = linear(f, force_constant, model)
    gains.append(Line(f, 20 * np.log10(np.abs(response)), "linear model", TARGET, "--"))
    phases.append(Line(f, np.degrees(np.angle(response)), "", TARGET, "--"))
    return [
        picture(gains, Frame(_HERTZ, "gain [dB re 1 rad/(s A)]", "(a) gain", True), "Gain falls as R gets smaller."),
        picture(
            phases,
            Frame(_HERTZ, "phase [deg]", "(b) phase", True, (-135, 100)),
            "Phase leads; the stage in presliding is a spring.",
        ),
        picture(
            coherences,
            Frame(_HERTZ, "coherence", "(c) coherence", True, (0.9, 1.005)),
            "Coherence over the periods of each line; poor lines are left out of (a) and (b).",
        ),
    ]


def characteristics(
    spans: list[dict[str, Any]],
    model: tuple[float, float],
    loop: tuple[Array, Array],
    stribeck: StribeckExamination,
) -> list[Picture]:
    """Fig. 3: friction over velocity, near zero and at speed, and the loop (position m, torque N m) of rolling.

    `spans` and `model` = (viscous, coulomb) are those of the stage without a Stribeck effect.
    """
    speed = np.concatenate([np.linspace(-40.0, -1e-3, 800), np.linspace(1e-3, 40.0, 800)])
    viscous, coulomb = model
    points = ([span.speed for span in stribeck.spans], [span.force for span in stribeck.spans])
    lines = [
        Line(speed, torque(stribeck.fitted, speed), "the paper's equation, fitted", WITH),
        Line(*points, "constant speed, stage with Stribeck", WITHOUT, "o"),
        Line([span["speed"] for span in spans], [span["force"] for span in spans], "stage A", CONVENTIONAL, "o"),
        Line(speed, np.sign(speed) * coulomb + viscous * speed, "$D\\omega + T_c$ sgn $\\omega$", TRUTH, "--"),
    ]
    frame = Frame("speed [rad/s]", "friction torque [N m]", "(a) over velocity", ylim=(-9.5, 9.5))
    near = frame._replace(title="(a) near zero speed", xlim=(-9.0, 9.0), ylim=(-3.2, 3.2))
    caption = "Friction falls from Ts as the axis begins to move, and then rises with D; stage A has no Ts."
    position, rolling = loop
    loops = [Line(1e6 * position, rolling, "", CONVENTIONAL, "-", 0.8)]
    return [
        picture(lines, frame, "Over all speeds of Fig. 5."),
        picture([line._replace(label="") for line in lines], near, caption),
        picture(
            loops,
            Frame("table position [µm]", "torque [N m]", "(b) over displacement"),
            "Rolling friction: a loop that springs after each reversal and then stays at Tc.",
        ),
    ]


def steps(responses: list[StepResponse], force_constant: float, scale: float) -> list[Picture]:
    """Steps of current: position and speed, and the first-order models; `scale` in m of table travel per rad."""
    positions, speeds = [], []
    for shade, step in zip(SHADES, responses, strict=True):
        t, label = 1e3 * step.time, f"{step.current:g} A"
        model = rise(step.time, force_constant * step.current, step.inertia, step.viscous)
        positions += [
            Line(t, 1e3 * scale * step.position, label, shade),
            Line(t, 1e3 * scale * model, "", TARGET, "--"),
        ]
        frictionless = rise(step.time, force_constant * step.current, INERTIA, VISCOUS)
        for course, colour, style in ((step.position, shade, "-"), (model, TARGET, "--"), (frictionless, TRUTH, ":")):
            speeds.append(Line(t[::10], _speed(step.time, course)[::10], label if style == "-" else "", colour, style))
    axis = "time from the step [ms]"
    return [
        picture(
            positions,
            Frame(axis, "table position [mm]", "(a) position"),
            "Dashed: the first-order model fitted to each.",
        ),
        picture(
            speeds,
            Frame(axis, "speed [rad/s]", "(b) speed"),
            "Dotted: what J 0.010 and D 0.14 would give without friction.",
        ),
    ]


def _speed(time: Array, position: Array) -> Array:
    """By central differences over 10 ms, which takes the encoder's noise off the eye."""
    wide = round(5e-3 / float(time[1] - time[0]))
    padded = np.pad(position, wide, mode="reflect", reflect_type="odd")
    return np.asarray((padded[2 * wide :] - padded[: -2 * wide]) / (2 * wide * (time[1] - time[0])), dtype=np.float64)


def curve_fit(curve: dict[str, Any], force_constant: float, fits: list[tuple[str, str, Model]]) -> list[Picture]:
    """Fig. 4: the largest amplitude, and first-order models (label, colour, model) fitted to it."""
    sound = np.array(curve["sound"])
    f, size = np.array(curve["frequency"])[sound], 20 * np.log10(np.array(curve["gain"])[sound])
    label = f"measured, R = {curve['amplitude']:g} A"
    gains = [Line(f, size, label, SHADES[-1], "o")]
    phases = [Line(f, np.degrees(np.array(curve["phase"])[sound]), label, SHADES[-1], "o")]
    fine = np.geomspace(float(np.min(f)), float(np.max(f)), 200)
    for name, colour, model in fits:
        response = linear(fine, force_constant, model)
        gains.append(Line(fine, 20 * np.log10(np.abs(response)), name, colour))
        phases.append(Line(fine, np.degrees(np.angle(response)), name, colour))
    return [
        picture(
            gains, Frame(_HERTZ, "gain [dB re 1 rad/(s A)]", "(a) gain", True), "A first-order curve fits the gain;"
        ),
        picture(phases, Frame(_HERTZ, "phase [deg]", "(b) phase", True), "its phase shows what it leaves out."),
    ]


def reversal(
    strokes: list[dict[str, Any]], tables: list[tuple[str, str, Characteristic]], scale: float, most: float
) -> Picture:
    """Fig. 6: torque over the displacement since a reversal, measured and by `tables` (label, style, table)."""
    lines = []
    for number, stroke in enumerate(strokes):
        s = 1e6 * scale * np.array(stroke["displacement"])
        label = "measured, both directions" if number == 0 else ""
        lines.append(Line(s, stroke["force"], label, WITHOUT, ".", 0.5))
    colours = (CONVENTIONAL, WITH)
    dense = np.linspace(0.0, most / scale, 400)
    for number, (name, style, table) in enumerate(tables):
        colour = TRUTH if style == "--" else colours[number % 2]
        lines.append(Line(1e6 * scale * dense, force_after(table, dense), name, colour, style, 1.5))
    frame = Frame("displacement since the reversal [µm]", "torque [N m]", "after a reversal", xlim=(0.0, 1e6 * most))
    return picture(lines, frame, "The torque of a full reversal, and the table that compensates it.")


def slow_loop(strokes: list[dict[str, Any]], table: Characteristic, scale: float) -> Picture:
    """Fig. 6: torque over position of full strokes, and the model's loop; the middle of a stroke is 0."""
    measured, modelled = [], []
    for number, stroke in enumerate(strokes):
        s, way = np.array(stroke["displacement"]), stroke["direction"]
        place = 1e6 * scale * way * (s - 0.5 * s[-1])
        label = number == 0
        measured.append(Line(place, way * np.array(stroke["force"]), "measured" * label, WITHOUT, ".", 0.5))
        modelled.append(Line(place, way * force_after(table, s), "model" * label, CONVENTIONAL, "-", 1.4))
    frame = Frame("table position [µm]", "torque [N m]", "over position", ylim=(-1.6, 1.6), columns=2)
    return picture([*measured, *modelled], frame, "The loop of the ultra-slow sine; block means of the torque.")


def force_after(table: Characteristic, displacement: Array) -> Array:
    """Force (n,) of the table's operators at displacements (n,) since a full reversal."""
    stretched = np.clip(displacement[:, None] / table.slip - 1.0, -1.0, 1.0)
    return np.asarray(stretched @ table.weight, dtype=np.float64)
