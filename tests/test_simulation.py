"""How a run is computed: interpreted first where that is sooner done, with the compiled rows in every case."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stagectl import simulation
from stagectl.config.stage_file import Setup
from stagectl.kernels import jit, rollout
from stagectl.trajectories import Sine
from tests.conftest import Run


class Calls:
    """Stands in for `rollout.closed_loop`; an interpreted call fails as Python does where numbers leave their range."""

    def __init__(self, error: Exception | None) -> None:
        self.error, self.setpoints = error, list[Any]()

    def __call__(self, loop: rollout.Loop, plant: Any, inputs: Any, dt: float, substeps: int) -> None:
        self.setpoints.append(inputs[0])
        if isinstance(inputs[0], list):
            assert all(isinstance(values, list) for values in loop.stage.friction.operators)
            assert isinstance(plant.stops, list)
            if self.error:
                raise self.error


@pytest.mark.parametrize(
    ("error", "kinds"),
    [(None, [list]), (OverflowError(), [list, np.ndarray]), (ValueError("nan"), [list, np.ndarray])],
)
def test_what_cannot_be_interpreted_is_compiled(
    error: Exception | None, kinds: list[type], ball_screw: Setup, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, calls, ahead = Run(ball_screw, Sine(0.001, 3.2, 0.5, 0.5)), Calls(error), [True]
    monkeypatch.setattr(rollout, "closed_loop", calls)
    monkeypatch.setattr(simulation, "interprets", lambda values: ahead[0])
    monkeypatch.setattr(simulation, "interpret_first", lambda rows: ahead.__setitem__(0, rows > 0))
    simulation.simulate(run.setup, run.plan, run.law)
    assert [type(setpoint) for setpoint in calls.setpoints] == kinds
    assert ahead[0] is (error is None)


def test_rows_are_counted_in_whatever_holds_them() -> None:
    rows = np.zeros((7, 3))
    for values in ((rows,), (rows.tolist(),), (1.0, (rows[:2], (rows,))), (rollout.Loop(rows, 0.0),)):  # type: ignore[arg-type]
        assert jit._rows(values) == 7
    assert jit._rows((1.0, ())) == 1


def test_numba_once_loaded_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit._Process, "rows", 0)
    monkeypatch.setattr(jit._Process, "loaded", False)
    jit.interpret_first(10)
    assert jit.interprets((np.zeros(10),)) and not jit.interprets((np.zeros(11),))
    monkeypatch.setattr(jit._Process, "loaded", True)
    jit.interpret_first(10)
    assert not jit.interprets((np.zeros(1),))
