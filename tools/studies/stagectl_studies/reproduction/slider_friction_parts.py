"""Slider paper: Figs. 6 to 10 as parts of a page: the forms, their fits, and what they compensate."""

from typing import Any

import numpy as np

from stagectl.report.figures import TARGET, embedded
from stagectl.report.page import Picture, Section, Table
from stagectl.report.panels import Frame, Line, picture
from stagectl_studies.reproduction import chosen, published
from stagectl_studies.reproduction import figures_slider as figures
from stagectl_studies.reproduction.part import Part
from stagectl_studies.reproduction.slider import COMPENSATIONS, NONE, Evidence, extremes
from stagectl_studies.reproduction.slider_contact import turning
from stagectl_studies.reproduction.slider_forms import CONVENTIONAL, FIRST, FREE, OURS, PAPERS, SECOND

LEAST = 560  # px, of the wide figures
NEAR = 0.12  # s either side of a crossing
NAMES = {**figures.NAMES, FREE: "proposed, first power, Cs free"}


def parts(e: Evidence) -> list[Part]:
    """Figs. 6 to 10, in their order."""
    return [_models(e), _forces(e), _compensation(e)]


def _lines(e: Evidence, over: str, names: tuple[str, ...]) -> list[Line]:
    """Forces of these forms over ``time`` (ms) or ``velocity`` (mm/s), near the crossing."""
    curves = {name: np.asarray(values) for name, values in e.forms.curves.items()}
    near = np.abs(curves["time"]) <= NEAR
    x = 1e3 * curves[over][near]
    return [Line(x, curves[name][near], NAMES[name], figures.COLOURS[name]) for name in names]


def _models(e: Evidence) -> Part:
    frame = Frame("time from the zero crossing [ms]", "friction [N]", ylim=(-6.5, 6.5))
    pictures = [
        picture(
            _lines(e, "time", (FIRST, SECOND)),
            frame._replace(title="Fig. 6: proposed"),
            "Continuous; with the force at zero velocity it assists the motion behind the crossing.",
        ),
        picture(
            _lines(e, "time", (CONVENTIONAL,)),
            frame._replace(title="Fig. 7: conventional"),
            "The same size on both sides of the crossing, where it jumps.",
        ),
    ]
    words = [
        "The paper's equations are not in the text that we have; these are a reconstruction from its description, "
        "drawn "
        "with the values fitted below. Proposed: continuous, exponential on both sides, three parameters t1, t2 and "
        "Cs. Behind the crossing the text allows a first power, exp(-t/t2), and a second, exp(-(t/t2)²); Fig. 8 tells "
        "them apart. Conventional: Tustin's with Stribeck's exponential, symmetric about the crossing.",
        "The conventional form is fitted to the rows before the crossing. A function of the speed can hold only where "
        "the axis slides; behind the crossing the guide is a spring. The paper's two forms agree before the crossing, "
        "too (Fig. 8). Fitted to all rows it degenerates: its Stribeck rise vanishes, or becomes a dip.",
    ]
    return Part("figures 6 and 7", Section("Figs. 6 and 7 - Friction models", words, pictures, []), {})


def _forces(e: Evidence) -> Part:
    share = {name: form.residual / e.forms.friction for name, form in e.forms.forms.items()}
    words = [
        "The paper: the forms' three parameters are found by a genetic algorithm; its proposed form is the same as the "
        "force, the conventional one is far from it where the velocity changes its direction. It gives no values. "
        "Ours: "
        "differential evolution on F - M a - D v, never on the raw force, where M a is as large as what is sought.",
        "Friction in presliding is a spring, whose force leaves the crossing flatly. A first power leaves it steeply: "
        f"{100 * share[FIRST]:.0f} % of the friction is left over. Free to do so, its fit makes up for that by a force "
        "at zero velocity that no one saw; it is kept near the largest force seen. With the second power "
        f"{100 * share[SECOND]:.0f} % is left. On a guide that springs as in Fig. 5 the paper's statement "
        "fits the second power only. As a function of the displacement the same idea holds at other accelerations, "
        "too.",
    ]
    measured = {"time": "time from the zero crossing [ms]", "velocity": "velocity [mm/s]"}
    images = [
        _compared(
            e, over, Frame(label, "friction [N]", f"Fig. {number}", ylim=(-6.5, 9.5), columns=2, legend="upper center")
        )
        for (over, label), number in zip(measured.items(), (8, 9), strict=True)
    ]
    tables = [_fits(e), _searches(e)]
    section = Section("Figs. 8 and 9 - Real and estimated force at 10 mm/s", words, images, tables)
    return Part("figures 8 and 9", section, _fit_numbers(e))


