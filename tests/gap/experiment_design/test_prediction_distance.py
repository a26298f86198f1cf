"""Noise densities and shifts, in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.gap.experiment_design import prediction_distance
from stagectl.gap.residuals.half_strokes import kept, standstills

DT = 1e-3


def test_no_density_is_below_its_floor() -> None:
    """White noise of a standard deviation s has 2 dt s^2; gaps deeper than a millionth of the largest are filled."""
    sine = np.sin(2.0 * np.pi * 100.0 * DT * np.arange(4000))
    repeats: Any = [[SimpleNamespace(position=x, start=0.0) for x in (sine, -sine)]]
    power = prediction_distance._density(repeats, "position", 0.0, DT)[1]
    assert power.min() == pytest.approx(1e-6 * power.max())
    assert prediction_distance._density(repeats, "position", 100.0, DT)[1].min() == pytest.approx(20.0)


def test_what_was_not_repeated_has_the_floor_alone() -> None:
    frequency, power = prediction_distance._density([], "position", 100.0, DT)
    assert frequency.tolist() == [0.0, 500.0] and power == pytest.approx([20.0, 20.0])


def test_deviations_have_the_variance_of_a_single_repeat() -> None:
    logs: Any = [SimpleNamespace(position=np.full(5, x), start=t) for t, x in enumerate((1.0, -2.0, 1.0))]
    deviations = prediction_distance._deviations(logs, "position")
    assert np.mean(np.square(deviations)) == pytest.approx(6.0)  # one degree of freedom is left
    logs[0].position = None
    assert prediction_distance._deviations(logs, "position") == []


@pytest.mark.parametrize("measured", [True, False])
def test_a_current_that_is_logged_late_lacks_its_slope(measured: bool) -> None:
    """Half a kept sample of a ramp of 2 a sample; the command has no clock of its own."""
    run: Any = SimpleNamespace(measured=measured)
    ramp = np.concatenate([np.zeros(10), 2.0 * np.arange(10.0)])
    change = prediction_distance.shift_slope(run, ramp)
    assert change[:10].tolist() == [0.0] * 10
    assert change[10:] == pytest.approx([-1.0 if measured else 0.0] * 10)


def test_rests_are_counted_in_kept_samples() -> None:
    reference = np.concatenate([np.linspace(0.0, 1.0, 400), np.ones(600)])
    ((begin, end),) = kept(standstills(reference, DT))
    assert begin == pytest.approx(200, abs=2) and 490 <= end <= 500
