"""Shifted parameters as entries of the verdict."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from stagectl.config.stage_file import Setup
from stagectl.gap.inference import shifted_parameters
from stagectl.gap.inference.parameter_errors import Shift
from stagectl.gap.result.diagnosis import Value


def shift(name: str, change: float, share: float = 0.3) -> Shift:
    return Shift(name, change, 1e-3, share, Value(1.0 + change, 0.9, 1.1, ""), 0.99)


@pytest.fixture
def session(ball_screw: Setup) -> Any:
    return SimpleNamespace(stage=ball_screw.stage, logs=())


@pytest.fixture
def now(ball_screw: Setup) -> Any:
    return SimpleNamespace(model=SimpleNamespace(stage=ball_screw.stage))


def test_a_common_scale_stands_for_the_three_and_the_rest_stays(session: Any, now: Any) -> None:
    changed = [shift(name, 0.25) for name in ("inertia", "viscous", "coulomb")]
    force_constant, bias = shifted_parameters.shifted(session, [*changed, shift("bias", 0.1)], now)
    assert force_constant.name == "force_constant" and bias.name == "bias"
    ((place, value),) = force_constant.fields
    assert place == "motor.force_constant"
    assert value == pytest.approx(session.stage.motor.force_constant / 1.25)
    assert force_constant.alternatives == ("current_gain", "inertia_and_all_friction")
    assert [name for name, _ in force_constant.choices] == ["inertia_and_all_friction"]


def test_shifts_come_by_their_share_and_name_the_force_constant_where_two_agree(session: Any, now: Any) -> None:
    changed = [shift("inertia", 0.09, 0.1), shift("viscous", -0.09, 0.5), shift("coulomb", -0.0905, 0.4)]
    entries = shifted_parameters.shifted(session, changed, now)
    assert [entry.name for entry in entries] == ["viscous", "coulomb", "inertia"]
    assert ["force_constant" in entry.alternatives for entry in entries] == [True, True, False]
    assert entries[2].fields == (("mechanics.inertia", 1.09),)
    assert [entry.coordinate for entry in entries] == ["speed", "direction", "acceleration"]


def test_a_shift_of_the_log_is_in_the_sensor_and_has_no_place_in_the_model(session: Any, now: Any) -> None:
    (entry,) = shifted_parameters.shifted(session, [shift("time_shift", 0.4)], now)
    assert entry.block == "sensor" and entry.probability == 0.99 and entry.fields == ()


def test_an_unmeasured_current_makes_a_bias_ambiguous(session: Any, now: Any) -> None:
    (known,) = shifted_parameters.shifted(session, [shift("bias", 0.1)], now)
    session.logs = (SimpleNamespace(current=None, command=1),)
    (ambiguous,) = shifted_parameters.shifted(session, [shift("bias", 0.1)], now)
    assert set(ambiguous.alternatives) - set(known.alternatives) == {"current_offset"}
