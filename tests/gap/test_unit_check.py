"""Logs in wrong units or of the wrong sign are refused before anything is looked for in them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.api.arguments import ArgumentError
from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.session import LogError
from stagectl.gap.logs.sources import Description
from stagectl.gap.logs.unit_check import check_units, inertia_doubt
from stagectl.recording.hdf5 import RecordingError
from stagectl.recording.wrong_units import by_pace
from tests.gap.captured import CONFIG

STAGE = CONFIG / "ball-screw.yaml"


@pytest.fixture(scope="module")
def rows() -> np.ndarray:
    ran = sc.simulate(STAGE, CONFIG / "trajectories" / "sine-1.6hz.yaml")
    return np.column_stack([ran[name] for name in ("time", "measured", "measured_current")])


def _log(folder: Path, rows: np.ndarray, header: str) -> Path:
    path = folder / "log.csv"
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


DEGREE = math.pi / 180.0


@pytest.mark.parametrize(
    "factors",
    [
        (1.0, 1.0, 1e3), (1.0, 1.0, -1.0), (1.0, 1.0, 1e-3), (1.0, -1.0, 1.0),
        (1.0, DEGREE, 1.0), (1.0, 1.0 / DEGREE, 1.0), (1.0, 1.0 / 360.0, 1.0), (1.0, 1e-3, 1.0),
    ],
)  # fmt: skip
def test_a_wrong_unit_or_sign_is_refused(tmp_path: Path, rows: np.ndarray, factors: tuple[float, ...]) -> None:
    log = _log(tmp_path, rows * factors, "time_s,position_rad,current_A")
    with pytest.raises(LogError) as caught:
        sc.diagnose(log, stage=STAGE)
    assert (caught.value.reason, caught.value.logs) == ("unit", ("log.csv",))


def test_a_force_in_another_scale_is_doubted(tmp_path: Path, rows: np.ndarray) -> None:
    """A factor that no unit has: the torque of another rated current; inertia and frictions are all off by it."""
    log = _log(tmp_path, rows * (1.0, 1.0, 1.0 / 6.0), "time_s,position_rad,current_A")
    notes = sc.diagnose(log, stage=STAGE, advice=False).notes
    (doubt,) = (note for note in notes if "scale of the force" in note)
    assert "6 times too small" in doubt and "positions" not in doubt


@pytest.mark.parametrize("scale", [0.4, 1.0, 2.5])
def test_another_machine_of_the_kind_is_not(tmp_path: Path, rows: np.ndarray, scale: float) -> None:
    """Nominal values may be wrong by a factor of two and a half."""
    log = _log(tmp_path, rows * (1.0, 1.0, scale), "time_s,position_rad,current_A")
    check_units(load([log], load_stage(STAGE)))


def test_an_inertia_in_another_unit_is_refused(tmp_path: Path, rows: np.ndarray) -> None:
    """100 kg cm^2 written as 100 kg m^2: the place, the value, and the range that the log admits."""
    log = _log(tmp_path, rows, "time_s,position_rad,current_A")
    model: dict[str, float | str] = {"kind": "rotary", "force_constant": 0.72, "inertia": 100.0}
    with pytest.raises(ArgumentError, match=r"100 kg m\^2.* must lie in \(0, 0\.1") as caught:
        sc.diagnose(log, model=model)
    assert (caught.value.name, caught.value.value) == ("model", "inertia")


@pytest.mark.parametrize("inertia", [0.001, 0.01, 0.05])
def test_a_roughly_known_inertia_is_not(tmp_path: Path, rows: np.ndarray, inertia: float) -> None:
    log = _log(tmp_path, rows, "time_s,position_rad,current_A")
    said = Description(stage={"kind": "rotary", "force_constant": 0.72, "inertia": inertia})
    session = load([log], said=said)
    check_units(session)
    assert inertia_doubt(session) == ""


def test_the_kind_of_a_described_machine_is_that_of_its_log(tmp_path: Path, rows: np.ndarray) -> None:
    log = _log(tmp_path, rows, "time_s,measured_rad,current_A")
    with pytest.raises(RecordingError) as caught:
        sc.diagnose(log, model={"kind": "linear", "force_constant": 0.72, "inertia": 0.01})
    assert caught.value.column == "measured_rad"


def test_an_axis_at_rest_identifies_nothing(tmp_path: Path, rows: np.ndarray) -> None:
    log = _log(tmp_path, rows * (1.0, 0.0, 0.0), "time_s,position_rad,current_A")
    assert sc.diagnose(log, stage=STAGE).verdict == "not-identifiable"


def test_a_header_of_ours_beside_one_in_another_unit(tmp_path: Path, rows: np.ndarray) -> None:
    """The position as our own export names it, the current in mA: both are read."""
    log = _log(tmp_path, rows * (1.0, 1.0, 1e3), "time_s,measured_rad,measured_current_mA")
    session = load([log], load_stage(STAGE))
    current = session.logs[0].current
    assert current is not None and np.abs(current - rows[:, 2]).max() < 1e-6


@pytest.mark.parametrize("hidden", [0.0, 5.0])
@pytest.mark.parametrize("step", [0.25, 4.0, 8.0])
def test_rows_that_are_far_apart_are_in_another_unit(
    tmp_path: Path, rows: np.ndarray, step: float, hidden: float
) -> None:
    """Whatever the model lacks, such as gravity: no motion shows in rows that are seconds apart."""
    foreign = rows[: 200 * (len(rows) // 200)].reshape(200, -1, 3)[:, 0].copy()
    foreign[:, 0] = step * np.arange(len(foreign))
    foreign[:, 2] += hidden * np.sin(foreign[:, 1])
    log = _log(tmp_path, foreign, "time_s,position_rad,current_A")
    with pytest.raises(LogError) as caught:
        sc.diagnose(log, stage=STAGE)
    assert (caught.value.reason, caught.value.logs) == ("unit", ("log.csv",))


def test_rows_that_are_far_apart_identify_nothing(tmp_path: Path, rows: np.ndarray) -> None:
    """Taken as they are, they end in a verdict."""
    foreign = rows[:: len(rows) // 200].copy()
    foreign[:, 0] = 4.0 * np.arange(len(foreign))
    log = _log(tmp_path, foreign, "time_s,position_rad,current_A")
    assert sc.diagnose(log, stage=STAGE, doubtful=True).verdict == "not-identifiable"


@pytest.mark.parametrize(("dt", "refused"), [(0.1, False), (0.25, True), (4.0, True), (60.0, False), (100.0, True)])
def test_which_pace_is_one_of_another_unit(dt: float, refused: bool) -> None:
    assert bool(by_pace(dt)) is refused


def test_the_header_of_a_foreign_time_is_read(tmp_path: Path, rows: np.ndarray) -> None:
    log = _log(tmp_path, rows * (1e3, 1.0, 1.0), "t [ms],x [rad],i")
    session = load([log], load_stage(STAGE), Description({"time": "1", "position": "2", "current": "3"}))
    assert session.dt == pytest.approx(rows[1, 0] - rows[0, 0])
    check_units(session)
