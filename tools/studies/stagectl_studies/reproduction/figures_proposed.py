"""Figures of the ball-screw paper, as panels: simultaneous identification and tracking (Figs. 8 to 10, 12 to 14)."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.report.figures import WITH, WITHOUT
from stagectl.report.page import Picture
from stagectl.report.panels import CONVENTIONAL, SHADES, Frame, Line, picture

Array = NDArray[np.float64]
_SECONDS, _PLACE, _TORQUE = "time [s]", "table position [mm]", "$T_d$ [N m]"


class Columns(NamedTuple):
    """Columns (n,) of a capture, all low-passed alike with zero phase."""

    time: Array  # s
    position: Array  # m of table travel
    velocity: Array  # rad/s
    acceleration: Array  # rad/s^2
    force: Array  # N m, Kt i
    friction: Array  # N m, of the rolling friction found


def columns(details: Mapping[str, Any], scale: float) -> Columns:
    """What the simultaneous identification keeps for figures."""
    c = {name: np.array(values, dtype=np.float64) for name, values in details["curves"].items()}
    return Columns(c["time"], scale * c["position"], c["velocity"], c["acceleration"], c["force"], c["friction"])


def disturbance(c: Columns, inertia: float, viscous: float) -> Array:
    """``T_d = Kt i - J a - D w`` (n,) N m, the paper's (2)."""
    return np.asarray(c.force - inertia * c.acceleration - viscous * c.velocity, dtype=np.float64)


def responses(c: Columns, force_constant: float, span: tuple[float, float]) -> list[Picture]:
    """Fig. 8: current, position, velocity and acceleration over `span` (s)."""
    inside = (c.time >= span[0]) & (c.time < span[1])
    t = c.time[inside]
    shown = (
        (c.force / force_constant, "current [A]", "(a) current"),
        (1e3 * c.position, _PLACE, "(b) position"),
        (c.velocity, "speed [rad/s]", "(c) velocity"),
        (c.acceleration, "acceleration [rad/s²]", "(d) acceleration"),
    )
    return [picture([Line(t, y[inside])], Frame(_SECONDS, label, title), "") for y, label, title in shown]


def flattening(c: Columns, inertia: float, viscous: float, misprint: tuple[float, float]) -> list[Picture]:
    """Fig. 9: the loop of the disturbance torque over the position, on its way to the rolling friction.

    `misprint` is the inertia and viscous friction that the paper prints on the way.
    """
    x = 1e3 * c.position
    first = [Line(x, disturbance(c, 0.0, 0.0), "", SHADES[0], "-", 0.8)]
    by_viscous, by_inertia = [], []
    for number, share in enumerate((0.0, 0.5, 1.0, 1.5)):
        d, j = share * viscous, share * inertia
        by_viscous.append(Line(x, disturbance(c, 0.0, d), f"D = {d:.2g}", SHADES[number], "-", 0.8))
        by_inertia.append(Line(x, disturbance(c, j, viscous), f"J = {j:.2g}", SHADES[number], "-", 0.8))
    last = [
        Line(x, disturbance(c, inertia, viscous), "$T_d$ at the J and D found", WITHOUT, "-", 0.8),
        Line(x, c.friction, "rolling friction found", WITH, "-", 1.2),
    ]
    printed = [Line(x, disturbance(c, *misprint), "", SHADES[-1], "-", 0.8)]
    frames = (
        "(a) as recorded, J = D = 0",
        "(b) D varied, J = 0",
        f"(c) J varied, D = {viscous:.2g}",
        "(d) the end",
        f"(e) J = {misprint[0]:g}, D = {misprint[1]:g}, as printed",
    )
    captions = (
        "The loop begins as an open ellipse.",
        "With the right D upper and lower side run parallel.",
        "With the right J both lie parallel to the axis.",
        "What is left is the rolling friction alone.",
        "The numbers that the paper prints in its steps 2 and 3.",
    )
    return [
        picture(lines, _roomy(lines, title), caption)
        for lines, title, caption in zip((first, by_viscous, by_inertia, last, printed), frames, captions, strict=True)
    ]


def _roomy(lines: list[Line], title: str) -> Frame:
    """Room above the loops for a legend of several."""
    if len(lines) != 4:
        return Frame(_PLACE, _TORQUE, title, legend="center")
    top = float(np.max([np.max(np.abs(line.y)) for line in lines]))
    return Frame(_PLACE, _TORQUE, title, ylim=(-1.1 * top, 1.4 * top), columns=4, legend="upper center")


def condition(c: Columns, model: tuple[float, float], title: str, caption: str) -> Picture:
    """Fig. 10: the loop in another drive condition, at the J and D of the first one."""
    lines = [
        Line(1e3 * c.position, disturbance(c, *model), "$T_d$", WITHOUT, "-", 0.7),
        Line(1e3 * c.position, c.friction, "rolling friction found", WITH, "-", 1.0),
    ]
    return picture(lines, Frame(_PLACE, _TORQUE, title, ylim=(-1.9, 1.9), columns=2, legend="upper center"), caption)


class Course(NamedTuple):
    """One tracking run as it is drawn."""

    label: str
    colour: str
    time: Array  # s
    reference: Array  # m
    error: Array  # m
    current: Array  # A


def references(courses: list[tuple[str, Course]]) -> list[Picture]:
    """Fig. 12."""
    return [
        picture([Line(c.time, 1e3 * c.reference)], Frame(_SECONDS, "reference [mm]", title), "") for title, c in courses
    ]


def errors(title: str, runs: list[Course], ideal: list[Course], steady: tuple[float, float]) -> list[Picture]:
    """Fig. 13, one frequency: all errors, and those with compensation closer (`ideal`: without noise)."""
    whole = [Line(c.time, 1e6 * c.error, c.label, c.colour, "-", 0.9) for c in ideal]
    inside = (ideal[0].time >= steady[0]) & (ideal[0].time < steady[1])
    near = [Line(c.time[inside], 1e9 * c.error[inside], c.label, c.colour, "-", 0.9) for c in ideal[1:]]
    top = 1.7e9 * max(float(np.max(np.abs(c.error[inside]))) for c in runs[1:])
    noisy = [Line(c.time[inside], 1e9 * c.error[inside], c.label, c.colour, "-", 0.7) for c in runs[1:]]
    room = 1.35e6 * float(np.max(np.abs(ideal[0].error)))
    unit = "tracking error"
    return [
        picture(
            whole,
            Frame(
                _SECONDS, f"{unit} [µm]", title, ylim=(-room, room), columns=3, legend="upper center", shaded=(steady,)
            ),
            "",
        ),
        picture(
            near,
            Frame(
                _SECONDS, f"{unit} [nm]", "compensated, no noise", ylim=(-top, top), columns=2, legend="upper center"
            ),
            "",
        ),
        picture(
            noisy,
            Frame(
                _SECONDS, f"{unit} [nm]", "compensated, with noise", ylim=(-top, top), columns=2, legend="upper center"
            ),
            "",
        ),
    ]


def inputs(courses: list[tuple[str, list[Course]]]) -> list[Picture]:
    """Fig. 14."""
    return [
        picture(
            [Line(c.time, c.current, c.label, c.colour, "-", 0.9) for c in runs],
            Frame(_SECONDS, "current [A]", title, columns=3, legend="upper center"),
            "",
        )
        for title, runs in courses
    ]


COLOURS = {
    "none": WITHOUT,
    "conventional": CONVENTIONAL,
    "proposed": WITH,
    "stop operators": "#7c3aed",
    "gms": "#be185d",
    "rheology": "#65a30d",
}
