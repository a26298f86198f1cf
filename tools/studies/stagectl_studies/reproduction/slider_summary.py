"""The slider paper, figure by figure: what it states, what comes out here, and why they differ."""

from typing import Any

from stagectl_studies.reproduction import published
from stagectl_studies.reproduction.slider_forms import CONVENTIONAL, FIRST, PAPERS, SECOND
from stagectl_studies.reproduction.summary import Compared, Verdict, diagram, photograph

_SAME, _DIFFERS = Verdict.REPRODUCED, Verdict.DIFFERS


def compared(numbers: dict[str, Any], friction: float) -> list[Compared]:
    """All rows; `numbers` of the page's parts by name, and rms of the `friction` (N) that Figs. 8 and 9 fit."""
    return [
        photograph("Fig. 1", "experimental system"),
        diagram("Fig. 2", "control system", "kernels/cascade.py is that diagram"),
        *_standing(numbers),
        *_forms(numbers["figures 8 and 9"], friction),
        *_compensated(numbers["figure 10"]),
    ]


def _over(values: dict[str, Any], unit: str, decimals: int = 2) -> str:
    """``4.48, 4.26 N at 2.5, 5 mm/s``."""
    numbers = ", ".join(f"{abs(value):.{decimals}f}" for value in values.values())
    return f"{numbers} {unit} after {', '.join(values)} mm/s"


def _standing(numbers: dict[str, Any]) -> list[Compared]:
    three, four = numbers["figure 3"]["force_at_reversal"], numbers["figure 4"]
    five = {speed: value for speed, value in numbers["figure 5"].items() if speed != "paper"}
    low, high = published.RELEASE_TRAVEL
    frequency = ", ".join(f"{value['frequency']:.1f}" for value in five.values())
    return [
        Compared("Fig. 3", "force at zero velocity differs by speed; no numbers", _over(three, "N"), _SAME),
        Compared(
            "Fig. 4",
            f"about {published.HOLDING_FORCE} N at zero velocity",
            _over({speed: value["ours"] for speed, value in four.items()}, "N"),
            _SAME,
        ),
        Compared("Fig. 5", f"free vibration of {published.VIBRATION:g} Hz", f"{frequency} Hz", _SAME),
        Compared(
            "Fig. 5",
            f"{1e6 * low:.0f} to {1e6 * high:.0f} µm, larger at low speed",
            _over({speed: 1e6 * value["offset"] for speed, value in five.items()}, "µm", 1),
            _SAME,
        ),
    ]


def _forms(p: dict[str, Any], friction: float) -> list[Compared]:
    first, second, conventional = (
        f"{100.0 * p[name]['residual_rms'] / friction:.0f} %" for name in (FIRST, SECOND, CONVENTIONAL)
    )
    excess = max(p[name]["searches"]["genetic"]["cost"] / p[name]["searches"]["today"]["cost"] for name in PAPERS)
    return [
        Compared("Figs. 6, 7", "the two forms; equations not in our text", "reconstructed, with fitted values", _SAME),
        Compared(
            "Figs. 8, 9", "proposed is the same as the force", f"{second} left over, read as a second power", _SAME
        ),
        Compared(
            "Figs. 8, 9",
            "the same",
            f"{first} left over, read as a first power",
            _DIFFERS,
            "a spring lets go flatly, and a first power falls steeply",
        ),
        Compared(
            "Figs. 7, 8",
            "conventional is the same before the crossing, far from the force behind it",
            f"{p[CONVENTIONAL]['searches']['today']['cost']:.2f} N off before, {conventional} over all",
            _SAME,
        ),
        Compared(
            "Section 3.2",
            "three parameters by a genetic algorithm",
            f"its costs are at most {100.0 * (excess - 1.0):.1f} % above those of today's search",
            _SAME,
        ),
    ]


def _compensated(p: dict[str, Any]) -> list[Compared]:
    fastest = next(name for name in reversed(p) if "," in name and "mm/s" in name).split(" ")[0]
    turns = {form: p[f"{fastest} mm/s, {form}"]["within the ramps"] for form in ("none", *PAPERS)}
    lag, lead = (
        {form: f"{1e6 * turn[key]:+.1f} µm" for form, turn in turns.items()} for key in ("negative", "positive")
    )
    return [
        Compared(
            "Fig. 10", "-4.7 µm without compensation", lag["none"], _DIFFERS, "loop and deceleration are not stated"
        ),
        Compared(
            "Fig. 10",
            "-2.4 µm with the proposed form, half of the lag or less",
            f"{lag[FIRST]} (first power), {lag[SECOND]} (second)",
            _DIFFERS,
            "our stage repeats itself, so that a fit holds in the next run, too; it is below half, as the paper's",
        ),
        Compared(
            "Fig. 10",
            "positive error suppressed with the proposed form",
            f"{lead[FIRST]} (first power), {lead[SECOND]} (second); {lead['none']} without compensation",
            _DIFFERS,
            "a first power falls faster than the guide's spring; with a second one the loop swings back after 50 ms",
        ),
        Compared(
            "Fig. 10",
            "+1.5 µm with the conventional form",
            lead[CONVENTIONAL],
            _DIFFERS,
            "its jump of 2 Cs meets a guide that is still a spring; loop and stiffness, which decide how far that "
            "throws the axis, are not stated",
        ),
    ]
