"""Gains for a stated bandwidth and margin, or the highest bandwidth that keeps the margin.

The search covers the designs of one law (`families`).  The phase margin of a loop or the peak of the sensitivity
limits it; ``Ms <= 2`` guarantees a gain margin of 2 (6 dB) and a phase margin of 29 deg.

Source: S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed., 2005, section 2.4.4 (Ms < 2).
"""

import contextlib
import math
from typing import NamedTuple

import numpy as np

from stagectl import design
from stagectl.tuning import constants
from stagectl.tuning.families import Family, Nearest, TuningError, chosen, judged_loops, reached
from stagectl.tuning.robustness import Robustness, essence, stable
from stagectl.units import Quantity


class Demand(NamedTuple):
    """Margins that every design must keep."""

    margin: float  # rad, phase margin of each loop
    peak: float = math.inf  # Ms of the loop cut at the current
    at_rest: bool = True  # whether the axis must come to rest where the model's friction holds it


class Tuned(NamedTuple):
    """A design and its margins."""

    control: design.Settings
    bandwidth: float  # Hz
    reached: dict[str, Robustness]  # by loop, the one cut at the current first
    family: Family
    demand: Demand
    binding: tuple[str, ...] = ()  # the limits of the bandwidth; empty where it was given
    without_peak: float | None = None  # Hz, allowed by the margin alone, where Ms is the limit


def shortfalls(margins: dict[str, Robustness], demand: Demand) -> list[str]:
    """Which parts of the `demand` are not met, for the user; empty where all are."""
    missing = [f"the sampled {name} is unstable" for name, loop in margins.items() if not loop.stable]
    if missing:
        return missing
    for name, loop in margins.items():
        if loop.phase < demand.margin:
            missing.append(f"the {name} has a phase margin of {math.degrees(loop.phase):.1f} deg")
    peak = next(iter(margins.values())).sensitivity.value
    if peak > demand.peak:
        missing.append(f"the sensitivity has a peak of Ms = {peak:.2f}")
    return missing


def tuned(family: Family, demand: Demand, bandwidth: float | None = None) -> Tuned:
    """The design of this `bandwidth` (Hz), or, without one, the fastest that meets `demand`.

    Raises TuningError where there is none, with the nearest one that exists.
    """
    if bandwidth is None:
        return _fastest(family, demand)
    quantity = Quantity("Hz", f"(0, {_most(family):g}]", "bandwidth")
    if not quantity.admits(bandwidth):
        text = f"bandwidth = {bandwidth:g} Hz; must lie in {quantity.interval} Hz"
        raise TuningError(text, option="bandwidth", value=bandwidth, admissible=quantity.interval)
    missing = _missing(family, demand, bandwidth)
    if missing:
        nearest = _nearest(family, demand, bandwidth)
        text = (
            f"bandwidth = {bandwidth:g} Hz is not possible: {'; '.join(missing)}; {_required(demand)}.  "
            f"{_loop(family)}.  {nearest.words}"
        )
        raise TuningError(text, option="bandwidth", value=bandwidth, nearest=nearest)
    control = chosen(family, bandwidth)
    return Tuned(control, bandwidth, reached(family.stage, control), family, demand)


def as_designed(family: Family) -> Tuned:
    """The design that a stage file has, with what it reaches.

    Raises DesignError where its gains cannot be realised.
    """
    control = family.control
    bandwidth = control.bandwidth if isinstance(control, design.Control) else control.position_gain / (2.0 * math.pi)
    return Tuned(control, bandwidth, reached(family.stage, control), family, Demand(control.margin))


def _most(family: Family) -> float:
    """The largest bandwidth (Hz) that a stage file takes."""
    if isinstance(family.control, design.Control):
        return constants.MOST_PID
    return constants.MOST_VELOCITY / max(family.ratios.separation, 1.0)


def _missing(family: Family, demand: Demand, bandwidth: float) -> list[str]:
    control = chosen(family, bandwidth)
    try:
        return shortfalls(reached(family.stage, control), demand)
    except design.DesignError as error:
        return [str(error)]


def _holds(family: Family, demand: Demand, bandwidth: float) -> bool:
    """Whether the demand is met; the cheapest checks first, as a search makes them often."""
    try:
        loops = judged_loops(family.stage, chosen(family, bandwidth))
    except design.DesignError:
        return False
    if not all(stable(loop) for loop in loops.values()):
        return False
    for number, loop in enumerate(loops.values()):
        phase, peak = essence(loop)
        if phase < demand.margin or (number == 0 and peak > demand.peak):
            return False
    return not demand.at_rest or _swings(family, bandwidth) is None


def _swings(family: Family, bandwidth: float) -> float | None:
    """Frequency (Hz) at which the loop oscillates where friction holds the axis; None where it comes to rest."""
    return design.limit_cycle_frequency(family.stage, *design.loop_parts(family.stage, chosen(family, bandwidth)))


