"""Compensators in a stage file: read strictly with units, and refused where they contradict themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.api.arguments import ArgumentError
from stagectl.compensation.forms import Model
from stagectl.compensation.rolling import GeneralisedMaxwell, ReversalTable, RheologySpring
from stagectl.config.source import ConfigError
from stagectl.config.stage_file import load_stage
from stagectl.identification.capture import IdentificationError, Refusal
from stagectl.identification.methods import with_compensators
from stagectl.identification.result import IdentificationResult
from stagectl.problem import ProblemKind
from tests.conftest import CONFIG
from tests.problems import refused

SEVERAL = """
compensation:
  form: table
  displacement: [0 um, 2 um, 6 um, 20 um]
  force: [-1 N m, -0.2 N m, 0.5 N m, 1 N m]
compensators:
  gms:
    weight: [0.4 N m, 0.6 N m]
    slip: [1 um, 5 um]
    stribeck: {rise: 0.2, velocity: 10 mm/s}
  rheology: {coulomb: 1 N m, range: 16 um, exponent: 1.5}
"""
UM = 1e-6 * 2.0 * np.pi / 0.012  # rad of the screw


def stage_with(folder: Path, block: str) -> Path:
    path = folder / "stage.yaml"
    path.write_text((CONFIG / "ball-screw.yaml").read_text() + block)
    return path


def test_compensators_are_read_with_their_units(tmp_path: Path) -> None:
    file = load_stage(stage_with(tmp_path, SEVERAL)).file
    assert isinstance(file.compensation, ReversalTable)
    assert file.compensation.displacement == pytest.approx((0.0, 2 * UM, 6 * UM, 20 * UM))
    assert (file.compensation.force[0], file.compensation.inner_loops) == (-1.0, "continue")
    assert isinstance(file.compensators.gms, GeneralisedMaxwell)
    assert file.compensators.gms.stribeck.velocity == pytest.approx(1e4 * UM)
    assert isinstance(file.compensators.rheology, RheologySpring)
    assert tuple(file.compensators.rheology[:3]) == pytest.approx((1.0, 16 * UM, 1.5))
    assert file.compensators.table is None


@pytest.mark.parametrize(
    ("written", "changed", "kind", "key"),
    [
        ("[0 um, 2 um, 6 um, 20 um]", "[0 um, 6 um, 2 um, 20 um]", ProblemKind.CONFLICT, "compensation.displacement"),
        ("[0 um, 2 um, 6 um, 20 um]", "[1 um, 2 um, 6 um, 20 um]", ProblemKind.CONFLICT, "compensation.displacement"),
        ("[0 um, 2 um, 6 um, 20 um]", "[0 um, 20 um]", ProblemKind.CONFLICT, "compensation.force"),
        ("0.5 N m, 1 N m]", "0.5 N m, 2 N m]", ProblemKind.CONFLICT, "compensation.force"),
        ("-0.2 N m, 0.5 N m", "0.5 N m, -0.2 N m", ProblemKind.CONFLICT, "compensation.force"),
        ("-0.2 N m", "-0.2", ProblemKind.UNIT, "compensation.force[1]"),
        ("slip: [1 um, 5 um]", "slip: [1 um]", ProblemKind.CONFLICT, "compensators.gms.weight"),
        ("exponent: 1.5", "exponent: 9", ProblemKind.RANGE, "compensators.rheology.exponent"),
        ("exponent: 1.5", "power: 1.5", ProblemKind.UNKNOWN, "compensators.rheology.power"),
        ("form: table", "form: tables", ProblemKind.VALUE, "compensation.form"),
    ],
)
def test_what_a_compensator_cannot_be_is_refused(
    tmp_path: Path, written: str, changed: str, kind: ProblemKind, key: str
) -> None:
    assert written in SEVERAL
    with refused(ConfigError, kind=kind, key=key):
        load_stage(stage_with(tmp_path, SEVERAL.replace(written, changed)))


def test_without_takes_the_name_of_the_compensator_that_acts(tmp_path: Path) -> None:
    stage, sine = sc.load_stage(stage_with(tmp_path, SEVERAL)), CONFIG / "trajectories" / "sine-3.2hz.yaml"
    named, layer = (sc.simulate(stage, sine, without=[name]) for name in ("table", "friction"))
    assert named.recording.samples.tobytes() == layer.recording.samples.tobytes()
    assert np.ptp(sc.simulate(stage, sine).recording.samples["friction"]) > 1.0
    with pytest.raises(ArgumentError) as caught:
        sc.simulate(stage, sine, without=["gms"])
    assert (caught.value.name, caught.value.value) == ("without", "gms")


FOUND = IdentificationResult(
    {}, changes={"friction": {"law": "stop-operators", "weight": [0.4, 0.6], "slip": [1e-3, 3e-3]}}
)


def test_an_identification_writes_compensators(tmp_path: Path) -> None:
    """The table of stop operators bends where they slip after a full reversal: at twice their slips."""
    changes = with_compensators(FOUND, "simultaneous", "table", ["gms", "rheology"]).changes
    stage = sc.load_stage(CONFIG / "ball-screw.yaml")
    assert isinstance(stage.setup.file.compensation, Model)
    path = tmp_path / "written.yaml"
    stage.changed(changes).save(path)
    file = load_stage(path).file
    assert file.compensation.displacement == pytest.approx((0.0, 2e-3, 6e-3), rel=1e-6)
    assert file.compensation.force == pytest.approx((-1.0, 0.2, 1.0), rel=1e-6)
    assert file.compensators.gms is not None
    assert file.compensators.gms.weight == pytest.approx((0.4, 0.6), rel=1e-6)
    assert file.compensators.rheology is not None
    assert file.compensators.rheology.coulomb == pytest.approx(1.0)


def test_a_method_without_friction_makes_no_compensator() -> None:
    for result, name in ((IdentificationResult({}), "table"), (FOUND, "model")):
        with pytest.raises(IdentificationError) as caught:
            with_compensators(result, "constant-speed", name, ())
        assert (caught.value.reason, caught.value.value) == (Refusal.UNKNOWN_OPTION, name)
    assert with_compensators(FOUND, "simultaneous", None, ()) is FOUND
