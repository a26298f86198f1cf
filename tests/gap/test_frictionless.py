"""Axes on air: a model without friction, and a machine that has lost its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.gap import diagnose
from stagectl.gap.logs import load_session
from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.result.diagnosis import DiagnosisResult
from stagectl.gap.selection import null_ensemble
from stagectl.kernels import friction, stage
from tests.conftest import movable
from tests.gap.captured import CONFIG, SINE, TRAPEZOID, recorded
from tests.gap.drawn import by_night

NOMINAL = movable((CONFIG / "ball-screw.yaml").read_text())
ON_AIR = NOMINAL.replace("coulomb: 1.0 N m", "coulomb: 0 N m")


def diagnosed(place: Path, machine: str, model: str) -> DiagnosisResult:
    """The diagnosis of logs of `machine` with the nominal model `model`."""
    (place / "machine.yaml").write_text(machine)
    (place / "model.yaml").write_text(model)
    paths = [path for text in (SINE, TRAPEZOID) for path in recorded(place, text, 2, place / "machine.yaml")]
    session = load_session.load(paths, load_stage(place / "model.yaml"))
    return diagnose.diagnose(session, diagnose.Options(), lambda _: None).result


@pytest.mark.parametrize(
    ("name", "old", "new", "value"),
    [
        pytest.param("viscous", "viscous: 0.14 N m s/rad", "viscous: 0.168 N m s/rad", 0.168, marks=by_night),
        ("coulomb", "coulomb: 0 N m", "coulomb: 50 mN m", 0.05),
    ],
)
def test_a_model_without_friction(tmp_path: Path, name: str, old: str, new: str, value: float) -> None:
    assert old in ON_AIR
    diagnosis = diagnosed(tmp_path, ON_AIR.replace(old, new), ON_AIR)
    assert diagnosis.verdict == "parameters"
    (effect,) = diagnosis.effects
    assert effect.name == name and effect.parameters[name].value == pytest.approx(value, rel=0.01)
    assert diagnosis.gap.closure > 0.95


def test_a_machine_without_the_friction_of_its_model(tmp_path: Path) -> None:
    """No statement on the rolling zone of a machine without friction."""
    diagnosis = diagnosed(tmp_path, ON_AIR, NOMINAL)
    assert diagnosis.verdict == "parameters"
    (effect,) = diagnosis.effects
    assert effect.name == "coulomb" and effect.parameters["change"].value == pytest.approx(-1.0, abs=1e-3)


def test_machines_with_another_law_where_the_refit_has_left_no_friction() -> None:
    """They are as strong as the nominal machine; no division by the stiffness of a bristle that carries nothing."""
    p = load_stage(CONFIG / "ball-screw.yaml").stage
    none = p._replace(friction=p.friction._replace(operators=friction.bundle([0.0, 0.0], [1e-4, 1e-3])))
    assert friction_family.size(p) == stage.sliding(p.friction) and friction_family.length(none.friction) == 1e-3
    assert friction_family.size(none) == pytest.approx(0.01 * p.motor.force_constant)
    model = TrackedModel(none, None, 0.0)  # type: ignore[arg-type]
    laws = [member.change(model).stage.friction for member in null_ensemble.members(model, 6, 1, 2.0)]
    assert np.allclose([stage.sliding(law) for law in laws], 2.0)
