"""Ball-screw paper, section IV.A.1: a first-order curve fitted to the frequency response (Fig. 4)."""

from typing import Any

import numpy as np
from scipy import optimize

from stagectl.identification.response import fits
from stagectl.identification.response.lines import Curve, curves
from stagectl.identification.response.method import joined_curve
from stagectl.report.figures import WITH, WITHOUT
from stagectl.report.page import Section, Table
from stagectl.report.panels import CONVENTIONAL
from stagectl_studies.reproduction import figures_conventional as figures
from stagectl_studies.reproduction import published
from stagectl_studies.reproduction.ball_screw import Evidence
from stagectl_studies.reproduction.part import Part

BANDS = (50.0, 100.0, 150.0, 200.0)  # Hz, highest line of a curve fit
SLIDING = 20.0  # Hz, up to which every amplitude of Fig. 2 leaves presliding
LAGS = (0.0, 0.25e-3, 0.5e-3)  # s, left in the response
LONGEST_LAG, LAG_STEP = 2e-3, 0.05e-3  # s, of the search for the lag that gives the paper's D


def curve_fit(e: Evidence) -> Part:
    file = e.bench.believed.file
    kt = file.motor.force_constant
    curve = list(_still(e).values())[-1]
    rows, numbers, drawn = [], {}, []
    for name, colour, fit in (
        ("curve fit to the gain", WITHOUT, fits.gain_curve(fits.lines([curve], kt))),
        ("with friction in the model", WITH, None),
    ):
        values = best(e) if fit is None else (float(fit.values[0]), float(fit.values[1]))
        numbers[name] = {"inertia": values[0], "viscous": values[1]}
        drawn.append((f"{name}: D = {values[1]:.3f}", colour, values))
        rows.append([name, f"{values[0]:.5f}", f"{values[1]:.4f}"])
    drawn.append(
        ("paper: D = 0.10", CONVENTIONAL, (published.INERTIA, published.VISCOUS_CURVE_FIT)),
    )
    rows.append(["paper, Fig. 4", f"{published.INERTIA:.3f}", f"{published.VISCOUS_CURVE_FIT:.2f}"])
    rows.append(["paper, constant speed; truth here", f"{published.INERTIA:.3f}", f"{published.VISCOUS:.2f}"])
    lagged, numbers["lag left in"] = _lags(curve, kt)
    written = next(line for line in reversed(e.response.details["curves"]) if not line["moving"])
    by_size, numbers["by amplitude"] = _amplitudes(e, kt)
    words = [
        "The paper: fitting Kt/(J s + D) to the response at R = 9 gives J 0.010 and D 0.10, where constant speed gives "
        "D 0.14. Ours, fitted to the gain at the largest amplitude, errs the other way: friction adds 4 Tc/(pi W) to "
        "what looks like damping, so D comes out too high, and higher the smaller R is (second table). "
        "Friction beside D opposes the motion at every speed, so Coulomb, Stribeck and rolling friction can only add.",
        "What can bring the paper's D: a lag that is left in the response. Least squares on Kt/H reads D from its real "
        "part, from which a lag takes away J w² times the lag: the higher the band, the more. The third table gives D "
        "by band and lag, and the lag at which it comes to 0.10: with lines beyond 100 Hz some tenths of a "
        "millisecond, as of a control "
        "period and a current loop. The paper states neither its band nor its lag, and nothing in the plant was tuned "
        "to meet its figure.",
        "Told apart from friction by sines at several amplitudes, and with the delay fitted, D is right.",
    ]
    tables = [
        Table("", ["fit", "J [kg m²]", "D [N m s/rad]"], rows),
        Table("Curve fit to the gain, by amplitude", ["R", "J [kg m²]", "D [N m s/rad]"], by_size),
        Table(
            "D by linear least squares on Kt/H, R = 9 A, with a lag left in the response",
            ["lines up to", *(f"{1e3 * lag:g} ms" for lag in LAGS), "lag that gives 0.10"],
            lagged,
        ),
    ]
    section = Section("Fig. 4 - Curve fitting", words, figures.curve_fit(written, kt, drawn), tables)
    return Part("figure 4", section, numbers)


def best(e: Evidence) -> tuple[float, float]:
    """Inertia and viscous friction of the fit to all sines that knows of friction."""
    row = next(fit for fit in e.response.details["fits"] if fit["name"] == "friction-corrected")
    return float(row["inertia"]), float(row["viscous"])


def _still(e: Evidence) -> dict[float, Curve]:
    """The responses from rest by amplitude (A), smallest first."""
    file = e.bench.believed.file
    every = [curve for name in e.captures if name.startswith("frf-") for curve in curves(e.captures[name][0], file)[0]]
    still = [curve for curve in every if not curve.moving]
    sizes = sorted({curve.amplitude for curve in still})
    return {size: joined_curve([curve for curve in still if curve.amplitude == size]) for size in sizes}


def _amplitudes(e: Evidence, kt: float) -> tuple[list[list[str]], dict[str, Any]]:
    """The fit to the gain at each amplitude, over the band in which every one of them slides."""
    rows, numbers = [], {}
    for size, curve in _still(e).items():
        inertia, viscous = map(float, fits.gain_curve(fits.lines([_below(curve, SLIDING)], kt)).values[:2])
        rows.append([f"{size:g} A", f"{inertia:.5f}", f"{viscous:.3f}"])
        numbers[f"{size:g} A"] = {"inertia": inertia, "viscous": viscous}
    return rows, numbers


def _below(curve: Curve, band: float) -> Curve:
    """Its lines up to `band` (Hz)."""
    keep = curve.frequency <= 1.001 * band
    names = ("frequency", "response", "deviation", "coherence", "velocity", "relay")
    return curve._replace(**{name: getattr(curve, name)[keep] for name in names})


def _lags(curve: Curve, kt: float) -> tuple[list[list[str]], dict[str, Any]]:
    """D by linear least squares over bands (rows) and lags left in (columns), and the lag for the paper's D."""
    rows, numbers = [], {}
    for band in BANDS:
        within = _below(curve, band)
        if np.sum(within.sound) < 3:
            continue
        lines = fits.lines([within], kt)
        viscous = [_viscous(lines, lag) for lag in LAGS]
        needed = _lag_for(lines, published.VISCOUS_CURVE_FIT)
        rows.append([f"{band:g} Hz", *(f"{value:+.3f}" for value in viscous), f"{1e3 * needed:.2f} ms"])
        by_lag = dict(zip((f"{1e3 * lag:g} ms" for lag in LAGS), viscous, strict=True))
        numbers[f"{band:g} Hz"] = {**by_lag, "lag for 0.10": needed}
    return rows, numbers


def _viscous(lines: fits.Lines, lag: float) -> float:
    return float(fits.linear(lines, lag).values[1])


def _lag_for(lines: fits.Lines, viscous: float) -> float:
    """The least lag (s) at which D comes down to `viscous`; long lags turn the response round, and D comes back."""
    tried = np.arange(0.0, LONGEST_LAG, LAG_STEP)
    below = int(np.argmax([_viscous(lines, lag) < viscous for lag in tried]))
    return float(optimize.brentq(lambda lag: _viscous(lines, lag) - viscous, tried[below - 1], tried[below]))
