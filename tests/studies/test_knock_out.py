"""Knocks: what is taken out of the model, what is added to the record, and when an answer is right."""

from pathlib import Path

import numpy as np
import pytest
from stagectl_studies import knock_out

from stagectl.config.stage_file import load_stage
from stagectl.gap import diagnose
from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.session import GapError, Session
from stagectl.gap.result.diagnosis import DiagnosisResult, FoundEffect, Gap
from stagectl.kernels.stage import sliding

ROOT = Path(__file__).resolve().parents[2]
EMPS = ROOT.parent / "shared" / "data" / "emps" / "DATA_EMPS.mat"
pytestmark = pytest.mark.skipif(not EMPS.exists(), reason="the EMPS record is not beside this repository")


@pytest.fixture(scope="module")
def session() -> Session:
    return load([EMPS], load_stage(ROOT / "config" / "emps.yaml"))


def test_out(session: Session) -> None:
    models = {knock.name: knock.session.stage for knock in knock_out.out(session)}
    assert set(models) == {"viscous", "coulomb", "bias", "inertia"}
    assert models["viscous"].mechanics.viscous == 0.0 and models["bias"].mechanics.bias == 0.0
    assert models["inertia"].mechanics.inertia == pytest.approx(0.8 * 95.1089)
    assert sliding(models["coulomb"].friction) == pytest.approx(0.02 * 20.3935)
    calm = session._replace(stage=models["bias"])
    assert "bias" not in {knock.name for knock in knock_out.out(calm)}


@pytest.mark.parametrize("name", sorted(knock_out.FORCES))
def test_into(session: Session, name: str) -> None:
    """The added force has the share of the rms that was asked for, and no controller is known any more."""
    (knock,) = knock_out.into(session, [name], 0.03)
    before, after = session.logs[0].command, knock.session.logs[0].command
    assert before is not None and after is not None
    assert float(np.sqrt(np.mean((after - before) ** 2))) == pytest.approx(
        0.03 * float(np.sqrt(np.mean(before**2))), rel=1e-9
    )
    assert knock.session.law is None and knock.session.logs[0].setpoints is None
    assert np.array_equal(knock.session.logs[0].position, session.logs[0].position)


def test_a_force_is_one_law_over_all_logs(session: Session) -> None:
    """A second log further on the axis and later: the same spring about the same middle, one step on one clock."""
    first = session.logs[0]
    away, later = float(np.ptp(first.position)), first.rows * session.dt
    second = first._replace(name="later", position=first.position + away, start=first.start + later)
    both = session._replace(logs=(first, second))

    def added(name: str) -> list[np.ndarray]:
        (knock,) = knock_out.into(both, [name], 0.03)
        assert first.command is not None
        return [log.command - first.command for log in knock.session.logs if log.command is not None]

    near, far = added("cable_spring")
    assert np.mean(far - near) == pytest.approx(float(np.max(far) - np.min(near)) / 2.0, rel=0.02)
    before, after = added("friction_step")
    assert not before.any() and after.any()


def test_unknown_force(session: Session) -> None:
    with pytest.raises(GapError) as refused:
        knock_out.into(session, ["wind"], 0.1)
    (problem,) = refused.value.problems
    assert (problem.key, problem.value) == ("--into", "wind") and "cable_spring" in problem.choices


def test_right(session: Session) -> None:
    gap = Gap(1.0, 0.1, 0.0, "N", 0.99, 0.9, 1.0)
    diagnosis = DiagnosisResult("effects", "", (), gap, {}, {}, (), (), ())
    named = diagnosis._replace(effects=(FoundEffect("stribeck", ("dwell",), 0.9, 0.5, {}),))
    knock = knock_out.Knock("dwell", "in", session)
    assert knock_out.judged(knock, named).right and knock_out.judged(knock, named).named == (("stribeck", "dwell"),)
    assert not knock_out.judged(knock, diagnosis).right
    already = diagnosis._replace(effects=(FoundEffect("dwell", (), 0.9, 0.5, {}),))
    assert not knock_out.judged(knock, named, already).right


def test_what_was_taken_out_is_named_on_a_real_record(session: Session) -> None:
    """A fifth of the mass; the record as it is: `tests/gap/test_measured_records.py`."""
    mass = next(knock for knock in knock_out.out(session) if knock.name == "inertia")
    lighter = diagnose.diagnose(mass.session, diagnose.Options(advice=False), lambda _: None).result
    lacked = {effect.name: effect for effect in lighter.named}["inertia"].parameters["inertia"]
    assert lacked.value == pytest.approx(95.1, rel=0.03)
