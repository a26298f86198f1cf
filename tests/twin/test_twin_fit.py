"""The twin's estimates from normal equations that are made by hand, and its candidates one by one."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.kernels import friction, friction_bristle, stage
from stagectl.twin import candidates, estimate
from stagectl.twin.candidates import TwinCandidate
from stagectl.twin.live_model import NormalEquations
from stagectl.twin.thresholds import NUDGE

INERTIA = TwinCandidate("inertia", "kg m^2 | kg", 0.01, 0.01, 0.03, 0.3, "%")
VISCOUS = TwinCandidate("viscous", "N m s/rad | N s/m", 0.14, 0.14, 0.03, 0.3, "%")
BOTH = (INERTIA, VISCOUS)


def blocks(theta: tuple[float, float], noise: float, mixed: float = 0.0, seed: int = 1) -> list[NormalEquations]:
    """32 blocks of 100 rows; the second column holds `mixed` of the first."""
    source = np.random.default_rng(seed)
    equations = []
    for _ in range(32):
        columns = source.standard_normal((100, 2))
        columns[:, 1] = mixed * columns[:, 0] + np.sqrt(1.0 - mixed * mixed) * columns[:, 1]
        target = columns @ np.array(theta) + noise * source.standard_normal(100)
        equations.append(NormalEquations(columns.T @ columns, columns.T @ target, float(target @ target), 100))
    return equations


def test_a_drift_is_found_with_its_error() -> None:
    """Of 3200 rows: noise over their root, within a quarter by 16 clusters."""
    fit = estimate.fit(BOTH, blocks((0.2, 0.0), 0.1))
    inertia, viscous = fit.drifts
    assert inertia.size == pytest.approx(0.2, abs=4.0 * inertia.error)
    assert inertia.error == pytest.approx(0.1 / np.sqrt(3200.0), rel=0.5)
    assert inertia.value == pytest.approx(0.01 * 1.2, rel=0.01) and inertia.determined
    assert [named.drift.candidate.name for named in fit.named] == ["inertia"]
    assert not viscous.significant
    assert fit.after == pytest.approx(0.1, rel=0.05)


def test_an_immaterial_drift_is_not_named_however_sure() -> None:
    fit = estimate.fit(BOTH, blocks((0.02, 0.0), 0.01))
    assert fit.drifts[0].size > 10.0 * fit.drifts[0].error
    assert fit.named == ()


def test_what_explains_the_data_as_well_is_an_alternative() -> None:
    (named,) = estimate.fit(BOTH, blocks((0.2, 0.0), 0.1, mixed=0.99)).named
    assert named.drift.candidate.name == "inertia" and named.alternatives == ("viscous",)


def test_what_the_motion_does_not_excite_keeps_its_prior() -> None:
    still = [
        NormalEquations(block.gram * np.array([[1.0, 0.0], [0.0, 1e-12]]), block.cross * np.array([1.0, 1e-12]), *rest)
        for block in blocks((0.2, 0.0), 0.1)
        for rest in [(block.power, block.rows)]
    ]
    viscous = estimate.fit(BOTH, still).drifts[1]
    assert abs(viscous.size) < 0.01 and viscous.error == pytest.approx(0.3, rel=0.05) and not viscous.determined


def test_each_candidate_moves_its_parameter_by_a_step_of_its_scale(ball_screw: Setup) -> None:
    p = ball_screw.stage
    changed = {candidate.name: change(p) for candidate, change in candidates.of_mechanics(p, 5e-4)}
    assert changed["inertia"].mechanics.inertia == pytest.approx((1.0 + NUDGE) * p.mechanics.inertia)
    assert changed["viscous"].mechanics.viscous == pytest.approx((1.0 + NUDGE) * p.mechanics.viscous)
    assert changed["bias"].mechanics.bias - p.mechanics.bias == pytest.approx(NUDGE * stage.sliding(p.friction))
    assert stage.sliding(changed["coulomb"].friction) == pytest.approx((1.0 + NUDGE) * stage.sliding(p.friction))
    assert changed["force_constant"].motor.force_constant == pytest.approx((1.0 + NUDGE) * p.motor.force_constant)
    assert changed["time_shift"] is p
    longer = candidates.friction_length(changed["presliding"].friction)
    assert longer == pytest.approx((1.0 + NUDGE) * candidates.friction_length(p.friction))


def test_another_curve_keeps_the_friction(ball_screw: Setup) -> None:
    p = ball_screw.stage
    bent = next(change for candidate, change in candidates.of_mechanics(p, 5e-4) if candidate.name == candidates.BEND)
    assert stage.sliding(bent(p).friction) == pytest.approx(stage.sliding(p.friction), rel=1e-9)
    assert np.argmax(bent(p).friction.operators.weight / p.friction.operators.weight) == np.argmax(
        p.friction.operators.slip
    )


def test_a_model_without_friction_has_no_candidate_of_its_form(ball_screw: Setup) -> None:
    none = stage.Friction(friction.bundle([0.0], [1.0]), friction.Stribeck())
    names = [candidate.name for candidate, _ in candidates.of_mechanics(ball_screw.stage._replace(friction=none), 5e-4)]
    assert names == ["inertia", "viscous", "bias", "time_shift", "force_constant"]


def test_the_length_of_friction() -> None:
    operators = friction.bundle([1.0, 0.0], [3e-6, 9e-6])
    assert candidates.friction_length(stage.Friction(operators, friction.Stribeck())) == 3e-6
    bristle = friction_bristle.Bristle(2.0, 1e6)
    none = friction.bundle([0.0], [1.0])
    assert candidates.friction_length(stage.Friction(none, friction.Stribeck(), bristle)) == pytest.approx(6e-6)