def _compared(e: Evidence, over: str, frame: Frame) -> Picture:
    near = np.abs(np.asarray(e.forms.curves["time"])) <= NEAR
    x, force = (np.asarray(e.forms.curves[name])[near] for name in (over, "friction"))
    measured = Line(1e3 * x, force, "measured: F - M a - D v", TARGET, "-", 2.4)
    return picture([measured, *_lines(e, over, (CONVENTIONAL, FIRST, SECOND, OURS))], frame, f"Over {over}.")


def _fits(e: Evidence) -> Table:
    rows = []
    for name, form in e.forms.forms.items():
        values = form.form._asdict()
        share = 100.0 * form.residual / e.forms.friction
        rows.append([NAMES[name], _shapes(values), f"{values['static']:.2f}", f"{form.residual:.3f}", f"{share:.0f} %"])
    return Table("Values", ["form", "shapes", "Cs [N]", "residual rms [N]", "of the friction"], rows)


def _shapes(values: dict[str, float]) -> str:
    """t1 and t2, or the lengths of the displacement form."""
    if "slip" in values:
        return f"vs {1e3 * values['velocity']:.1f} mm/s, delta {1e6 * values['slip']:.1f} µm"
    shapes = [f"t1 {1e3 * values['before']:.1f} ms"]
    return ", ".join([*shapes, f"t2 {1e3 * values['after']:.1f} ms"] if "after" in values else shapes)


def _searches(e: Evidence) -> Table:
    rows = []
    for name in PAPERS:
        form = e.forms.forms[name]
        assert form.genetic is not None
        for label, search in (
            ("differential evolution, then L-BFGS-B", form.today),
            ("genetic algorithm", form.genetic),
        ):
            rows.append([NAMES[name], label, f"{search.cost:.4f}", f"{search.evaluations}", f"{search.seconds:.1f} s"])
    title = (
        "The paper's genetic algorithm beside the optimiser of today; of the paper's the text gives the name only "
        "(here: "
        f"binary strings of {chosen.BITS} digits, {chosen.POPULATION} of them, {chosen.GENERATIONS} generations)"
    )
    return Table(title, ["form", "search", "cost: rms of the fitted rows [N]", "costs computed", "time"], rows)


def _fit_numbers(e: Evidence) -> dict[str, Any]:
    numbers: dict[str, Any] = {}
    for name, form in e.forms.forms.items():
        searches = {"today": form.today, "genetic": form.genetic}
        costs = {key: search._asdict() for key, search in searches.items() if search is not None}
        numbers[name] = {**form.form._asdict(), "residual_rms": form.residual, "searches": costs}
    return numbers


def _um(value: float) -> str:
    return f"{1e6 * value:+.1f} µm"


