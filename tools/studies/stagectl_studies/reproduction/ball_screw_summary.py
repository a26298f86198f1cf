"""The ball-screw paper, figure by figure: what it states, what comes out here, and why they differ."""

from typing import Any

from stagectl.number_format import length
from stagectl_studies.reproduction import published
from stagectl_studies.reproduction.ball_screw import CALIBRATED, MAIN, SWEEPS
from stagectl_studies.reproduction.summary import Compared, Verdict, diagram, photograph

_SAME = Verdict.REPRODUCED


def compared(numbers: dict[str, Any]) -> list[Compared]:
    """All rows; `numbers` of the page's parts by name."""
    return [
        photograph("Fig. 1", "experimental stage"),
        _response(numbers["figure 2"]),
        *_characteristics(numbers["figure 3"]),
        _curve_fit(numbers["figure 4"]),
        _steps(numbers["step response"]),
        _constant_speed(numbers["figure 5"]),
        _slow(numbers["figure 6"]),
        diagram("Fig. 7", "plant", "its equation (2) is what Fig. 9 solves"),
        *_proposed(numbers),
        diagram("Fig. 11", "control system", "runs in Figs. 13 and 14"),
        *_tracking(numbers),
    ]


def _response(p: dict[str, Any]) -> Compared:
    smallest, largest = (p[f"{name[4]} A"] for name in (SWEEPS[0], SWEEPS[-1]))
    ours = (
        f"R = {SWEEPS[0][4]} A: {smallest['gain_db_at_1_hz']:+.1f} dB at 1 Hz, "
        f"{smallest['phase_lead_deg_at_10_hz']:+.0f}° at 10 Hz; R = {SWEEPS[-1][4]} A: "
        f"{largest['gain_db_at_1_hz']:+.1f} dB, {largest['phase_lead_deg_at_10_hz']:+.0f}°"
    )
    return Compared("Fig. 2", "gain falls and phase leads where R is small; no numbers", ours, _SAME)


def _characteristics(p: dict[str, Any]) -> list[Compared]:
    fitted, true = p["stribeck"]["fitted"], p["stribeck"]["truth"]
    ours = (
        f"its equation fitted: Ts {fitted['static']:.2f}, Tc {fitted['coulomb']:.2f} N m, of a stage built with "
        f"{true['static']:.2f} and {true['coulomb']:.2f}"
    )
    return [
        Compared("Fig. 3(a)", "friction over velocity with Stribeck effect; no numbers", ours, _SAME),
        Compared("Fig. 3(b)", "hysteresis of rolling friction; no numbers", "the loop of the slow sine", _SAME),
    ]


def _curve_fit(p: dict[str, Any]) -> Compared:
    fit = p["curve fit to the gain"]
    return Compared(
        "Fig. 4, section IV.A.1",
        f"J {published.INERTIA:.3f}, D {published.VISCOUS_CURVE_FIT:.2f}",
        f"J {fit['inertia']:.4f}, D {fit['viscous']:.2f}",
        Verdict.DIFFERS,
        "friction beside D can only add to D; a lag left in the response takes away from it, and the paper's is not "
        f"known ({1e3 * p['lag left in']['150 Hz']['lag for 0.10']:.2f} ms would do, with lines up to 150 Hz)",
    )


def _steps(p: dict[str, Any]) -> Compared:
    smallest, largest = (p[name]["viscous"] / published.VISCOUS for name in (min(p), max(p)))
    ours = f"D {smallest:.1f} times too large with {min(p)}, {largest:.1f} times with {max(p)}"
    return Compared("Section IV.A.1, step response", "unsuitable, influenced by friction; no figure", ours, _SAME)


def _constant_speed(p: dict[str, Any]) -> Compared:
    return Compared("Fig. 5", f"D {published.VISCOUS:.2f}", f"D {p['viscous']['value']:.4f}", _SAME)


def _slow(p: dict[str, Any]) -> Compared:
    paper = f"nonlinear spring within {1e6 * published.SPRING_CONVENTIONAL:.0f} µm of a reversal"
    return Compared("Fig. 6", paper, f"95 % of a reversal within {1e6 * p['settled']:.1f} µm", _SAME)


def _proposed(numbers: dict[str, Any]) -> list[Compared]:
    nine, ten = numbers["figure 9"], numbers["figure 10"]
    others = [value for name, value in ten.items() if name not in (MAIN, CALIBRATED)]
    inertia, viscous = ([value[name] for value in others] for name in ("inertia", "viscous"))
    paper = f"J {published.INERTIA:.3f}, D {published.VISCOUS:.2f}"
    return [
        Compared("Fig. 8", "responses to 5 sin(2π 1.6 t) A; no numbers", "the same current, open loop", _SAME),
        Compared("Fig. 9", paper, f"J {nine['inertia']:.5f}, D {nine['viscous']:.4f}", _SAME),
        Compared(
            "Section IV.B, steps 2 and 3",
            f"D {published.MISPRINT_VISCOUS:g}, J {published.MISPRINT_INERTIA:g} on the way",
            "with these the loop is far from flat",
            Verdict.DIFFERS,
            "they are a misprint: most likely the two have changed places",
        ),
        Compared(
            "Fig. 10",
            f"{paper} in other conditions; spring within {1e6 * published.SPRING_PROPOSED:.0f} µm",
            f"J {min(inertia):.5f} to {max(inertia):.5f}, D {min(viscous):.4f} to {max(viscous):.4f}; spring as in "
            "Fig. 6",
            _SAME,
        ),
    ]


def _tracking(numbers: dict[str, Any]) -> list[Compared]:
    rows = numbers["figure 13"].values()
    worst = {
        name: max(row["without noise"][name]["peak"] for row in rows) for name in ("none", "conventional", "proposed")
    }
    peaks = ", ".join(f"{name} {length(peak, 'm')}" for name, peak in worst.items())
    largest = max(row["proposed"] for row in numbers["figure 14"]["peak_current"].values())
    return [
        Compared("Fig. 12", "sines of 3.2, 1.6 and 0.8 Hz; amplitudes not in the text", "amplitudes chosen", _SAME),
        Compared("Fig. 13", "proposed performs as well as conventional; no numbers", f"worst peaks: {peaks}", _SAME),
        Compared("Fig. 14", "control input; no numbers", f"up to {largest:.2f} A", _SAME),
    ]
