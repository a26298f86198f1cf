"""Least squares: exact on its own equation, the published figures on a real machine, refusal where blind."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
from scipy.io import loadmat

from stagectl.identification.least_squares import IdentificationError, Result, least_squares
from stagectl.trajectories import Multisine

Array = npt.NDArray[np.floating[Any]]
EMPS = Path(__file__).resolve().parents[3] / "shared" / "data" / "emps" / "DATA_EMPS.mat"
TRUE = (95.0, 203.0, 20.0, -3.0)  # kg, N s/m, N, N


class Record(NamedTuple):
    """What a capture holds."""

    time: Array
    position: Array
    force: Array


@pytest.fixture(scope="module")
def emps() -> Record:
    """The benchmark's training record: force = drive gain times controller output."""
    if not EMPS.exists():
        pytest.skip("the EMPS record is not beside this repository (../shared/data/emps/DATA_EMPS.mat)")
    data: dict[str, Any] = loadmat(EMPS)
    return Record(data["t"].ravel(), data["qm"].ravel(), data["gtau"].item() * data["vir"].ravel())


@pytest.fixture(scope="module")
def published(emps: Record) -> Result:
    return least_squares(*emps)


def made(noise: float = 0.0, seed: int = 1) -> Record:
    """A slow multisine on an axis that obeys the equation, with white noise on the force (N rms)."""
    time = np.arange(20000) * 1e-3
    x, v, a = Multisine(0.05, 0.2, 4.0, base=5.0, periods=3.5).at(time)
    force = np.column_stack([a, v, np.sign(v), np.ones(len(time))]) @ np.array(TRUE)
    return Record(time, x, force + np.random.default_rng(seed).normal(0.0, noise, len(time)))


@pytest.mark.parametrize(
    ("name", "value", "within"),
    [
        ("inertia", 95.1089, 1e-3),
        ("viscous", 203.5034, 5e-3),
        ("coulomb", 20.3935, 5e-3),
        ("offset", -3.1648, 2e-2),
    ],
)
def test_emps_parameters_are_published(published: Result, name: str, value: float, within: float) -> None:
    """A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019."""
    assert getattr(published, name).value == pytest.approx(value, rel=within)


def test_emps_residual_and_deviations_are_published(published: Result) -> None:
    """The same source; the deviations scale with the number of samples kept, so they test the decimation."""
    assert 4.0 <= published.residual_percent <= 4.1
    deviations = [estimate.deviation for estimate in published[:4]]
    assert deviations == pytest.approx([0.1085, 1.146, 0.1012, 0.0444], rel=0.02)


def test_emps_does_not_hang_on_the_cut_off(emps: Record, published: Result) -> None:
    """Nobody tunes the result: from 60 to 150 Hz no parameter moves by more than its deviation."""
    for cutoff in (60.0, 150.0):
        for found, reference in zip(least_squares(*emps, cutoff_hz=cutoff)[:4], published[:4], strict=True):
            assert abs(found.value - reference.value) < reference.deviation


def test_its_own_equation_is_solved() -> None:
    found = least_squares(*made())
    assert [estimate.value for estimate in found[:4]] == pytest.approx(TRUE, rel=2e-3)
    assert found.residual_percent < 0.5
    assert 1.0 <= found.condition < 10.0
    np.testing.assert_allclose(np.diag(found.correlation), 1.0)
    np.testing.assert_allclose(found.correlation, found.correlation.T)


def test_deviation_is_the_spread_over_repetitions() -> None:
    """White noise, 50 records, no decimation: the standard deviation of 50 is itself good to a tenth."""
    runs = [least_squares(*made(5.0, seed), decimate=1)[:4] for seed in range(50)]
    spread = np.std([[estimate.value for estimate in run] for run in runs], axis=0)
    claimed = np.mean([[estimate.deviation for estimate in run] for run in runs], axis=0)
    np.testing.assert_array_less(spread, 1.35 * claimed)
    np.testing.assert_array_less(0.65 * claimed, spread)


def test_units_do_not_matter() -> None:
    record = made(1.0)
    metres, microns = least_squares(*record), least_squares(record.time, 1e6 * record.position, record.force)
    assert microns.inertia.value == pytest.approx(1e-6 * metres.inertia.value, rel=1e-9)
    assert microns.coulomb == pytest.approx(metres.coulomb, rel=1e-9)
    assert microns.condition == pytest.approx(metres.condition, rel=1e-9)


def spoilt(column: str, row: int, value: float) -> Record:
    record = made()
    values = getattr(record, column).copy()
    values[row] = value
    return record._replace(**{column: values})


def constant_speed() -> Record:
    time = np.arange(20000) * 1e-3
    return Record(time, 0.1 * time, np.full(20000, 40.0))


REFUSED = [
    (spoilt("time", 500, 0.5004), r"time\[50\d\] - time\[\d+\] = 0.00\d+ s; must lie within 0.1 % of"),
    (spoilt("position", 7, np.nan), r"position\[7\] = nan m; must be finite"),
    (spoilt("force", 9, np.inf), r"force\[9\] = inf N; must be finite"),
    (Record(*(column[:599] for column in made())), r"record of 599 samples; must have at least 600"),
    (Record(np.zeros(0), np.zeros(0), np.zeros(0)), r"record of 0 samples"),
    (made()._replace(force=np.zeros(5)), r"force has shape \(5,\); must be \(20000,\)"),
    (constant_speed(), r"rarer direction = 0; must lie in \[0.05, 0.5\]"),
    (made()._replace(position=np.zeros(20000)), r"rarer direction = 0"),
]


@pytest.mark.parametrize(("record", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_a_blind_record_is_refused(record: Record, message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        least_squares(*record)


def test_one_speed_there_and_back_is_refused() -> None:
    """Velocity and its sign are then one column."""
    time = np.arange(20000) * 1e-3
    triangle = 0.1 * np.abs((time + 5.0) % 20.0 - 10.0)
    with pytest.raises(IdentificationError, match="does not separate the parameters"):
        least_squares(time, triangle, np.sign(np.gradient(triangle)))


@pytest.mark.parametrize(
    ("recipe", "message"),
    [({"cutoff_hz": 500.0}, r"must lie in \(0, 500\) Hz"), ({"decimate": 0}, "decimate = 0")],
)
def test_a_recipe_that_cannot_be_is_refused(recipe: dict[str, Any], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        least_squares(*made(), **recipe)
