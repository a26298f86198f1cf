from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import tracker_response
from stagectl.gap.residuals.sensitivities import TrackedModel, model_of

BALL_SCREW = Path(__file__).parents[3] / "config" / "ball-screw.yaml"
DT, ROWS = 5e-4, 4000
TIME = np.arange(ROWS) * DT


@pytest.fixture(scope="module")
def model() -> TrackedModel:
    stage = load_stage(BALL_SCREW).stage
    stage = stage._replace(encoder=stage.encoder._replace(delay_samples=0))
    return model_of(stage, DT)


def _closed_form(model: TrackedModel, frequency: float) -> complex:
    """All four poles at -p: T = ((6 p^2 - a D/J) s^2 + 4 p^3 s + p^4) / (s + p)^4, a = 4 p - D/J."""
    p, s, rate = 2.0 * math.pi * 40.0, 2j * math.pi * frequency, model.stage.mechanics
    damped = rate.viscous / rate.inertia
    return complex(((6.0 * p * p - (4.0 * p - damped) * damped) * s * s + 4.0 * p**3 * s + p**4) / (s + p) ** 4)


@pytest.mark.parametrize("frequency", [2.0, 10.0, 40.0])
def test_the_tracker_answers_as_its_poles_say(model: TrackedModel, frequency: float) -> None:
    x = np.exp(2j * math.pi * frequency * TIME)
    answered = _answered(model, x.real) + 1j * _answered(model, x.imag)
    middle = slice(ROWS // 4, 3 * ROWS // 4)
    gain = np.vdot(x[middle], answered[middle]) / np.vdot(x[middle], x[middle])
    # Half a period of hold beside the continuous loop.
    expected = _closed_form(model, frequency)
    assert abs(gain) == pytest.approx(abs(expected), rel=0.08)
    assert np.angle(gain / expected) == pytest.approx(0.0, abs=2.0 * math.pi * frequency * 1.0 * DT + 0.01)


def test_what_the_tracker_answered_is_brought_back(model: TrackedModel) -> None:
    effort = np.exp(-(((TIME - 1.0) / 0.01) ** 2))
    answered = _answered(model, effort)
    back = tracker_response.untracked(answered, model, DT)
    assert np.abs(answered - effort).max() > 0.25
    assert np.abs(back - effort).max() < 0.01


def test_a_constant_effort_is_followed_to_the_end(model: TrackedModel) -> None:
    np.testing.assert_allclose(_answered(model, np.full(ROWS, 0.3)), 0.3, rtol=1e-6)


def _answered(model: TrackedModel, effort: Array) -> Array:
    return tracker_response.filtered(effort, tracker_response.tracking(model, tracker_response.lines_of(ROWS, DT), DT))
