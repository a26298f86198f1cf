"""Ball-screw paper, sections II to IV.A: response, constant and ultra-low speed (Figs. 2, 5 and 6)."""

from typing import Any

import numpy as np

from stagectl.identification.result import Characteristic
from stagectl.report.figures import embedded
from stagectl.report.methods import conventional as shared
from stagectl.report.page import Picture, Section, Table
from stagectl.report.panels import DPI
from stagectl_studies.reproduction import figures_conventional as figures
from stagectl_studies.reproduction import published
from stagectl_studies.reproduction.ball_screw import SLOW, Evidence
from stagectl_studies.reproduction.ball_screw_characteristics import characteristics
from stagectl_studies.reproduction.ball_screw_curve_fit import best, curve_fit
from stagectl_studies.reproduction.ball_screw_steps import step_response
from stagectl_studies.reproduction.part import Part, percent


def parts(e: Evidence) -> list[Part]:
    """Figs. 2 to 6 and the step response, in their order."""
    before = [_responses(e), characteristics(e), curve_fit(e), step_response(e)]
    return [*before, _constant_speed(e), _ultra_low_speed(e)]


def truth(e: Evidence) -> Characteristic:
    """The machine's own rolling friction: drawn and compared with, never told to a method."""
    own = e.bench.machine.stage.friction.operators
    nothing = np.zeros(0)
    return Characteristic(
        nothing, nothing, np.array(own.weight, dtype=np.float64), np.array(own.slip, dtype=np.float64)
    )


def _responses(e: Evidence) -> Part:
    response, kt = e.response, e.bench.machine.stage.motor.force_constant
    moving = next(fit["viscous"] for fit in response.details["fits"] if fit["of"] == "axis kept moving")
    model = best(e)
    rows: list[list[str]] = []
    numbers: dict[str, Any] = {}
    for curve in response.details["curves"]:
        if curve["moving"]:
            continue
        gain, lead = _over(curve, kt, model)
        name = f"{curve['amplitude']:g} A"
        numbers[name] = {"gain_db_at_1_hz": gain, "phase_lead_deg_at_10_hz": lead}
        rows.append([f"R = {name}", f"{gain:+.1f} dB", f"{lead:+.0f} deg"])
    describing = [row for row in response.details["describing"] if row["frequency"] in (1.0, 3.0)]
    straight = [
        [
            f"{row['frequency']:g} Hz",
            f"{row['viscous']:.4f} ({percent(row['viscous'], published.VISCOUS)})",
            f"{row['coulomb']:.4f}",
        ]
        for row in describing
    ]
    words = [
        "The paper: the response from current to velocity loses gain and gains phase at low frequencies as the "
        "amplitude R of the current gets smaller. Ours does so, too: a stepped sine in open loop at each amplitude. "
        "The paper gives no numbers for this figure, so the table holds ours alone.",
        "With the axis kept moving (a multisine injected while the loop follows a slow move) friction is constant "
        "and falls out: those points lie on the linear model. At low frequencies the loop works against the injected "
        f"current, and they scatter: D comes out as {moving:.3f} ({percent(moving, published.VISCOUS)}), J is "
        "sharp. Above about 50 Hz at small R the axis does not leave presliding, and is a spring.",
        "Friction can be told from damping by its describing function, Re(Kt/H) = D + 4 Tc/(pi W), W the velocity "
        "amplitude: a straight line over the amplitudes at one frequency. The truth is D 0.14, Tc 1.0.",
    ]
    tables = [
        Table("What friction does to the response", ["amplitude", "gain at 1 Hz", "phase at 10 Hz"], rows),
        Table("Describing function", ["frequency", "D [N m s/rad]", "Tc [N m]"], straight),
    ]
    pictures = figures.responses(response.details["curves"], kt, model)
    straight_lines = embedded(shared.describing(response, e.bench.believed.file), DPI)
    pictures.append(Picture(straight_lines, "(d) Friction told from damping by its describing function.", 560))
    numbers["describing"] = [{k: row[k] for k in ("frequency", "viscous", "coulomb")} for row in describing]
    return Part("figure 2", Section("Fig. 2 - Frequency response", words, pictures, tables), numbers)


