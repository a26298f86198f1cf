"""What a refit hides, with predictions whose dependence on the nuisances is known."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.gap.experiment_design import nuisance_refit
from stagectl.gap.experiment_design.nuisance_refit import Linearised, Nuisance
from stagectl.gap.experiment_design.prediction_distance import Prediction

RUN: Any = SimpleNamespace(rollout=SimpleNamespace(dt=1e-3))
START: Any = 0.0  # a model is a number here, and its prediction a curve over it


def test_what_the_slopes_span_is_hidden() -> None:
    slopes = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    value = np.zeros(3)
    assert nuisance_refit.linear_distance(value, slopes, np.array([0.3, 0.4, 5.0])) == pytest.approx(5.0)
    assert nuisance_refit.linear_distance(value, slopes, np.array([0.3, 0.4, 0.0])) == pytest.approx(0.0, abs=1e-6)


def test_a_nuisance_moves_no_farther_than_it_may() -> None:
    """By 1/2 at most: of 3 there remain 2.5."""
    slopes = np.array([[1.0, 0.0]])
    assert nuisance_refit.linear_distance(np.zeros(2), slopes, np.array([3.0, 0.0])) == pytest.approx(2.5, rel=1e-6)


def predicted(model: float) -> np.ndarray:
    return np.array([math.sin(model), model * model, 1.0])


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> list[Nuisance]:
    monkeypatch.setattr(nuisance_refit, "predict", lambda run, model, shift=0.0: Prediction(predicted(model), 1.0))
    return [Nuisance("x", lambda model, amount: model + amount)]  # type: ignore[operator]


def at(model: float) -> Linearised:
    """The prediction with its exact slope, and one of the time shift that moves nothing."""
    return Linearised(START, predicted(model), np.array([[math.cos(model), 2.0 * model, 0.0], np.zeros(3)]), 1.0)


def test_a_refit_reaches_what_is_hidden_and_keeps_what_is_not(free: list[Nuisance]) -> None:
    hidden = predicted(0.8)
    assert nuisance_refit.refitted_distance(RUN, at(0.0), free, hidden) == 0.0
    apart = hidden + np.array([0.0, 0.0, 3.0])
    assert nuisance_refit.refitted_distance(RUN, at(0.0), free, apart) == pytest.approx(3.0, rel=0.02)


def test_a_refit_that_leads_nowhere_returns_the_distance_it_began_with(free: list[Nuisance]) -> None:
    truth = predicted(0.0) + np.array([0.0, 0.0, 2.0])
    assert nuisance_refit.refitted_distance(RUN, at(0.0), free, truth) == pytest.approx(2.0)


def test_a_nuisance_that_takes_the_axis_from_its_loop_ends_the_refit(free: list[Nuisance]) -> None:
    """Its slope is no number; an exam's answer ended in a traceback."""
    lost = at(0.0)._replace(slopes=np.full((2, 3), math.nan))
    truth = predicted(0.0) + np.array([0.0, 0.0, 2.0])
    assert nuisance_refit.refitted_distance(RUN, lost, free, truth) == pytest.approx(2.0)


def test_a_step_out_of_the_loop_tells_no_slope(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first step is half; from 0.4 on the axis leaves its loop.  A shorter step still reaches the truth at 0.2."""

    def predict(run: object, model: float, shift: float = 0.0) -> Prediction:
        return Prediction(predicted(model) * (1e200 if model > 0.4 else 1.0), 1.0)

    monkeypatch.setattr(nuisance_refit, "predict", predict)
    moving = [Nuisance("x", lambda model, amount: model + amount)]  # type: ignore[operator]
    flat = at(0.0)._replace(slopes=np.array([[0.1, 0.0, 0.0], np.zeros(3)]))
    with np.errstate(over="raise"):
        assert nuisance_refit.refitted_distance(RUN, flat, moving, predicted(0.2)) == 0.0


def test_what_may_be_refitted(ball_screw: Setup) -> None:
    p = ball_screw.stage
    names = [nuisance.name for nuisance in nuisance_refit.nuisances(p, False)]
    assert names == ["inertia", "bias", "viscous", "coulomb", "length"]
    weights = [nuisance for nuisance in nuisance_refit.nuisances(p, True) if nuisance.name.startswith("weights_")]
    assert 1 <= len(weights) <= 8
    none = p.friction._replace(
        operators=p.friction.operators._replace(weight=0.0 * p.friction.operators.weight),
        bristle=p.friction.bristle._replace(coulomb=0.0),
    )
    bare = p._replace(friction=none, mechanics=p.mechanics._replace(viscous=0.0))
    assert [nuisance.name for nuisance in nuisance_refit.nuisances(bare, True)] == ["inertia", "bias"]


def test_a_nuisance_moves_its_parameter_by_its_own_size(ball_screw: Setup) -> None:
    p = ball_screw.stage
    inertia = nuisance_refit.nuisances(p, False)[0].moved(p, math.log(1.1))
    assert inertia.mechanics.inertia == pytest.approx(1.1 * p.mechanics.inertia)
