"""Slider paper: Figs. 3 to 10 as parts of a page, ours beside the paper's numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from stagectl.report.figures import WITH, WITHOUT, embedded
from stagectl.report.methods.zero_crossing import NAMES, forces_over
from stagectl.report.page import Picture, Section, Table
from stagectl.report.panels import Frame, Line, picture
from stagectl_studies.reproduction import figures_slider as figures
from stagectl_studies.reproduction import published
from stagectl_studies.reproduction.bench import Run
from stagectl_studies.reproduction.part import Part
from stagectl_studies.reproduction.slider import COMPENSATIONS, FREE, NONE, Evidence, extremes, opened

LEAST = 560  # px, of the wide figures
WORDS = {
    NONE: "none",
    "symmetric": "conventional, Cs kept physical",
    FREE: "conventional, Cs free",
    "exponential": "proposed, Cs kept physical",
    "displacement": "displacement form (ours)",
}


def parts(e: Evidence) -> list[Part]:
    """Figs. 3 to 10, in their order."""
    return [_stroke_end(e), _standstill(e), _release(e), _models(e), _forces(e), _compensation(e)]


def _shown(e: Evidence, run: Run, label: str, instant: float) -> figures.ShownRun:
    return figures.ShownRun(label, run.samples, instant, e.bench.machine.stage.motor.force_constant)


def _turn(run: Run) -> float:
    """First change of the reference's direction (s)."""
    v = run.samples["velocity"]
    return float(run.samples["time"][np.flatnonzero((v[:-1] > 0.0) & (v[1:] <= 0.0))[0] + 1])


def _um(value: float) -> str:
    return f"{1e6 * value:+.1f} µm"


def _stroke_end(e: Evidence) -> Part:
    runs = [_shown(e, run, f"{speed} mm/s", _turn(run)) for speed, run in e.reversals.items()]
    force = {
        speed: float(np.interp(_turn(run), run.samples["time"], run.samples["measured_current"]))
        * e.bench.machine.stage.motor.force_constant
        for speed, run in e.reversals.items()
    }
    words = [
        "The paper: around the end of a stroke the output force differs with the speed before it, does not fall as the "
        "axis slows down, and changes its direction behind the reversal: friction goes on assisting the motion for a "
        "while. Velocity feedforward is 0. The paper gives no numbers here.",
        "Where ours differ: the paper's forces at zero velocity differ from speed to speed. Ours are nearly the "
        "same, as the virtual guide does not depend on time and all three are slowed down at 0.1 m/s²; what remains "
        "is the loop.",
        "Ours: on the way to the reversal the force stays high, as Stribeck's rise makes up for the viscous part, and "
        "goes over to the other sign within the presliding distance. Force at the reversal: "
        + ", ".join(f"{value:.2f} N at {speed} mm/s" for speed, value in force.items())
        + ", M a included.",
    ]
    image = Picture(
        embedded(figures.stroke_end(runs, (-0.15, 0.2))), "Velocity and output force (calculated, Kt i).", LEAST
    )
    return Part("figure 3", Section("Fig. 3 - Stroke end", words, [image], []), {"force_at_reversal": force})


def _standstill(e: Evidence) -> Part:
    stops = [_shown(e, run, f"{speed} mm/s", _turn(run)) for speed, run in e.stops.items()]
    rows = [
        [f"{speed} mm/s", f"{published.HOLDING_FORCE} N", f"{result.value:.2f} N"]
        for speed, result in e.holding.items()
    ]
    words = [
        "The paper: the force falls while the axis slows down, and about 5.3 N keep it at zero velocity. Ours: it "
        "falls by M a, 0.6 N, and the axis then stands for 0.2 s behind each stroke. That the force is 5.3 N at "
        "every speed is how the stage was built (4.5 N of rolling friction and Stribeck's rise), so it confirms the "
        "model, not the paper."
    ]
    image = Picture(
        embedded(figures.stroke_end(stops, (-0.15, 0.15), "stop")), "Slowing down to a standstill and standing.", LEAST
    )
    table = Table("Force at zero velocity", ["speed before", "paper", "ours"], rows)
    numbers = {speed: {"ours": result.value, "paper": published.HOLDING_FORCE} for speed, result in e.holding.items()}
    return Part("figure 4", Section("Fig. 4 - Zero velocity", words, [image], [table]), numbers)


