"""The worked examples of the manual's page on the gap, as they stand there."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.gap.drawn import by_night, diagnosed, drawn


@by_night
def test_a_weak_effect_behind_a_strong_one(tmp_path: Path) -> None:
    diagnosis = diagnosed(drawn(tmp_path, 41, "viscous_nonlinear", "cogging", scale=1.0))
    effects = [effect for effect in diagnosis.named if not effect.parameter]
    assert [effect.name for effect in effects] == ["viscous_nonlinear", "cogging"]
    assert (
        effects[1].share < 0.2 * effects[0].share
    )  # it is masked: what it does to the position is small beside the other
    assert effects[1].parameters["amplitude"].value == pytest.approx(0.015, rel=0.2)
    assert diagnosis.gap.closure > 0.85


def test_an_effect_that_is_in_no_library(tmp_path: Path) -> None:
    diagnosis = diagnosed(drawn(tmp_path, 42, "viscous_asymmetry", scale=2.0), "viscous_asymmetry")
    assert diagnosis.verdict == "unknown" and not [effect for effect in diagnosis.named if not effect.parameter]
    assert (
        diagnosis.unknown is not None and diagnosis.unknown.coordinate == "speed" and diagnosis.unknown.predicted > 0.8
    )
    assert any(
        name == "residual.values" for name, _ in diagnosis.unknown.fields
    )  # the gap shrinks by a data-based term
    assert diagnosis.gap.closure > 0.6


def test_an_effect_beside_what_is_in_no_library(tmp_path: Path) -> None:
    """A swollen place of the rail hides the damping that warms up; a function of the position takes it away."""
    diagnosis = diagnosed(drawn(tmp_path, 7101, "bump", "thermal_viscous", scale=4.0))
    assert diagnosis.verdict == "effects+unknown" and diagnosis.unknown is not None
    assert [effect.name for effect in diagnosis.named if not effect.parameter] == ["thermal_viscous"]
    assert diagnosis.unknown.coordinate == "position" and diagnosis.unknown.predicted > 0.8
    assert diagnosis.gap.closure > 0.6


@by_night
def test_a_drift_that_ends_early_behind_a_strong_effect(tmp_path: Path) -> None:
    """The axis is warm after the first round: what is left out of the data must not be that round alone."""
    diagnosis = diagnosed(drawn(tmp_path, 43, "cable_spring", "thermal_coulomb", scale=2.0))
    named = {effect.name: effect for effect in diagnosis.named}
    assert {"cable_spring", "thermal_coulomb"} <= named.keys() and diagnosis.verdict == "effects"
    assert named["thermal_coulomb"].parameters["rise"].value == pytest.approx(0.2, abs=0.08)
