"""Measured records: nothing absurd is said of any, and what is said is near what others found with these machines.

The same logs in other units, mirrored, later, shifted or in another order have the same answer: all changes are made at
once, as an answer that stays minds none of them.  `STAGECTL_LONG=1` makes them one by one, on more records.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from stagectl.gap import diagnose
from stagectl.gap.logs.session import Session
from stagectl.gap.logs.unit_check import check_units, inertia_doubt
from stagectl.gap.result.diagnosis import DiagnosisResult, FoundEffect
from tests.gap import measured
from tests.gap.drawn import LONG, by_night, diagnosed
from tests.gap.relations import RELATIONS, at_once, stronger


def answer(session: Session, excluded: tuple[str, ...] = ()) -> DiagnosisResult:
    """The diagnosis, checked for what no answer may say."""
    check_units(session)
    assert inertia_doubt(session) == ""
    result = diagnosed(session, *excluded)
    largest = (
        max(float(abs(log.current).max()) for log in session.logs if log.current is not None)
        if any(log.current is not None for log in session.logs)
        else math.inf
    )
    for effect in result.named:
        for name, value in effect.parameters.items():
            assert math.isfinite(value.value), f"{effect.name}.{name}"
            if name in ("inertia", "viscous", "coulomb", "dead_time", "lag", "rise", "resonance", "amplitude"):
                assert value.value >= 0.0, f"{effect.name}.{name} = {value.value}"
            if name == "current_limit" and math.isfinite(largest):
                assert value.value >= 0.99 * largest
    assert result.gap.after <= result.gap.before * 1.001
    return result


def named(result: DiagnosisResult, name: str) -> FoundEffect:
    """The named effect; fails with what was named instead."""
    found = {effect.name: effect for effect in result.named}
    assert name in found, f"named are {sorted(found)}"
    return found[name]


def test_emps_has_no_delay_of_a_period_and_an_asymmetry() -> None:
    """A wrong `delay_samples: 1` in the stage file is told; the parameters are the published ones."""
    session = measured.emps()
    result = answer(session)
    delay = named(result, "dead_time").parameters["dead_time"].value
    assert delay < 0.5e-3
    assert ("drive.delay_samples", 0) in named(result, "dead_time").fields
    assert result.verdict == "effects+unknown" and result.gap.after < 0.45 * result.gap.before
    assert any("no log is held out" in note for note in result.notes)
    # The friction differs between directions: A. Janot, M. Gautier, M. Brunot, 2019, have 166.7 and 240.4 N s/m and
    # then no offset, against 203.5 N s/m and -3.2 N without that.
    asymmetry = named(result, "viscous_asymmetry").parameters["size"].value
    assert asymmetry == pytest.approx((166.7 - 240.4) / (166.7 + 240.4), rel=0.1)
    assert abs(named(result, "bias").parameters["bias"].value) < 1.0
    # A shorter rolling zone stays in doubt, over eight half strokes: 2.8 standard errors.
    sure = {effect.name: effect.probability for effect in result.named}
    assert "inertia" not in sure and sure.get("presliding", 0.0) < 0.6
    ripple = named(result, "cogging_map").parameters["period"]  # fitted: the stage file gives no pitch
    assert ripple.value == pytest.approx(2.5e-3, rel=0.001) and ripple.low < 2.5e-3 < ripple.high
    base = diagnose.baseline(session, ()).base.model.stage
    assert base.mechanics.inertia == pytest.approx(95.1, rel=0.02)
    assert base.mechanics.viscous == pytest.approx(203.5, rel=0.05)
    assert sum(base.friction.operators.weight) + base.friction.bristle.coulomb == pytest.approx(20.4, rel=0.05)


MAPS = ("lead_friction", "position_friction")  # the published friction of the robot is the same everywhere
JOINTS = {"joint 4": (3.58, 2.0), "joint 1": (21.26, 12.55), "joint 3": (10.38, 4.99), "joint 6": (3.03, 2.3)}
RECORDS: dict[str, Callable[[Path], Session]] = {
    "joint 4": lambda place: measured.ur10e(place, 4, 0.5),
    "joint 1": lambda place: measured.ur10e(place, 1, 5.5),
    "joint 3": lambda place: measured.ur10e(place, 3, 2.0),
    "joint 6": lambda place: measured.ur10e(place, 6, 0.3),
    "pulses": lambda place: measured.cnc(place, "Pulse_6Nm_10ms", "Pulse_9Nm_10ms", "Pulse_9Nm_20ms"),
    "slow motor": lambda place: measured.odrive(place, "slow2_nocomp_0", "slow2_nocomp_1"),
    "torque steps": lambda place: measured.hsm150(place, "idf_neg_0.04_1", "idf_pos_0.06_1"),
}
MOVED = 0.05  # by which a probability may move


class Known(NamedTuple):
    """A record, and what is said of it as it is."""

    name: str
    session: Session
    excluded: tuple[str, ...]
    result: DiagnosisResult


@pytest.fixture(scope="module")
def known(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Known:
    session = RECORDS[request.param](tmp_path_factory.mktemp("record"))
    excluded = MAPS if request.param in JOINTS else ()
    return Known(request.param, session, excluded, answer(session, excluded))


@pytest.mark.parametrize("known", JOINTS if LONG else ["joint 4"], indirect=True)
def test_a_joint_has_the_published_friction(known: Known) -> None:
    """Within 20 % of the values published with the record; gravity where the joint's axis is not vertical.

    Their friction is the same everywhere: along the turn, as joint 1 has it, its viscous part is 26 +- 15 N m s/rad.
    """
    viscous, coulomb = JOINTS[known.name]
    assert named(known.result, "viscous").parameters["viscous"].value == pytest.approx(viscous, rel=0.2)
    assert named(known.result, "coulomb").parameters["coulomb"].value == pytest.approx(coulomb, rel=0.21)
    assert ("gravity" in {effect.name for effect in known.result.named}) == (known.name in ("joint 3", "joint 4"))
    assert known.result.gap.closure > 0.9


@pytest.mark.parametrize("known", RECORDS if LONG else ["joint 4"], indirect=True)
@pytest.mark.parametrize("relation", RELATIONS if LONG else [at_once], ids=lambda relation: relation.__name__)
def test_the_answer_stays(known: Known, relation: Callable[[Session], Session]) -> None:
    before = known.result
    after = diagnosed(relation(known.session), *known.excluded)
    assert after.verdict == before.verdict
    old, new = ({effect.name: effect.probability for effect in result.effects} for result in (before, after))
    for name in {*old, *new}:
        assert abs(old.get(name, 0.0) - new.get(name, 0.0)) <= MOVED, name
    scale = 1e3 if relation in (stronger, at_once) else 1.0
    assert after.gap.before == pytest.approx(scale * before.gap.before, rel=0.02)
    assert after.gap.after == pytest.approx(scale * before.gap.after, rel=0.05)


def test_pulses_show_the_limit_of_the_drive(tmp_path: Path) -> None:
    """9 N m commanded, 4.2 A given."""
    result = answer(measured.cnc(tmp_path, "Pulse_6Nm_10ms", "Pulse_9Nm_10ms", "Pulse_9Nm_20ms"))
    limit = named(result, "current_saturation").parameters["current_limit"].value
    assert limit == pytest.approx(4.2, rel=0.02)


def test_one_pulse_tells_no_limit_from_a_gain(tmp_path: Path) -> None:
    result = answer(measured.cnc(tmp_path, "Pulse_9Nm_20ms"))
    assert named(result, "current_saturation").alternatives == ("torque_path",)


def test_a_bare_motor_cogs_seven_times_a_turn(tmp_path: Path) -> None:
    """The record's own map has 0.86 A at order 7, 0.047 N m; the regression of its torque over its angle, 0.044."""
    result = answer(measured.odrive(tmp_path, *(f"slow2_nocomp_{k}" for k in range(3))))
    values = {name: value.value for name, value in named(result, "cogging_map").parameters.items()}
    assert values["order"] == 7.0
    assert values["amplitude_1"] == pytest.approx(0.0455, abs=0.004)
    assert values["phase_1"] == pytest.approx(math.atan2(0.0277, -0.0347), abs=0.1)
    # The current is reported through a slow filter: no inertia follows, least of all a quarter of the published.
    assert "inertia" not in {effect.name for effect in result.named}


def test_steps_of_torque_give_the_mechanics_of_the_catalogue(tmp_path: Path) -> None:
    """The path of the torque is off by a third; inertia and viscous friction are not, and no compliance is named."""
    session = measured.hsm150(tmp_path, "idf_neg_0.04_1", "idf_pos_0.06_1")
    result = answer(session)
    assert "compliance" not in {effect.name for effect in result.named}
    assert "no missing effect" not in result.sentence
    base = diagnose.baseline(session, ()).base.model.stage.mechanics
    assert base.inertia == pytest.approx(1.2e-4, rel=0.15) and base.viscous == pytest.approx(7.03e-5, rel=0.2)


@by_night
def test_one_direction_is_no_obstacle(tmp_path: Path) -> None:
    answer(measured.hsm150(tmp_path, "idf_neg_0.04_2"))
