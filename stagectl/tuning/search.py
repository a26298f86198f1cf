"""Gains for a stated bandwidth and margin, or the highest bandwidth that keeps the margin.

The search goes over the designs of one law (`families`).  It ends where the phase margin of a loop or the peak of the
sensitivity says so; ``Ms <= 2`` guarantees a gain margin of 2 (6 dB) and a phase margin of 29 deg.

Source: S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed., 2005, section 2.4.4 (Ms < 2).
"""

from __future__ import annotations

import contextlib
import math
from typing import NamedTuple

import numpy as np

from stagectl import design
from stagectl.tuning.families import Family, TuningError, chosen, cut, reached
from stagectl.tuning.robustness import Robustness, essence, stable
from stagectl.units import Quantity

PEAK = 2.0  # of the sensitivity, where no bandwidth is asked for
SLOWEST, FASTEST = 2e-4, 0.25  # bandwidths looked at: shares of the sampling frequency
STEPS, HALVINGS = 40, 12


class Demand(NamedTuple):
    """What every design must keep."""

    margin: float  # rad, phase margin of each loop
    peak: float = math.inf  # Ms of the loop cut at the current


class Tuned(NamedTuple):
    """A design and what it reaches."""

    control: design.Settings
    bandwidth: float  # Hz
    reached: dict[str, Robustness]  # by loop, the one cut at the current first
    family: Family
    demand: Demand
    binding: tuple[str, ...] = ()  # what forbids more; empty where the bandwidth was given
    without_peak: float | None = None  # Hz, what the margin alone would allow, where Ms binds


def shortfalls(found: dict[str, Robustness], demand: Demand) -> list[str]:
    """What is missing, in words; nothing is good."""
    missing = [f"the sampled {name} is unstable" for name, one in found.items() if not one.stable]
    if missing:
        return missing
    for name, one in found.items():
        if one.phase < demand.margin:
            missing.append(f"the {name} has a phase margin of {math.degrees(one.phase):.1f} deg")
    peak = next(iter(found.values())).sensitivity.value
    if peak > demand.peak:
        missing.append(f"the sensitivity has a peak of Ms = {peak:.2f}")
    return missing


def tuned(family: Family, demand: Demand, bandwidth: float | None = None) -> Tuned:
    """The design of this `bandwidth` (Hz), or, without one, the fastest that meets `demand`.

    Raises TuningError where there is none, naming the nearest one that there is.
    """
    if bandwidth is None:
        return _fastest(family, demand)
    quantity = Quantity("Hz", f"(0, {_most(family):g}]", "bandwidth")
    if not quantity.admits(bandwidth):
        raise TuningError(f"--bandwidth {bandwidth:g} Hz; must lie in {quantity.interval} Hz")
    missing = _missing(family, demand, bandwidth)
    if missing:
        raise TuningError(
            f"--bandwidth {bandwidth:g} Hz cannot be had: {'; '.join(missing)}; {_asked(demand)}.  {_loop(family)}.  "
            f"{_nearest(family, demand, bandwidth)}"
        )
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
        return 2000.0
    return 1e4 / max(family.ratios.separation, 1.0)


def _missing(family: Family, demand: Demand, bandwidth: float) -> list[str]:
    control = chosen(family, bandwidth)
    try:
        return shortfalls(reached(family.stage, control), demand)
    except design.DesignError as error:
        return [str(error)]


def _holds(family: Family, demand: Demand, bandwidth: float) -> bool:
    """Whether nothing is missing; the cheapest question first, as a search asks it often."""
    try:
        each = cut(family.stage, chosen(family, bandwidth))
    except design.DesignError:
        return False
    if not all(stable(loop) for loop in each.values()):
        return False
    for number, loop in enumerate(each.values()):
        phase, peak = essence(loop)
        if phase < demand.margin or (number == 0 and peak > demand.peak):
            return False
    return _swings(family, bandwidth) is None


def _swings(family: Family, bandwidth: float) -> float | None:
    """Where friction holds the axis; a bandwidth that nobody asked for must let it come to rest."""
    return design.limit_cycle_frequency(family.stage, *design.loop_parts(family.stage, chosen(family, bandwidth)))


def _restless(family: Family, bandwidth: float) -> str:
    """What binds where no margin does."""
    frequency = _swings(family, bandwidth)
    if frequency is None:
        return "it is the highest that is looked at"
    return f"where friction holds the axis, the loop swings by itself at {frequency:.3g} Hz"


def _range(family: Family) -> tuple[float, float]:
    """Bandwidths (Hz) that are looked at."""
    dt = family.control.period
    return SLOWEST / dt, min(FASTEST / dt, _most(family))


def _grid(family: Family) -> list[float]:
    return [float(f) for f in np.geomspace(*_range(family), STEPS)]


def _edge(family: Family, demand: Demand, good: float, bad: float) -> float:
    """The bandwidth (Hz) nearest to `bad` that still meets `demand`, with three digits."""
    for _ in range(HALVINGS):
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
    found = _highest(family, demand)
    if found is None:
        raise TuningError(
            f"no bandwidth from {_span(family)} gives what is asked for: {_asked(demand)}.  {_loop(family)}.  "
            f"{_best(family)}"
        )
    control = chosen(family, found)
    more = 1.01 * found
    binding = tuple(_missing(family, demand, more)) or (_restless(family, more),)
    without = None
    if any("Ms" in words for words in binding):
        without = _highest(family, demand._replace(peak=math.inf))
    return Tuned(control, found, reached(family.stage, control), family, demand, binding, without)


def _nearest(family: Family, demand: Demand, asked: float) -> str:
    """What can be had nearest to the bandwidth that was `asked` for (Hz)."""
    grid = [*_grid(family), asked]
    ordered = sorted(grid, key=lambda f: abs(math.log(f / asked)))
    near = next((f for f in ordered if _holds(family, demand, f)), None)
    if near is None:
        return _best(family)
    beside = min((f for f in grid if (f - near) * (asked - near) > 0.0), key=lambda f: abs(math.log(f / near)))
    return f"Nearest: --bandwidth {_edge(family, demand, near, beside):.4g}Hz, or a shorter period or less delay"


def _best(family: Family) -> str:
    """The design with the largest phase margin, where none is enough."""
    found = []
    for f in _grid(family)[::2]:
        with contextlib.suppress(design.DesignError):
            each = list(reached(family.stage, chosen(family, f)).values())
            if all(one.stable for one in each):
                found.append((min(one.phase for one in each), f, each[0].sensitivity.value))
    if not found:
        return "No bandwidth is stable: take a shorter period, remove delay, or check the stage's model"
    phase, f, peak = max(found)
    law = f"this placement gives at most {math.degrees(phase):.1f} deg with Ms = {peak:.2f}, at {f:.3g} Hz"
    return f"Nearest: {law} (--bandwidth {f:.3g}Hz --margin {math.floor(10 * math.degrees(phase)) / 10:g}deg)"


def _asked(demand: Demand) -> str:
    peak = f" and Ms of at most {demand.peak:g}" if math.isfinite(demand.peak) else ""
    return f"at least {math.degrees(demand.margin):g} deg{peak} are asked for, and an axis that comes to rest"


def _span(family: Family) -> str:
    low, high = _range(family)
    return f"{low:.3g} to {high:.3g} Hz"


def _loop(family: Family) -> str:
    p, dt = family.stage, family.control.period
    return (
        f"Period {dt * 1e3:g} ms, nd {p.drive.delay_samples}, nm {p.encoder.delay_samples}, current lag "
        f"{p.drive.current_lag * 1e3:.3g} ms"
    )