def _over(curve: dict[str, Any], kt: float, model: tuple[float, float]) -> tuple[float, float]:
    """Gain (dB) next to 1 Hz and phase (deg) next to 10 Hz over those of the linear model."""
    f, sound = np.array(curve["frequency"]), np.array(curve["sound"])
    measured = np.array(curve["gain"]) * np.exp(1j * np.array(curve["phase"]))
    ratio = (measured / figures.linear(f, kt, model))[sound]
    low, high = (int(np.argmin(np.abs(np.log(f[sound] / at)))) for at in (1.0, 10.0))
    return float(20.0 * np.log10(np.abs(ratio[low]))), float(np.degrees(np.angle(ratio[high])))


def _constant_speed(e: Evidence) -> Part:
    p = e.speed.parameters
    viscous = p["viscous"]
    rows = [
        [
            "D [N m s/rad]",
            f"{published.VISCOUS:.2f}",
            f"{viscous.value:.5f}",
            f"{viscous.low:.5f} to {viscous.high:.5f}",
        ],
        ["Tc [N m]", "not given", f"{p['coulomb'].value:.4f}", f"{p['coulomb'].low:.4f} to {p['coulomb'].high:.4f}"],
    ]
    words = [
        f"The paper: the slope of torque over speed is D = 0.14. Ours: {viscous.value:.5f} "
        f"({percent(viscous.value, published.VISCOUS)}), from {len(e.speed.details['spans'])} spans at six speeds both "
        "ways, found in the recording itself. Means are over whole revolutions, as ripple of the motor would bias "
        "them otherwise."
    ]
    section = Section(
        "Fig. 5 - Constant velocity examination",
        words,
        [Picture(embedded(shared.force_over_speed(e.speed, e.bench.believed.file), DPI), "Each point: one span.", 560)],
        [Table("", ["", "paper", "ours", "95 % interval"], rows)],
    )
    return Part("figure 5", section, {name: value._asdict() for name, value in p.items()})


def _ultra_low_speed(e: Evidence) -> Part:
    assert e.slow.table is not None
    scale, own = e.runs[SLOW].scale, truth(e)
    tables = [("model (stop operators)", "-", e.slow.table), ("truth", "--", own)]
    most = 25e-6
    error = table_error(e.slow.table, own, most / scale)
    settled = scale * e.slow.details["settled"]
    loop = figures.slow_loop(e.slow.details["strokes"], e.slow.table, scale)
    pictures = [loop, figures.reversal(e.slow.details["strokes"], tables, scale, most)]
    words = [
        "The paper: a position sine of 50 µm at 0.05 Hz, so slow that inertia and viscous friction vanish, shows a "
        "nonlinear spring within 10 µm of each reversal. Ours: the same motion, two periods in 50 s; "
        f"{100 * _share(e.slow.table, 10e-6 / scale):.0f} % of a full reversal is done within 10 µm, 95 % within "
        f"{1e6 * settled:.1f} µm (the paper's text says 10 µm here and 20 µm in Fig. 10).",
        f"The table differs from the truth by {error['rms']:.4f} N m rms. It is kept as stop operators, which make the "
        "same table and are right for partial reversals and a start from rest, too; the paper's own table of "
        "displacement and force is right for full reversals only.",
    ]
    section = Section("Fig. 6 - Rolling friction characteristic and its model (conventional)", words, pictures, [])
    return Part(
        "figure 6", section, {"settled": settled, "table_error": error, "coulomb": float(e.slow.table.weight.sum())}
    )


def _share(table: Characteristic, displacement: float) -> float:
    """Of a full reversal, done after this displacement (axis units)."""
    force = float(figures.force_after(table, np.array([displacement]))[0])
    total = float(table.weight.sum())
    return (force + total) / (2.0 * total)


def table_error(table: Characteristic, own: Characteristic, most: float) -> dict[str, float]:
    """Difference (N m) of two tables up to `most` (axis units) after a reversal."""
    s = np.linspace(0.0, most, 500)
    difference = figures.force_after(table, s) - figures.force_after(own, s)
    return {"rms": float(np.sqrt(np.mean(difference**2))), "max": float(np.max(np.abs(difference)))}
