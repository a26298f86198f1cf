"""The linear slider in simulation: what the tests of paper B record on it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from stagectl_studies.reproduction.reversal_error import ReversalError, reversal_errors

from stagectl.compensation.zero_crossing import Form
from stagectl.config.stage_file import Setup, load_stage
from stagectl.identification.capture import Capture
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.trajectories import Experiment
from stagectl.trajectories.profiles import Trapezoid

SLIDER = Path(__file__).parents[2] / "config" / "linear-slider.yaml"


def slider(**control: Any) -> Setup:
    """Stage B as shipped, but for `control`."""
    setup = load_stage(SLIDER)
    return setup.having(control=setup.file.control._replace(**control))


def trapezoid(speed: float = 10e-3, acceleration: float = 0.1, dwell: float = 0.0) -> Trapezoid:
    """The paper's motion (m/s, m/s^2, s)."""
    return Trapezoid(5e-3, speed, acceleration, dwell, 2)


def recorded(
    setup: Setup, experiment: Experiment, form: Form | None = None, plant: Setup | None = None
) -> NDArray[Any]:
    """Rows (n,) of a run without compensation, or with that of `form`; `plant` is the machine if not the model."""
    if form is not None:
        setup = setup.having(compensation=form)
    controller = setup.controller.without(frozenset() if form else frozenset({"friction"}))
    return simulate(setup, plan(setup, experiment, controller.feedforward), controller.law, plant)


def capture(rows: NDArray[Any], column: str = "measured_current", name: str = "slider") -> Capture:
    """What an identification reads of `rows`."""
    dt = float(rows["time"][1])
    return Capture(name, rows["time"], rows["measured"], rows[column], dt, column, encoder_step=10e-9)


def errors(rows: NDArray[Any]) -> list[ReversalError]:
    """Errors at the reversals of `rows`."""
    dt = float(rows["time"][1])
    return reversal_errors(rows["reference"], rows["velocity"], rows["measured"], dt)


def worst(rows: NDArray[Any]) -> tuple[float, float]:
    """Largest lag and lead of all reversals (um)."""
    at_reversals = errors(rows)
    return min(error.negative for error in at_reversals) * 1e6, max(error.positive for error in at_reversals) * 1e6
