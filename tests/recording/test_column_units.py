"""Units of columns of other programs: shares of the rated current, efforts, and what a header says in brackets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stagectl.config.stage_file import Setup, load_stage
from stagectl.problem import ProblemKind
from stagectl.recording.columns import header_unit
from stagectl.recording.hdf5 import RecordingError
from stagectl.recording.imports import read
from stagectl.recording.scales import Scales, scales_of_nominal
from stagectl.units import LINEAR, ROTARY
from tests.conftest import CONFIG
from tests.problems import refused


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_stage(CONFIG / "ball-screw.yaml")


def _log(folder: Path, head: str, value: float = 50.0) -> Path:
    (folder / "log.csv").write_text(f"{head}\n0,0,0\n0.5,1,{value}\n1,2,{2 * value}\n")
    return folder / "log.csv"


PER_UNIT = [
    ("permille", 1e-3), ("per mille", 1e-3), ("‰", 1e-3), ("0.1 %", 1e-3), ("percent", 1e-2), ("%", 1e-2),
]  # fmt: skip


@pytest.mark.parametrize(("unit", "share"), PER_UNIT)
@pytest.mark.parametrize("quantity", ["current", "command"])
def test_shares_of_the_rated_current(tmp_path: Path, setup: Setup, quantity: str, unit: str, share: float) -> None:
    ours = {"current": "measured_current", "command": "command"}[quantity]
    for head, said in (("t,q,i", f"3:{unit}"), (f"t,q,Torque({unit})", "3")):
        (recording,) = read(_log(tmp_path, head), setup, {"time": "1", "position": "2:rad", quantity: said})
        np.testing.assert_allclose(recording.column(ours)[1], 50.0 * share * setup.canopen.rated_current)


@pytest.mark.parametrize("head", ["time_s,position_rad,torque (%)", "time (s),position [rad],torque [%]"])
def test_shares_by_our_own_headers(tmp_path: Path, setup: Setup, head: str) -> None:
    (recording,) = read(_log(tmp_path, head), setup)
    np.testing.assert_allclose(recording.column("measured_current")[1], 0.5 * setup.canopen.rated_current)


@pytest.mark.parametrize("said", ["3:permille", "Torque(%):percent", "Torque(%)"])
def test_a_share_of_nothing_known_is_refused(tmp_path: Path, said: str) -> None:
    path = _log(tmp_path, "t,q,Torque(%)")
    with refused(RecordingError, kind=ProblemKind.UNIT, file=path, column=said.split(":")[0]) as caught:
        read(path, columns={"time": "1", "position": "2:rad", "current": said})
    for remedy in ("drive.wire.rated_current", "stage.rated_current", "rated_current=", "--model"):
        assert remedy in str(caught.value)


def test_the_rated_current_of_a_nominal_model() -> None:
    scales = scales_of_nominal({"stage": {"kind": ROTARY, "rated_current": 4.0}}, Path("nominal.yaml"))
    assert scales.current("permille") == pytest.approx(4e-3)
    with refused(RecordingError, kind=ProblemKind.RANGE, column="rated_current"):
        scales_of_nominal({"stage": {"kind": ROTARY, "rated_current": 0.0}}, Path("nominal.yaml"))


@pytest.mark.parametrize("unit", ["Nm", "N m", "N.m", "N*m"])
def test_a_torque_is_divided_by_the_constant(tmp_path: Path, setup: Setup, unit: str) -> None:
    (recording,) = read(_log(tmp_path, "t,q,i"), setup, {"time": "1", "position": "2:rad", "current": f"3:{unit}"})
    np.testing.assert_allclose(recording.column("measured_current")[1], 50.0 / setup.stage.motor.force_constant)


def test_efforts_in_other_sizes() -> None:
    rotary, linear = (Scales(kind, force_constant=2.0) for kind in (ROTARY, LINEAR))
    assert [rotary.current(unit) for unit in ("mNm", "kNm", "Ncm")] == pytest.approx([5e-4, 500.0, 5e-3])
    assert [linear.current(unit) for unit in ("N", "kN")] == pytest.approx([0.5, 500.0])
    with refused(RecordingError, kind=ProblemKind.MISSING, column="stage.force_constant"):
        Scales(ROTARY).current("Nm")


def test_a_header_in_brackets_is_the_unit_of_a_column(tmp_path: Path, setup: Setup) -> None:
    """A foreign header, chosen by number or name; what --columns says comes first, and words are no unit."""
    path = _log(tmp_path, "t [ms],Achse 3 (°),Strom [mA]")
    (recording,) = read(path, setup, {"time": "1", "position": "2", "current": "3"})
    np.testing.assert_allclose(recording.column("time"), [0.0, 5e-4, 1e-3])
    np.testing.assert_allclose(recording.column("measured"), np.radians([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(recording.column("measured_current"), [0.0, 0.05, 0.1])
    (said,) = read(path, setup, {"time": "1:s", "position": "Achse 3 (°):mm", "current": "3:A"})
    assert (said.column("time")[1], said.column("measured_current")[1]) == (0.5, 50.0)
    (plain,) = read(path, None, {"time": "1", "position": "2"})
    assert plain.meta["axis"]["kind"] == ROTARY


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("t [ms]", "ms"), ("Achse 3 Istposition [°]", "°"), ("Achse 3 Drehmoment [Nm]", "Nm"), ("Torque(%)", "%"),
        ("position_mm", "mm"), ("time", ""), ("Speed (actual)", ""), ("I []", ""), ("x [counts]", "counts"),
        ("time [µs]", "µs"), ("torque [‰]", "‰"), ("Iq (per mille)", "per mille"), ("", ""),
    ],
)  # fmt: skip
def test_units_of_headers(header: str, unit: str) -> None:
    assert header_unit(header) == unit