def _compensation(e: Evidence) -> Part:
    fastest = list(dict.fromkeys(speed for speed, _ in e.errors))[-1]
    turns = {form: extremes(errors) for (speed, form), errors in e.turns.items() if speed == fastest}
    shown = [form for form in COMPENSATIONS if form in turns]
    runs = [figures.Compensated(form, e.compensated[fastest, form].samples, e.turns[fastest, form]) for form in shown]
    words = [
        "The paper, velocity feedforward 1: -4.7 µm without compensation, -2.4 µm with the proposed form, and a "
        "positive error of +1.5 µm with the conventional one: the work piece would be excessively cut. Ours: "
        "negative, the axis lags behind after the reversal; positive, it leads. Errors are taken within the ramps of "
        f"the reversal. At their ends the reference's acceleration jumps, which alone gives {_um(_jump(e, fastest))}, "
        "with or without compensation.",
        "The proposed form, first power: it falls faster than the guide's spring lets go, so the axis leads by "
        f"{_um(turns[FIRST][1])}. A slower decay trades that lead for a lag, from which the loop swings back. "
        "Second power: at the crossing it leads little more than the run without compensation does "
        f"({_um(turns[NONE][1])}); its largest lead, {_um(turns[SECOND][1])}, comes some 50 ms later, as the loop "
        "swings back: in the new direction the form knows no Stribeck rise. That is not quite the paper's suppression.",
        "Our lag with the proposed form is smaller than the paper's -2.4 µm, as our stage repeats itself and the fit "
        "is "
        "of the same motion. The conventional form gives more positive error than in the paper: it jumps from +Cs to "
        "-Cs "
        "at the crossing, while a guide of 40 Hz and some 5 kg is still a spring for 30 ms. How far that throws the "
        "axis depends on loop and stiffness; the paper states neither.",
    ]
    image = Picture(
        embedded(figures.compensation(runs, turning(e.compensated[fastest, NONE]))),
        f"Velocity and position error at {fastest} mm/s.",
        LEAST,
    )
    tables = [_table(turns, fastest), _other_speeds(e, fastest)]
    section = Section("Fig. 10 - Compensation", words, [image], [table for table in tables if table.rows])
    return Part("figure 10", section, {**_error_numbers(e), "paper": _paper()})


def _jump(e: Evidence, speed: str) -> float:
    """Largest lead (m) without compensation, ends of the ramps included."""
    return extremes(e.errors[speed, NONE])[1]


def _table(turns: dict[str, tuple[float, float]], speed: str) -> Table:
    paper = {
        NONE: _um(published.ERROR_NONE),
        FIRST: f"{_um(published.ERROR_PROPOSED)}, positive error suppressed",
        SECOND: f"{_um(published.ERROR_PROPOSED)}, positive error suppressed",
        CONVENTIONAL: f"{_um(published.POSITIVE_CONVENTIONAL)} of positive error",
    }
    bare = turns[NONE][0]
    rows = []
    for form, (low, high) in turns.items():
        below = f"{100 * (1 - low / bare):.0f} %" if form != NONE else ""
        rows.append([NAMES[form], paper.get(form, ""), _um(low), _um(high), below])
    head = ["compensation", "paper, Fig. 10", "ours, negative", "ours, positive", "lag cut by"]
    return Table(f"Position error at the reversals, {speed} mm/s", head, rows)


def _error_numbers(e: Evidence) -> dict[str, Any]:
    numbers: dict[str, Any] = {}
    for (speed, form), errors in e.errors.items():
        (low, high), (turn_low, turn_high) = extremes(errors), extremes(e.turns[speed, form])
        turn = {"negative": turn_low, "positive": turn_high}
        numbers[f"{speed} mm/s, {form}"] = {"negative": low, "positive": high, "within the ramps": turn}
    return numbers


def _paper() -> dict[str, float]:
    return {
        "none": published.ERROR_NONE,
        "proposed": published.ERROR_PROPOSED,
        "conventional, positive": published.POSITIVE_CONVENTIONAL,
    }


def _other_speeds(e: Evidence, fastest: str) -> Table:
    rows = [
        [f"{speed} mm/s, {NAMES[form]}", *(_um(value) for value in extremes(errors))]
        for (speed, form), errors in e.turns.items()
        if speed != fastest
    ]
    return Table(f"The same forms, fitted at {fastest} mm/s, at other speeds", ["", "negative", "positive"], rows)
