"""A tuned controller for the user and as JSON: gains, margins, closed loop, and notes on them."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl import design
from stagectl.config.stage_file import Setup
from stagectl.kernels import cascade, feedback
from stagectl.number_format import duration
from stagectl.tuning.constants import LONGEST, SENSITIVITY_PEAK, SETTLED, STEP_PERIODS
from stagectl.tuning.families import law_of
from stagectl.tuning.robustness import Peak, Robustness, attenuated, bandwidth, following, loops, softest, stepped
from stagectl.tuning.search import Tuned
from stagectl.typed_json import finite
from stagectl.units import unit_on

NAMES = {"pid": "PID", "cascade": "P-PI cascade"}


class Gain(NamedTuple):
    """One gain of the controller: continuous, and as it runs once a period."""

    name: str
    symbol: str
    value: float
    unit: str
    running: float
    running_unit: str


class ClosedLoop(NamedTuple):
    """Figures of the closed loop; the stiffness of a rotary axis with a lead is that of its table."""

    bandwidth: float  # Hz, target to position, -3 dB
    attenuated: float  # Hz, |S| below -3 dB
    overshoot: float  # of a step
    settling: float  # s, within 2 % of a step
    softest: Peak  # N m/rad | N/m of table travel: smallest dynamic stiffness


def gains(setup: Setup, control: design.Settings) -> list[Gain]:
    """The gains of `control` on the stage."""
    position = unit_on(setup.file.axis.kind, "rad | m")
    designed = design.designed_feedback(setup.stage, control)
    if isinstance(designed, feedback.Gains):
        return _of_pid(designed, feedback.discretised(designed, control.period), f"A/{position}", position)
    assert isinstance(control, design.CascadeControl)
    return _of_cascade(designed, control, f"A s/{position}")


def named_gains(setup: Setup, control: design.Settings) -> dict[str, tuple[float, str]]:
    """Continuous gains by name: (value, unit)."""
    return {gain.name: (gain.value, gain.unit) for gain in gains(setup, control)}


def _of_pid(g: feedback.Gains, p: feedback.Pid, unit: str, position: str) -> list[Gain]:
    return [
        Gain("proportional", "Kp", g.proportional, unit, p.proportional, unit),
        Gain("integral", "Ki", g.integral, f"A/({position} s)", p.integral, unit),
        Gain("derivative", "Kd", g.derivative, f"A s/{position}", p.derivative, unit),
        Gain("derivative filter", "a", g.pole, "rad/s", p.decay, ""),
    ]


def _of_cascade(p: cascade.Cascade, control: design.CascadeControl, unit: str) -> list[Gain]:
    return [
        Gain("position", "Kp", p.position, "1/s", p.position, "1/s"),
        Gain("velocity", "Kv", p.velocity, unit, p.velocity, unit),
        Gain("integral time", "Ti", control.integral_time, "s", p.integral, unit),
        Gain("force filter", "Tf", control.force_filter, "s", p.retained, ""),
        Gain("velocity feedforward", "FF", p.share, "", p.share, ""),
    ]


def closed(setup: Setup, tuned: Tuned) -> ClosedLoop:
    """Bandwidth, attenuation, step and stiffness of the closed loop."""
    control = tuned.control
    parts = design.loop_parts(setup.stage, control)
    tracking, cut = following(setup.stage, *parts), next(iter(loops(setup.stage, *parts).values()))
    response = step(setup, tuned, STEP_PERIODS)
    outside = np.flatnonzero(np.abs(response - 1.0) > SETTLED)
    last = len(response) if not outside.size else int(outside[-1]) + 1
    least = softest(setup.stage, cut)
    return ClosedLoop(
        bandwidth(tracking),
        attenuated(cut),
        max(float(np.max(response)) - 1.0, 0.0),
        last * control.period if last < len(response) else math.inf,
        least._replace(value=least.value / setup.file.axis.travel_per_unit**2),
    )


def step(setup: Setup, tuned: Tuned, periods: float) -> NDArray[np.float64]:
    """Measured position (n,) after a step of the target, over so many `periods` of the bandwidth."""
    dt = tuned.control.period
    length = min(math.ceil(periods / (tuned.bandwidth * dt)), LONGEST)
    return stepped(following(setup.stage, *design.loop_parts(setup.stage, tuned.control)), length)


def headline(tuned: Tuned) -> str:
    """The design and its margins, in a sentence or two."""
    whole = next(iter(tuned.reached.values()))
    law = NAMES[law_of(tuned.control)]
    meaning = "four poles" if isinstance(tuned.control, design.Control) else "position loop, Kp = 2 pi f"
    words = (
        f"{law} of {tuned.bandwidth:g} Hz ({meaning}): phase margin {math.degrees(whole.phase):.1f} deg, gain margin "
        f"{decibels(whole.raised.value)} up, Ms {whole.sensitivity.value:.2f}."
    )
    return f"{words}  {_binding(tuned)}" if tuned.binding else words


def _binding(tuned: Tuned) -> str:
    words = f"It is the fastest that keeps a phase margin of {math.degrees(tuned.demand.margin):g} deg"
    words += f" and Ms <= {tuned.demand.peak:g}" if math.isfinite(tuned.demand.peak) else ""
    words += ", and comes to rest" if tuned.demand.at_rest else ""
    words += f".  The limit, at 1 % more: {' and '.join(tuned.binding)}."
    if tuned.without_peak is not None:
        words += f"  The phase margin alone would allow {tuned.without_peak:g} Hz."
    return words


def notes(tuned: Tuned) -> list[str]:
    """Notes on properties that the figures do not show at once."""
    whole, control = next(iter(tuned.reached.values())), tuned.control
    texts = []
    if whole.lowered.value > 0.0:
        texts.append(
            f"Conditionally stable: the gain may fall by {decibels(1.0 / whole.lowered.value)} at most.  A current at "
            "its limit, or friction that holds the axis, lowers it."
        )
    if whole.sensitivity.value > SENSITIVITY_PEAK:
        texts.append(
            f"Ms = {whole.sensitivity.value:.2f}: disturbances near {whole.sensitivity.frequency:.0f} Hz are amplified "
            f"by this factor.  Ms <= {SENSITIVITY_PEAK:g} would guarantee margins of 6 dB and 29 deg."
        )
    if isinstance(control, design.CascadeControl) and control.force_filter == 0.0:
        texts.append("No force filter: its corner would lie above Nyquist's frequency.")
    texts.append(f"Margins are those of the sliding axis; {_standstill(tuned)}.")
    return texts


def _standstill(tuned: Tuned) -> str:
    """Stability where friction holds the axis."""
    calm = "at standstill, where friction is a spring, the loop is stable, too"
    return design.limit_cycle_warning(tuned.family.stage, tuned.control) or calm


def margins(tuned: Tuned) -> list[list[str]]:
    """Margins and peaks, one a row, one column a loop."""
    loops = list(tuned.reached.values())
    return [
        ["PM", *(_at(f"{math.degrees(loop.phase):.1f} deg", loop.crossover) for loop in loops)],
        ["GM up", *(_gain(loop.raised) for loop in loops)],
        ["GM down", *(_gain(loop.lowered) for loop in loops)],
        ["delay margin", *(duration(loop.delay) if math.isfinite(loop.delay) else "any" for loop in loops)],
        ["Ms", *(_at(f"{loop.sensitivity.value:.2f}", loop.sensitivity.frequency) for loop in loops)],
        ["modulus 1/Ms", *(f"{loop.modulus:.2f}" for loop in loops)],
        ["Mt", *(_complementary(loop) for loop in loops)],
    ]


def rows(setup: Setup, loop: ClosedLoop) -> list[list[str]]:
    """The closed loop, one figure a row."""
    scale, unit = stiffness_unit(setup)
    return [
        ["bandwidth, target to position, -3 dB", f"{loop.bandwidth:.4g} Hz"],
        ["disturbances attenuated (|S| < -3 dB) up to", f"{loop.attenuated:.4g} Hz"],
        ["overshoot of a step without feedforward", f"{100 * loop.overshoot:.1f} %"],
        ["step settled within 2 %", duration(loop.settling) if math.isfinite(loop.settling) else "later than 20/f"],
        ["least dynamic stiffness", _at(f"{scale * loop.softest.value:.3g} {unit}", loop.softest.frequency)],
    ]


def stiffness_unit(setup: Setup) -> tuple[float, str]:
    """Factor from SI and unit in which a stiffness is read."""
    return (1e-6, "N/µm") if setup.file.axis.travel_unit == "m" else (1.0, "N m/rad")


def decibels(factor: float) -> str:
    """A gain in dB."""
    return f"{20.0 * math.log10(factor):.1f} dB"


def _at(words: str, frequency: float) -> str:
    return f"{words} ({frequency:.3g} Hz)"


def _complementary(loop: Robustness) -> str:
    peak = loop.complementary
    return "1, no peak" if peak.value <= 1.0 else _at(f"{peak.value:.2f}", peak.frequency)


def _gain(margin: Peak) -> str:
    return _at(decibels(margin.value), margin.frequency) if 0.0 < margin.value < math.inf else "any"


def result(setup: Setup, tuned: Tuned) -> dict[str, Any]:
    """JSON values, SI; null is infinite."""
    control, drive = tuned.control, setup.stage.drive
    loop = closed(setup, tuned)
    rotary = setup.file.axis.travel_unit == "rad"
    return {
        "stage": setup.file.name,
        "law": law_of(control),
        "bandwidth": _value(tuned.bandwidth, "Hz"),
        "period": _value(control.period, "s"),
        "nd": drive.delay_samples,
        "nm": setup.stage.encoder.delay_samples,
        "current_lag": _value(drive.current_lag, "s"),
        "control": entries(control),
        "gains": {gain.name.replace(" ", "_"): gain._asdict() for gain in gains(setup, control)},
        "loops": {name.replace(" ", "_"): _robust(loop) for name, loop in tuned.reached.items()},
        "closed_loop": {
            "bandwidth": _value(loop.bandwidth, "Hz"),
            "attenuated_to": _value(loop.attenuated, "Hz"),
            "overshoot": _value(loop.overshoot, ""),
            "settling_time": _value(loop.settling, "s"),
            "least_stiffness": {**_value(loop.softest.value, "N m/rad" if rotary else "N/m"), "at": loop.softest[1]},
        },
        "asked": {"margin": _value(tuned.demand.margin, "rad"), "sensitivity_peak": _value(tuned.demand.peak, "")},
        "binding": list(tuned.binding),
        "answer": headline(tuned),
        "notes": notes(tuned),
    }


def entries(control: design.Settings) -> dict[str, float]:
    """Entries that the design chose, by their name under `control` in the stage file (SI)."""
    if isinstance(control, design.Control):
        return {"bandwidth": control.bandwidth}
    names = ("position_gain", "velocity_bandwidth", "integral_time", "force_filter")
    return {name: getattr(control, name) for name in names}


def _value(value: float, unit: str) -> dict[str, Any]:
    return {"value": finite(value), "unit": unit}


def _robust(loop: Robustness) -> dict[str, Any]:
    return {
        "phase_margin": {**_value(loop.phase, "rad"), "at": loop.crossover},
        "gain_margin_up": {**_value(loop.raised.value, ""), "at": loop.raised.frequency},
        "gain_margin_down": {**_value(loop.lowered.value, ""), "at": loop.lowered.frequency},
        "delay_margin": _value(loop.delay, "s"),
        "sensitivity_peak": {**_value(loop.sensitivity.value, ""), "at": loop.sensitivity.frequency},
        "modulus_margin": _value(loop.modulus, ""),
        "complementary_peak": {**_value(loop.complementary.value, ""), "at": loop.complementary.frequency},
    }