def _release(e: Evidence) -> Part:
    runs = [_shown(e, run, f"{speed} mm/s before", opened(run)) for speed, run in e.releases.items()]
    low, high = published.RELEASE_TRAVEL
    rows, numbers = [], {}
    for speed, result in e.ringing.items():
        f = result.frequency
        rows.append(
            [
                f"{speed} mm/s",
                f"{f.value:.2f} Hz",
                f"{1e6 * abs(result.offset):.1f} µm",
                f"{1e6 * result.travel:.1f} µm",
            ]
        )
        numbers[speed] = {"frequency": f.value, "offset": result.offset, "travel": result.travel}
    rows.append(["paper", f"{published.VIBRATION:g} Hz", f"{1e6 * low:.0f} to {1e6 * high:.0f} µm", ""])
    words = [
        "The paper: the output force is set to zero and the guide springs back: up to 20 µm (2000 pulses), more than "
        "15 µm, with a free vibration of 40 Hz that does not depend on the force. Ours: the same. In the paper the "
        "displacement is larger at low speeds; ours is the same at all, as the axis stands before it is let go and "
        "the model then has forgotten its speed.",
        "The travel is taken to where the axis comes to rest; the first swing goes further. The paper does not say "
        "which of the two it means.",
    ]
    image = Picture(embedded(figures.release(runs)), "Position from where the force was set to zero.", LEAST)
    table = Table("", ["speed before", "frequency", "back to rest", "first swing"], rows)
    return Part(
        "figure 5",
        Section("Fig. 5 - Spring-like behaviour at zero force", words, [image], [table]),
        {**numbers, "paper": {"frequency": published.VIBRATION, "travel": [low, high]}},
    )


def _models(e: Evidence) -> Part:
    curves = {name: np.asarray(values) for name, values in e.identified.details["curves"].items()}
    near = np.abs(curves["time"]) <= 0.12
    t = 1e3 * curves["time"][near]
    frame = Frame("time from the zero crossing [ms]", "friction [N]", ylim=(-6.5, 6.5))
    pictures = [
        picture(
            [Line(t, curves["exponential"][near], "", WITH)],
            frame._replace(title="Fig. 6: proposed"),
            "Continuous; with the force at zero velocity it assists the motion behind the crossing.",
        ),
        picture(
            [
                Line(t, curves["symmetric-free"][near], "Cs free", "#ca8a04", "--"),
                Line(t, curves["symmetric"][near], "Cs kept physical", WITHOUT),
            ],
            frame._replace(title="Fig. 7: conventional"),
            "Symmetric about zero speed; with a physical Cs it jumps.",
        ),
    ]
    words = [
        "The paper's equations are not in the text that we have; these are a reconstruction from its description "
        "(continuous, exponential on both sides, three parameters t1, t2 and Cs; Tustin's with Stribeck's as the "
        "conventional one), drawn with the values fitted below.",
    ]
    return Part("figures 6 and 7", Section("Figs. 6 and 7 - Friction models", words, pictures, []), {})


def _forces(e: Evidence) -> Part:
    details = e.identified.details
    rows, numbers = [], {}
    for name, form in details["forms"].items():
        for bounds, fit in (("physical", form), ("free", form.get("unbounded"))):
            if fit is None:
                continue
            rows.append([NAMES[name], bounds, *_fit_cells(name, fit)])
            values = {key: value["value"] for key, value in fit["parameters"].items()}
            numbers[f"{name}, Cs {bounds}"] = {**values, "residual_rms": fit["residual_rms"]}
    words = [
        "The paper: the forms' three parameters are found by a genetic algorithm; its proposed form follows the force, "
        "the conventional one is far from it where the velocity changes its direction. It gives no values. Ours: "
        "differential evolution on F - M a - D v, never on the raw force, where M a is as large as what is sought.",
        "The proposed form is far better than the conventional one here, too, but not the same as the force: "
        "friction in presliding is a spring, whose force leaves the crossing flatly, while an exponential leaves it "
        "steeply. Free to do so, the fit makes up for that by a force at zero velocity that no one saw (8 N); it is "
        "kept near the largest force seen. As a function of the displacement the same idea fits, and holds at other "
        "accelerations.",
    ]
    head = ["form", "Cs", "shapes", "Cs [N]", "residual rms [N]", "of the friction"]
    images = [
        Picture(embedded(forces_over(over, details)), f"Over {over}, Fig. {number}.")
        for over, number in (("time", 8), ("velocity", 9))
    ]
    section = Section("Figs. 8 and 9 - Real and estimated force at 10 mm/s", words, images, [Table("", head, rows)])
    return Part("figures 8 and 9", section, numbers)


