"""Paper B, section 2.2: the force at zero velocity, and the axis that swings when the force is taken away."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from stagectl_studies.reproduction.release import holding, released

from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.identification.capture import IdentificationError, Refusal
from tests.identification.slider import recorded, slider, trapezoid

CONFIG = Path(__file__).parents[2] / "config"


@pytest.mark.parametrize("speed", ["2.5", "5", "10"])
def test_released_the_slider_rings_at_40_hz_and_moves_up_to_20_um(speed: str) -> None:
    setup = slider()
    rows = recorded(setup, load_trajectory(CONFIG / "experiments" / f"release-{speed}mms.yaml", axis_of(setup)))
    opened = float(rows["time"][np.argmin(rows["closed"])])
    release = released(rows["time"], rows["measured"], opened, 10e-9)
    assert 39.5 < release.frequency.value < 40.5
    assert release.frequency.low < release.frequency.value < release.frequency.high < release.frequency.low + 0.5
    assert -20e-6 < release.offset < -15e-6  # back, against the motion before
    assert 20e-6 < release.travel < 35e-6  # it overshoots the place where it comes to rest


def test_half_the_integration_step_rings_alike() -> None:
    setup = slider()
    fine = setup.having(simulation=setup.file.simulation._replace(substeps=20))
    experiment = load_trajectory(CONFIG / "experiments" / "release-10mms.yaml", axis_of(setup))
    both = [released(rows["time"], rows["measured"], 0.8, 10e-9) for rows in (recorded(setup, experiment),
            recorded(setup, experiment, plant=fine))]  # fmt: skip
    assert both[0].frequency.value == pytest.approx(both[1].frequency.value, abs=0.02)
    assert both[0].offset == pytest.approx(both[1].offset, abs=0.2e-6)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_the_force_at_zero_velocity_is_5_3_newton(share: float) -> None:
    setup = slider(velocity_feedforward=share)
    rows = recorded(setup, trapezoid(dwell=0.2))
    force = setup.file.motor.force_constant * rows["measured_current"]
    assert 5.2 < holding(rows["time"], rows["velocity"], force).value < 5.4


def swinging(frequency: float, decay: float, offset: float) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(0.0, 1.0, 0.5e-3)
    s = t - 0.3
    swing = offset + 10e-6 * np.exp(-s / decay) * np.cos(2.0 * np.pi * frequency * s)
    return t, np.where(s < 0.0, offset + 10e-6, swing)


@pytest.mark.parametrize("frequency", [12.0, 40.0, 150.0])
def test_a_damped_swing_has_its_own_frequency(frequency: float) -> None:
    release = released(*swinging(frequency, 0.1, 3e-6), 0.3)
    assert release.frequency.value == pytest.approx(frequency, rel=2e-3)
    assert release.offset == pytest.approx(-10e-6, abs=0.1e-6)
    assert release.travel == pytest.approx(10e-6 * (1.0 + np.exp(-0.5 / frequency / 0.1)), rel=0.02)


def test_an_axis_that_stays_where_it_is_is_refused() -> None:
    t = np.arange(0.0, 1.0, 0.5e-3)
    with pytest.raises(IdentificationError) as caught:
        released(t, np.zeros(len(t)), 0.3, 10e-9)
    error = caught.value
    assert (error.reason, error.value, error.admissible) == (Refusal.NO_SWING, 0, "[4, inf)")
    with pytest.raises(IdentificationError) as caught:
        released(t, np.zeros(len(t)), 0.995, 10e-9)
    assert (caught.value.reason, caught.value.value) == (Refusal.TOO_SHORT, 10)


def test_a_motion_without_dwell_has_no_force_at_zero_velocity() -> None:
    t = np.arange(0.0, 1.0, 0.5e-3)
    with pytest.raises(IdentificationError) as caught:
        holding(t, np.sin(2.0 * np.pi * t) + 0.1, np.ones(len(t)))
    assert caught.value.reason is Refusal.TOO_SHORT
