"""How long the rolling zone is: no other law of friction is another length."""

from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.gap.inference import rolling_zone
from stagectl.gap.inference.value_errors import Errors
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.selection.refine import Fitted
from stagectl.kernels import friction, stage
from tests.gap.captured import CONFIG

NOTHING: Any = None


def test_each_tenth_of_the_friction_turns_round_after_a_tenth_of_its_length() -> None:
    """One stop operator of 3 um: straight to its end, after twice its slip."""
    p = stage.Friction(friction.bundle([2.0], [3e-6]), friction.Stribeck())
    assert rolling_zone.turning_points(p) == pytest.approx(np.arange(1, 10) * 0.6e-6, rel=0.02)


def fitted(slips: list[float]) -> Fitted:
    p = load_stage(CONFIG / "ball-screw.yaml").stage
    return Fitted(TrackedModel(p._replace(friction=friction_of(slips)), NOTHING), (), [], 0.0)


def test_a_stretch_is_a_length_and_another_law_an_error_of_it() -> None:
    """All elements half as long again; and about as long on the average, but all of one length."""
    known = Errors(NOTHING, (), np.empty((0, 0)), NOTHING, NOTHING)
    before = friction_of([1e-6, 4e-6, 1e-5])
    longer = rolling_zone.lengths(before, fitted([1.5e-6, 6e-6, 1.5e-5]), known, None)[0]
    assert longer.value == pytest.approx(1.5 * longer.nominal, rel=0.01) and longer.deviation < 0.01 * longer.value
    other = rolling_zone.lengths(before, fitted([3e-6, 4e-6, 5e-6]), known, None)[0]
    assert other.deviation > abs(other.value - other.nominal)


def test_a_rise_at_rest_makes_the_zone_longer_or_not() -> None:
    """Two thirds as long, under a friction that holds half as much again at rest: it ends where it did."""
    before, now = friction_of([3e-6, 6e-6]), fitted([2e-6, 4e-6])
    rising = now.model.stage.friction._replace(stribeck=friction.Stribeck(0.5, 1.0))
    model = now.model._replace(stage=now.model.stage._replace(friction=rising))
    none = Errors(NOTHING, (), np.empty((0, 0)), NOTHING, NOTHING)
    plain, risen = rolling_zone.lengths(before, now._replace(model=model), none, None)
    assert plain.value == pytest.approx(2.0 / 3.0 * plain.nominal, rel=0.01)
    assert risen.value == pytest.approx(risen.nominal, rel=0.01)


def friction_of(slips: list[float]) -> stage.Friction:
    return stage.Friction(friction.bundle([1.0] * len(slips), slips), friction.Stribeck())


def test_the_rolling_zone_is_as_uncertain_as_its_elements() -> None:
    """Three elements of equal weight turn round one after the other: more of the longest, and all is later.

    Errors that are common to all elements change the friction, and not its length.
    """
    now, names = fitted([1e-6, 4e-6, 1e-5]), tuple(f"weight_{k}" for k in range(3))
    error = {}
    for size in (0.0, 0.01, 0.02):
        of_last = np.diag([0.0, 0.0, size**2])
        error[size] = rolling_zone._of_elements(now, Errors(NOTHING, names, of_last, NOTHING, NOTHING), None)
    assert error[0.0] == 0.0 < error[0.01] and error[0.02] == pytest.approx(2.0 * error[0.01], rel=0.2)
    common = Errors(NOTHING, names, np.full((3, 3), 0.02**2), NOTHING, NOTHING)
    assert rolling_zone._of_elements(now, common, None) < 0.1 * error[0.02]
