"""The bristle beside the stop operators: its range, exponent and damping come out of the data, and not from a grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.config.stage_file import load_stage
from stagectl.gap import diagnose
from stagectl.gap.effects.library import definitions
from stagectl.gap.logs import load_session
from stagectl.gap.logs.session import Session
from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.sensitivities import TrackedModel, model_of
from stagectl.gap.residuals.thresholds import LONGEST_SLIP
from stagectl.gap.selection import bristle_shape, refine, thresholds
from stagectl.gap.selection.bristle_members import shaped_as
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.refine import Evidence
from stagectl.kernels import friction_bristle
from stagectl.kernels.fields import put
from tests.gap.captured import CONFIG, as_csv

MOTIONS = ("sine-2um", "sine-0.8hz")  # within the rolling zone, and far beyond it


def fitted(change: dict[str, object], folder: Path) -> tuple[Session, Evidence]:
    """Logs of the ball screw with this `change`, and the baseline fit to them."""
    stage = sc.load_stage(CONFIG / "ball-screw.yaml")
    machine = stage.changed({**change, "simulation.current_noise": 20e-3})
    paths = [CONFIG / "trajectories" / f"{name}.yaml" for name in MOTIONS]
    logs = [as_csv(sc.simulate(stage, path, plant=machine), folder / f"{path.stem}.csv") for path in paths]
    session = load_session.load(logs, stage.setup)
    return session, diagnose.baseline(session, ())


@pytest.mark.parametrize(("length", "exponent"), [(9e-4, 1.0), (6e-4, 1.6)])
def test_a_law_of_one_bristle_is_fitted_by_its_shape(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, length: float, exponent: float
) -> None:
    """Better than by the best of the grid; the stop operators, which could stand for a part of it, carry little."""
    law: dict[str, object] = {"law": "dahl", "coulomb": 1.0, "range": length, "exponent": exponent}
    _, found = fitted({"friction": law}, tmp_path)
    monkeypatch.setattr(thresholds, "SHAPE_STEPS", 0)
    _, coarse = fitted({"friction": law}, tmp_path)
    left, left_by_grid = (refine.total(e, e.base.after) for e in (found, coarse))
    carried, by_grid = (sum(e.base.model.stage.friction.operators.weight) for e in (found, coarse))
    assert left < 0.8 * left_by_grid and carried < 0.9 * by_grid


def test_the_damping_of_a_bristle_is_found(tmp_path: Path) -> None:
    """That of an ordinary LuGre stage: without it, neither a bristle nor stop operators fit."""
    law: dict[str, object] = {"law": "lugre", "coulomb": 1.0, "range": 2.4e-3, "damping": 1.0}
    _, e = fitted({"friction": law}, tmp_path)
    found = e.base.model.stage.friction.bristle
    assert found.damping == pytest.approx(1.0, rel=0.1) and found.exponent == pytest.approx(1.0, abs=0.1)
    assert found.coulomb > 0.75


def test_stop_operators_take_no_bristle(tmp_path: Path) -> None:
    law: dict[str, object] = {"law": "stop-operators", "weight": [0.3, 0.4, 0.3], "slip": [2e-4, 1e-3, 4e-3]}
    _, e = fitted({"friction": law}, tmp_path)
    assert e.base.model.stage.friction.bristle.coulomb < 0.1


def test_a_bristle_gives_back_what_belongs_to_an_effect(tmp_path: Path) -> None:
    """Without the effect the baseline fit bends a bristle to it; beside the effect that bristle is not wanted."""
    session, e = fitted({"mechanics.viscous_power": {"effort": 0.25, "exponent": 0.5}}, tmp_path)
    taken = e.base.model.stage.friction.bristle.coulomb
    effect = next(one for one in definitions(diagnose.scales_of(session, e)) if one.name == "viscous_nonlinear")
    after = refine.refine(e, e.base.model, [EffectValues(effect, {"size": 0.1, "exponent": 0.5})], 20)
    power = after.equipped.stage.mechanics.viscous_power
    assert taken > 0.05 and after.model.stage.friction.bristle.coulomb < 0.2 * taken
    at_one = power.effort * power.speed**-power.exponent
    assert power.exponent == pytest.approx(0.5, abs=0.03) and at_one == pytest.approx(0.25, rel=0.05)


def test_a_bristle_gives_back_the_shape_that_a_cable_gave_it(tmp_path: Path) -> None:
    """Without the cable its rolling zone grows to the end of the range; beside the cable it is the machine's own."""
    law: dict[str, object] = {"law": "dahl", "coulomb": 1.0, "range": 9e-4, "exponent": 1.0}
    cable = {"hysteresis": 0.2, "slip": 0.5, "exponent": 1.0}
    session, e = fitted({"friction": law, "mechanics.cable": cable}, tmp_path)
    nominal = friction_family.length(session.stage.friction)
    assert friction_family.zone(e.base.model.stage.friction.bristle) <= 1.001 * LONGEST_SLIP * nominal
    effect = next(one for one in definitions(diagnose.scales_of(session, e)) if one.name == "cable_hysteresis")
    alone = refine.refine(e, e.base.model, [EffectValues(effect, {"effort": 0.1, "slip": 0.3, "exponent": 0.5})], 20)
    beside = bristle_shape.beside_effects(e, alone)
    values, way = beside.effects[0].values, np.geomspace(1e-4, 2e-2, 20)
    assert beside.residual_sum_of_squares < 0.9 * alone.residual_sum_of_squares
    assert values["effort"] == pytest.approx(0.2, rel=0.05) and values["slip"] == pytest.approx(0.5, rel=0.1)
    true = 2.0 * (1.0 - np.exp(-way / 9e-4))  # N m after a reversal of the machine's friction alone
    error, before = (
        np.abs(friction_family.reversal(m.stage.friction, way) - true).max() for m in (beside.model, e.base.model)
    )
    assert error < 0.05 and error < 0.5 * before


def test_a_rolling_zone_is_the_way_on_which_all_but_a_twentieth_reverses() -> None:
    for exponent in (0.5, 1.0, 2.7):
        law = friction_bristle.Bristle(0.8, 800.0, exponent)
        way = friction_family.zone(law)
        _, deflection = friction_bristle.bent(law, -1e-3, 1.0, way, 1.0)
        assert 800.0 * deflection == pytest.approx(0.8 * (1.0 - 2.0 * 0.05), rel=1e-9)


@pytest.mark.parametrize(("own", "other", "expected"), [(0.4, 0.8, 0.4), (0.0, 0.8, 0.0), (0.4, 0.0, 0.4)])
def test_a_bristle_takes_the_shape_of_another_and_keeps_its_force(own: float, other: float, expected: float) -> None:
    def model(coulomb: float, exponent: float) -> TrackedModel:
        bristle = friction_bristle.Bristle(coulomb, 100.0 * exponent, exponent)
        return model_of(put(load_stage(CONFIG / "ball-screw.yaml").stage, "friction.bristle", bristle), 5e-4)

    m, shape = model(own, 1.0), model(other, 2.0)
    taken = shaped_as(m, shape).stage.friction.bristle
    assert taken.coulomb == expected
    if own and other:
        assert taken.exponent == 2.0
        assert friction_family.zone(taken) == pytest.approx(friction_family.zone(shape.stage.friction.bristle))
    else:
        assert taken == m.stage.friction.bristle
