"""Ball-screw paper, section IV.A.1: the step response, which it calls unsuitable."""

from stagectl.report.page import Section, Table
from stagectl_studies.reproduction import figures_conventional as figures
from stagectl_studies.reproduction import published
from stagectl_studies.reproduction.ball_screw import MAIN, Evidence
from stagectl_studies.reproduction.part import Part, percent


def step_response(e: Evidence) -> Part:
    """Steps of current from rest, and the first-order model fitted to each."""
    machine = e.bench.machine.stage
    coulomb = float(sum(machine.friction.operators.weight))
    rows, numbers = [], {}
    for step in e.steps:
        factor = 1.0 / (1.0 - coulomb / (machine.motor.force_constant * step.current))
        rows.append(
            [
                f"{step.current:g} A",
                f"{step.inertia:.5f} ({percent(step.inertia, published.INERTIA)})",
                f"{step.viscous:.4f} ({percent(step.viscous, published.VISCOUS)})",
                f"{100.0 * (factor - 1.0):+.0f} %",
            ]
        )
        numbers[f"{step.current:g} A"] = {"inertia": step.inertia, "viscous": step.viscous, "factor": factor}
    words = [
        'The paper, section IV.A.1: "identification using step response is also influenced by nonlinear friction"; '
        "it "
        "shows no figure and no number. Ours: steps of current from rest in open loop, and Kt/(J s + D) fitted to the "
        "position.",
        "Friction takes Tc off the torque as long as the axis moves one way. The response keeps its time constant J/D "
        "and loses height, so the model fits it well with J and D that are both too large, by 1/(1 - Tc/(Kt i)), the "
        "last column. The good fit gives no warning. A larger step errs less; motor and stroke limit it. At the "
        "smallest the friction, which rises while the axis begins to move, spoils the shape, too.",
    ]
    head = ["step", "J [kg m²]", "D [N m s/rad]", "expected of both"]
    pictures = figures.steps(e.steps, machine.motor.force_constant, e.runs[MAIN].scale)
    section = Section("Section IV.A.1 - Step response", words, pictures, [Table("", head, rows)])
    return Part("step response", section, numbers)