def _restless(family: Family, bandwidth: float) -> str:
    """The limit where no margin is one."""
    frequency = _swings(family, bandwidth)
    if frequency is None:
        return "it is the highest that is tried"
    return f"where friction holds the axis, the loop swings by itself at {frequency:.3g} Hz"


def _range(family: Family) -> tuple[float, float]:
    """Lowest and highest bandwidth (Hz) that are tried."""
    dt = family.control.period
    return constants.SLOWEST / dt, min(constants.FASTEST / dt, _most(family))


def _grid(family: Family) -> list[float]:
    return [float(f) for f in np.geomspace(*_range(family), constants.GRID_STEPS)]


def _edge(family: Family, demand: Demand, good: float, bad: float) -> float:
    """The bandwidth (Hz) nearest to `bad` that still meets `demand`, with three digits."""
    for _ in range(constants.HALVINGS):
        middle = math.sqrt(good * bad)
        good, bad = (good, middle) if not _holds(family, demand, middle) else (middle, bad)
    digit: float = 10.0 ** (math.floor(math.log10(good)) - 2)
    rounded = digit * (math.floor(good / digit) if bad > good else math.ceil(good / digit))
    neat = float(f"{rounded:.3g}")
    return neat if _holds(family, demand, neat) else good


def _highest(family: Family, demand: Demand) -> float | None:
    """The highest bandwidth (Hz) that meets `demand`, None where none does."""
    grid = _grid(family)
    for k in range(len(grid) - 1, -1, -1):
        if _holds(family, demand, grid[k]):
            return grid[k] if k + 1 == len(grid) else _edge(family, demand, grid[k], grid[k + 1])
    return None


def _fastest(family: Family, demand: Demand) -> Tuned:
    highest = _highest(family, demand)
    if highest is None:
        best = _best(family)
        text = (
            f"no bandwidth from {_span(family)} meets the demand: {_required(demand)}.  {_loop(family)}.  {best.words}"
        )
        raise TuningError(text, option="margin", value=demand.margin, nearest=best)
    control = chosen(family, highest)
    more = constants.BEYOND * highest
    binding = tuple(_missing(family, demand, more)) or (_restless(family, more),)
    without = None
    if any("Ms" in words for words in binding):
        without = _highest(family, demand._replace(peak=math.inf))
    return Tuned(control, highest, reached(family.stage, control), family, demand, binding, without)


def _nearest(family: Family, demand: Demand, wanted: float) -> Nearest:
    """The nearest possible bandwidth to the one that is `wanted` (Hz)."""
    grid = [*_grid(family), wanted]
    ordered = sorted(grid, key=lambda f: abs(math.log(f / wanted)))
    near = next((f for f in ordered if _holds(family, demand, f)), None)
    if near is None:
        return _best(family)
    next_to = min((f for f in grid if (f - near) * (wanted - near) > 0.0), key=lambda f: abs(math.log(f / near)))
    bandwidth = float(f"{_edge(family, demand, near, next_to):.4g}")
    return Nearest(f"Nearest: --bandwidth {bandwidth:.4g}Hz, or a shorter period or less delay", bandwidth)


def _best(family: Family) -> Nearest:
    """The design with the largest phase margin, where none is sufficient."""
    stable_designs = []
    for f in _grid(family)[::2]:
        with contextlib.suppress(design.DesignError):
            margins = list(reached(family.stage, chosen(family, f)).values())
            if all(loop.stable for loop in margins):
                phase = min(loop.phase for loop in margins)
                stable_designs.append((phase, f, margins[0].sensitivity.value))
    if not stable_designs:
        return Nearest("No bandwidth is stable: take a shorter period, remove delay, or check the stage's model")
    phase, f, peak = max(stable_designs)
    margin = math.floor(10 * math.degrees(phase)) / 10
    best = f"this placement gives at most {math.degrees(phase):.1f} deg with Ms = {peak:.2f}, at {f:.3g} Hz"
    return Nearest(f"Nearest: {best} (--bandwidth {f:.3g}Hz --margin {margin:g}deg)", float(f"{f:.3g}"), margin)


def _required(demand: Demand) -> str:
    peak = f" and Ms of at most {demand.peak:g}" if math.isfinite(demand.peak) else ""
    rest = ", and an axis that comes to rest" if demand.at_rest else ""
    return f"required are at least {math.degrees(demand.margin):g} deg{peak}{rest}"


def _span(family: Family) -> str:
    low, high = _range(family)
    return f"{low:.3g} to {high:.3g} Hz"


def _loop(family: Family) -> str:
    p, dt = family.stage, family.control.period
    return (
        f"Period {dt * 1e3:g} ms, nd {p.drive.delay_samples}, nm {p.encoder.delay_samples}, current lag "
        f"{p.drive.current_lag * 1e3:.3g} ms"
    )
