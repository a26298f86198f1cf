"""Rows on control periods: lost ones leave gaps, others are resampled, clocks that differ are noted."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.gap.logs.grid import on_control_periods
from stagectl.gap.logs.session import LogError

DT = 1e-3
TIME = DT * np.arange(500, dtype=np.float64)


def test_rows_in_their_periods_stay_as_they_are() -> None:
    grid = on_control_periods("log", TIME, {"position": TIME}, DT)
    assert grid.exact and grid.notes == [] and np.array_equal(grid.columns["position"], TIME)


def test_lost_rows_leave_gaps() -> None:
    kept = np.r_[0:100, 103:500]
    grid = on_control_periods("log", TIME[kept], {"position": TIME[kept]}, DT)
    assert grid.rows == 500 and np.flatnonzero(np.isnan(grid.columns["position"])).tolist() == [100, 101, 102]
    assert len(grid.notes) == 1 and "3 of 500" in grid.notes[0] and "0.1 s" in grid.notes[0]


def test_another_period_is_resampled_by_a_spline() -> None:
    time = 1.7 * TIME
    grid = on_control_periods("log", time, {"position": np.sin(time), "current": time}, DT)
    inside = DT * np.arange(grid.rows, dtype=np.float64)
    assert not grid.exact and grid.rows == 849
    np.testing.assert_allclose(grid.columns["position"], np.sin(inside), atol=1e-10)
    np.testing.assert_allclose(grid.columns["current"], inside, atol=1e-12)


@pytest.mark.parametrize(("drift", "noted"), [(5e-5, False), (3e-4, True)])
def test_a_clock_that_differs_is_noted(drift: float, noted: bool) -> None:
    grid = on_control_periods("log", (1.0 + drift) * TIME, {"position": TIME}, DT)
    assert grid.exact and bool(grid.notes) == noted


def test_too_few_rows() -> None:
    with pytest.raises(LogError) as caught:
        on_control_periods("log", TIME[:99], {"position": TIME[:99]}, DT)
    assert (caught.value.reason, caught.value.logs) == ("short", ("log",))
