"""How fast the simulator is, and how coarse its step may be before the tracking figures leave their bounds."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from measure import Contender, Row, Wanted, interleaved, spread
from scene import FRICTION, Scene, scene, with_substeps

from stagectl.evaluation import window
from stagectl.simulation import simulate

SUBSTEPS = (1, 2, 5, 10, 20)
STATED = 10  # 20 kHz at Ts = 0.5 ms
SINES = ("sine-0.8hz", "sine-1.6hz", "sine-3.2hz")
TINY = "sine-2um"
_BARE = {0: (4.9, 5.6), 1: (5.1, 6.1)}  # um, peak without friction compensation at nd = 0 and 1
_COMPENSATED, _ROLLING = 0.03, 0.02  # um


class Tracking(NamedTuple):
    """Peaks (um) of the measured tracking error in the steady window, at one step of the integrator."""

    substeps: int
    nd: int
    bare: dict[str, float]  # without friction compensation
    compensated: dict[str, float]

    @property
    def holds(self) -> bool:
        """Whether all of it lies in the issue's bounds."""
        low, high = _BARE[self.nd]
        return (
            all(low <= self.bare[sine] <= high for sine in SINES)
            and all(self.compensated[sine] <= _COMPENSATED for sine in SINES)
            and self.compensated[TINY] <= _ROLLING
        )


def run(one: Scene) -> Any:
    """The whole run, as ``stagectl simulate`` computes it."""
    return simulate(one.setup, one.plan, one.controller.law)


def peak(one: Scene) -> float:
    """Largest tracking error (um) in the steady window."""
    samples = run(one)
    inside = window(samples["time"], list(one.plan.steady))
    error = (samples["reference"] - samples["measured"])[inside] * one.setup.file.axis.travel_per_unit
    return 1e6 * float(np.max(np.abs(error)))


def tracking() -> list[Tracking]:
    """The figures of the issue at every step and delay."""
    motions = (*SINES, TINY)
    found = []
    for nd in (0, 1):
        bare = {motion: scene(motion, nd, FRICTION) for motion in motions}
        compensated = {motion: scene(motion, nd) for motion in motions}
        for n in SUBSTEPS:
            peaks = [{m: peak(with_substeps(s, n)) for m, s in group.items()} for group in (bare, compensated)]
            found.append(Tracking(n, nd, *peaks))
    return sorted(found)


def speed(rounds: int) -> dict[int, list[float]]:
    """Factors over real time, round by round, at every step: stage A in closed loop, with friction, nd = 1."""
    one = scene("sine-1.6hz")
    contenders = [Contender(str(n), partial(run, with_substeps(one, n)), len(one.plan.setpoints)) for n in SUBSTEPS]
    found = interleaved(contenders, rounds)
    return {n: [one.setup.dt / seconds for seconds in found[str(n)]] for n in SUBSTEPS}


def rows(factors: dict[int, list[float]], table: list[Tracking]) -> list[Row]:
    """The judged line, and the factor at the coarsest step that still tracks as stated."""
    method = (
        "stage A with 12 stop operators in closed loop (law, plant, every recorded column) through "
        "simulation.simulate, compiled, one thread; simulated over elapsed time, rounds over all steps interleaved"
    )
    # A step counts only if all finer ones hold too: a figure that comes right by accident is not taken.
    failing = [n for n in SUBSTEPS if not all(line.holds for line in table if line.substeps == n)]
    coarsest = min((n for n in SUBSTEPS if n > max(failing, default=0)), default=None)
    stated = Row("simulator, 20 kHz sub-steps", spread(factors[STATED]), "x", Wanted(300.0, True), method)
    if coarsest is None:
        return [stated]
    name = f"simulator, coarsest step that tracks ({coarsest} a period)"
    return [stated, Row(name, spread(factors[coarsest]), "x", None, "the same, at the step of the table below")]
