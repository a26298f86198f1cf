"""Ball-screw paper, section V: references, tracking errors and inputs (Figs. 12 to 14)."""

import numpy as np

from stagectl.number_format import length
from stagectl.report.page import Section, Table
from stagectl_studies.reproduction import figures_proposed as figures
from stagectl_studies.reproduction.ball_screw import Evidence
from stagectl_studies.reproduction.bench import NOISE, Run
from stagectl_studies.reproduction.part import Part
from stagectl_studies.reproduction.tracking import CONTROLLERS, numbers


def parts(e: Evidence) -> list[Part]:
    """Figs. 12 to 14."""
    return [_references(e), _errors(e), _inputs(e)]


def _title(motion: str) -> str:
    return motion.removeprefix("sine-").removesuffix("hz") + " Hz"


def _course(run: Run, controller: str) -> figures.Course:
    s = run.samples
    reference = np.asarray(s["reference"] * run.scale, dtype=np.float64)
    colour = figures.COLOURS[controller]
    return figures.Course(controller, colour, s["time"], reference, run.error(), s["current"])


def _references(e: Evidence) -> Part:
    t = e.tracking
    pictures = figures.references([(_title(motion), _course(t.quiet[motion, "none"], "none")) for motion in t.motions])
    sizes = {
        motion: float(np.max(np.abs(t.quiet[motion, "none"].samples["reference"]))) * t.quiet[motion, "none"].scale
        for motion in t.motions
    }
    words = [
        "The paper: sines of 3.2, 1.6 and 0.8 Hz; their amplitudes are in its figure only. Ours: "
        f"{', '.join(f'{1e3 * size:.0f} mm at {_title(motion)}' for motion, size in sizes.items())}, faded in and out "
        "over a period each."
    ]
    return Part("figure 12", Section("Fig. 12 - Target trajectory", words, pictures, []), {"amplitude": sizes})


def _errors(e: Evidence) -> Part:
    t, errors = e.tracking, numbers(e.tracking)
    pictures, rows = [], []
    for motion in t.motions:
        quiet, noisy = (
            [_course(runs[motion, controller], controller) for controller in CONTROLLERS] for runs in (t.quiet, t.noisy)
        )
        pictures += figures.errors(_title(motion), noisy, quiet, t.quiet[motion, "none"].plan.steady)
        for noise, row in errors[motion].items():
            cells = [length(row[controller]["peak"], "m") for controller in CONTROLLERS]
            cells[1:] = [
                f"{cell} ({row[c]['times_lower']:.0f})" for c, cell in zip(CONTROLLERS[1:], cells[1:], strict=True)
            ]
            rows.append([f"{_title(motion)}, {noise}", *cells])
    head = ["", *CONTROLLERS]
    words = [
        "The paper: PID at 40 Hz by pole placement and perfect tracking feedforward, both from the identified J and D, "
        "without friction compensation, with the conventional characteristic (Fig. 6) and with the proposed one (Fig. "
        "9), both as a data-based table over the displacement since reversal; both reduce the reversal peaks alike. "
        "Its text gives no numbers. Ours: the same three, from the J and D of the simultaneous identification; nothing "
        "here knows the truth.",
        "Next to them the other models that the paper names, from the same identification: stop operators, GMS (the "
        "same here, as this stage has no Stribeck curve), and the rheology model, fitted to the curve.",
        "Shown: all without noise; then the compensated ones closer, without noise and with "
        f"{NOISE} A rms of noise on the motor current, which the loop can only partly reject. Shaded: where the "
        "error is taken.",
        "Without noise what remains is of the size of the encoder's step, 11.4 nm, but for the rheology model, whose "
        "two parameters do not follow the curve as closely. A real stage has torque ripple, a flexible coupling and "
        "friction that changes along its travel, which this plant has not: do not expect such small errors of it.",
    ]
    table = Table("Peak of the tracking error at full amplitude (how many times lower)", head, rows)
    return Part("figure 13", Section("Fig. 13 - Tracking error", words, pictures, [table]), errors)


def _inputs(e: Evidence) -> Part:
    t, errors = e.tracking, numbers(e.tracking)
    courses = [(_title(motion), [_course(t.quiet[motion, c], c) for c in ("none", "proposed")]) for motion in t.motions]
    peaks = {
        motion: {c: errors[motion]["without noise"][c]["peak_current"] for c in CONTROLLERS} for motion in t.motions
    }
    words = [
        "The paper: the currents of the three. Ours, without noise: friction compensation changes the current's sign "
        "of friction at the reversal at once, where without it the feedback must first see an error.",
        "Largest current: "
        + ", ".join(f"{peaks[motion]['proposed']:.2f} A at {_title(motion)}" for motion in t.motions)
        + ".",
    ]
    section = Section("Fig. 14 - Control input", words, figures.inputs(courses), [])
    return Part("figure 14", section, {"peak_current": peaks})
