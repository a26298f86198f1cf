"""Ball-screw paper, section III: what friction depends on (Fig. 3)."""

import numpy as np

from stagectl.report.page import Section, Table
from stagectl_studies.reproduction import chosen
from stagectl_studies.reproduction import figures_conventional as figures
from stagectl_studies.reproduction.ball_screw import SLOW, Evidence
from stagectl_studies.reproduction.part import Part, percent

SMOOTH = 201  # samples, 0.1 s: of the ultra-low-speed torque, for the eye only
EQUATION = ("D [N m s/rad]", "Tc [N m]", "Ts [N m]", "alpha [s/rad]")


def characteristics(e: Evidence) -> Part:
    parameters, capture = e.speed.parameters, e.captures[SLOW][0]
    torque = np.convolve(
        e.bench.machine.stage.motor.force_constant * capture.current, np.full(SMOOTH, 1.0 / SMOOTH), mode="same"
    )
    inside = slice(SMOOTH, -SMOOTH, 20)
    scale = e.runs[SLOW].scale
    pictures = figures.characteristics(
        e.speed.details["spans"],
        (parameters["viscous"].value, parameters["coulomb"].value),
        (scale * capture.position[inside], torque[inside]),
        e.stribeck,
    )
    settled = scale * e.slow.details["settled"]
    fitted, truth = e.stribeck.fitted, e.stribeck.truth
    words = [
        "The paper's drawings of what friction depends on: velocity (its equation with Coulomb friction Tc, static "
        "friction Ts and the Stribeck effect) and displacement after a reversal; it gives no values. Ours are measured "
        "on the virtual stage. The paper takes the Stribeck effect to matter at ultra-low speed only; stage A is built "
        "without it (b). For (a) the same stage has one, chosen, and runs at constant speeds from "
        f"{chosen.STRIBECK_SPEEDS[0]:g} to {chosen.STRIBECK_SPEEDS[-1]:g} mm/s.",
        "The paper's width of the unstable region, here the displacement at which 95 % of a full reversal is done: "
        f"{1e6 * settled:.1f} µm.",
    ]
    rows = [
        [name, f"{value:.4f}", f"{true:.4f}", percent(value, true)]
        for name, value, true in zip(EQUATION, fitted, truth, strict=True)
    ]
    table = Table("The paper's equation, fitted to the points of (a)", ["", "fitted", "truth", "deviation"], rows)
    numbers = {"settled": settled, "stribeck": {"fitted": fitted._asdict(), "truth": truth._asdict()}}
    return Part("figure 3", Section("Fig. 3 - Friction characteristics", words, pictures, [table]), numbers)