def _fit_cells(name: str, fit: dict[str, Any]) -> list[str]:
    p = {key: parameter["value"] for key, parameter in fit["parameters"].items()}
    shapes = {
        "displacement": f"vs {1e3 * p.get('velocity', 0.0):.2f} mm/s, delta {1e6 * p.get('slip', 0.0):.1f} µm",
        "symmetric": f"t1 {1e3 * p.get('before', 0.0):.1f} ms",
    }.get(name, f"t1 {1e3 * p.get('before', 0.0):.1f} ms, t2 {1e3 * p.get('after', 0.0):.1f} ms")
    return [shapes, f"{p['static']:.2f}", f"{fit['residual_rms']:.3f}", f"{fit['residual_percent']:.1f} %"]


def _compensation(e: Evidence) -> Part:
    fastest = list(dict.fromkeys(speed for speed, _ in e.errors))[-1]
    rows, numbers = [], {}
    bare = abs(extremes(e.errors[fastest, NONE])[0])
    paper = {
        NONE: _um(published.ERROR_NONE),
        "exponential": _um(published.ERROR_PROPOSED),
        "symmetric": f"{_um(published.POSITIVE_CONVENTIONAL)} of positive error",
    }
    for (speed, form), errors in e.errors.items():
        low, high = extremes(errors)
        numbers[f"{speed} mm/s, {form}"] = {"negative": low, "positive": high}
        if speed == fastest:
            below = f"{100 * (1 - abs(low) / bare):.0f} %" if form != NONE else ""
            rows.append([WORDS[form], paper.get(form, ""), _um(low), _um(high), below])
    shown = [form for form in COMPENSATIONS if (fastest, form) in e.errors]
    runs = [
        figures.Compensated("" if form == NONE else form, e.compensated[fastest, form].samples, e.errors[fastest, form])
        for form in shown
    ]
    words = [
        "The paper, velocity feedforward 1: -4.7 µm without compensation, -2.4 µm with the proposed form, and a "
        "positive error of +1.5 µm with the conventional one: the work piece would be excessively cut. Ours: "
        "negative, the axis lags behind after the reversal; positive, it leads.",
        "The proposed form cuts the lag by more than the paper's half, as our stage repeats itself and the fit is of "
        "the same motion. Its positive error is below the paper's conventional one, but not gone: the price of the "
        "physical Cs. The conventional form gives more positive error than in the paper: it jumps from +Cs to -Cs at "
        "the crossing, and how far that is wrong depends on how stiff the guide is. Left free, its search prefers a "
        "dip to nearly zero force at the crossing, which brings its positive error nearer to the paper's.",
        "The displacement form is not in the paper. Of what it leaves, the positive part is hardly more than the "
        f"{_um(extremes(e.errors[fastest, NONE])[1])} of the run without compensation: that much is from the jumps of "
        "the reference's acceleration.",
    ]
    image = Picture(
        embedded(figures.compensation(runs, _turn(e.compensated[fastest, NONE]))),
        f"Velocity and position error at {fastest} mm/s.",
        LEAST,
    )
    head = ["compensation", "paper", "ours, negative", "ours, positive", "lag cut by"]
    tables = [Table(f"Position error at the reversals, {fastest} mm/s", head, rows), _other_speeds(e, fastest)]
    section = Section("Fig. 10 - Compensation", words, [image], [table for table in tables if table.rows])
    return Part("figure 10", section, {**numbers, "paper": _paper()})


def _paper() -> dict[str, float]:
    return {
        "none": published.ERROR_NONE,
        "proposed": published.ERROR_PROPOSED,
        "conventional, positive": published.POSITIVE_CONVENTIONAL,
    }


def _other_speeds(e: Evidence, fastest: str) -> Table:
    rows = [
        [f"{speed} mm/s, {WORDS[form]}", *(_um(value) for value in extremes(errors))]
        for (speed, form), errors in e.errors.items()
        if speed != fastest
    ]
    return Table(f"The same forms, fitted at {fastest} mm/s, at other speeds", ["", "negative", "positive"], rows)
