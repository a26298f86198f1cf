"""A spring pulls from its own centre: no constant force is named for where that is."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from stagectl.config.stage_file import load_stage
from stagectl.gap.effects.effect import Definition
from stagectl.gap.effects.library import definitions
from stagectl.gap.inference import cable_centre
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.refine import Fitted
from stagectl.kernels import transmission
from tests.gap.captured import CONFIG
from tests.gap.test_candidates import SIZE

STIFFNESS = 2e-3  # N m/rad
NOTHING: Any = None


def fitted(bias: float) -> Fitted:
    spring: Definition = next(each for each in definitions(SIZE) if each.name == "cable_spring")
    stage = load_stage(CONFIG / "ball-screw.yaml").stage
    model = TrackedModel(stage._replace(mechanics=stage.mechanics._replace(bias=bias)), NOTHING)
    return Fitted(model, (EffectValues(spring, {"stiffness": STIFFNESS, "centre": SIZE.centre}),), [], 0.0)


def centred(now: Fitted) -> Fitted:
    prior = SimpleNamespace(moved=lambda model, _: model.stage.mechanics.bias, width=lambda _: 0.3)
    return cable_centre.centred(cast("Any", SimpleNamespace(base=SimpleNamespace(prior=prior))), now)


def forces(now: Fitted) -> list[float]:
    p = now.equipped.stage.mechanics
    return [transmission.pulled(p, x, 0.0) - p.bias for x in (-3.0, 0.0, 5.0)]


def test_a_constant_force_that_a_centre_within_the_travel_gives_is_the_springs() -> None:
    now = fitted(bias := 0.5 * STIFFNESS * SIZE.stroke)
    after = centred(now)
    assert after.model.stage.mechanics.bias == 0.0 and forces(after) == pytest.approx(forces(now))
    assert after.effects[0].values["centre"] == pytest.approx(SIZE.centre + bias / STIFFNESS)


def test_a_centre_far_outside_the_travel_is_a_bias() -> None:
    now = fitted(20.0 * STIFFNESS * SIZE.stroke)
    after = centred(now)
    assert after.model == now.model and after.effects[0].values == now.effects[0].values


def test_the_odds_are_those_of_two_densities() -> None:
    """Centre alone: a normal deviate of 1; with a bias: of the root of 1 + 3."""
    assert cable_centre.bias_odds(0.0, 1.0, 3.0**0.5) == pytest.approx(0.5)
    assert cable_centre.bias_odds(2.0, 1.0, 3.0**0.5) == pytest.approx(0.5 * 2.718281828**1.5)


def test_the_centre_is_as_uncertain_as_force_and_stiffness_say() -> None:
    """Beside a bias that is off, the centre is anywhere in the travel."""
    known = {"bias": 1e-3, "cable_spring.stiffness": 1e-4}
    after = centred(fitted(0.5 * STIFFNESS * SIZE.stroke))
    away = 0.5 * SIZE.stroke
    expected = (1e-3**2 + (1e-4 * away) ** 2) ** 0.5 / STIFFNESS
    assert cable_centre.with_centre(after, known)["cable_spring.centre"] == pytest.approx(expected)
    assert cable_centre.with_centre(fitted(1.0), known)["cable_spring.centre"] == pytest.approx(SIZE.stroke)
