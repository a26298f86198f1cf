"""Logs that other programs spoilt come in repaired, with a note on each repair, and sound logs come in as they are."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import Recording, RecordingError
from stagectl.recording.imports import read
from tests.problems import refused
from tests.recording import damage
from tests.recording.damage import Columns

TURN = 2.0 * math.pi
RATES = (100.0, 500.0, 2000.0, 10_000.0)
COUNTS = (1000, 4096, 20_000, 1 << 20, 1 << 24)


def imported(folder: Path, columns: Columns, end: str = "") -> Recording:
    (recording,) = read(damage.write(folder / "log.csv", columns, end=end))
    return recording


def repairs(recording: Recording) -> list[str]:
    return [note for note in recording.meta["notes"] if not note.startswith("no ")]


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("counts", COUNTS)
def test_a_sound_log_is_left_alone(tmp_path: Path, rate: float, counts: int) -> None:
    columns = damage.motion(rate, counts, seconds=3.0)
    recording = imported(tmp_path, columns)
    assert repairs(recording) == [] and len(recording.samples) == len(columns["time"])
    np.testing.assert_allclose(recording.column("measured"), columns["position"], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("rate", "clock"), [(2000.0, 1e-3), (10_000.0, 1e-3), (640.0, 1e-3), (2000.0, 1e-2)])
def test_a_rounded_clock_gives_its_grid_back(tmp_path: Path, rate: float, clock: float) -> None:
    columns = damage.motion(rate)
    recording = imported(tmp_path, damage.rounded(columns, clock))
    np.testing.assert_allclose(recording.column("time"), columns["time"], atol=0.05 / rate)
    assert len(repairs(recording)) == 1 and recording.meta["dt"] == pytest.approx(1.0 / rate, rel=1e-5)


def test_a_rounded_clock_keeps_its_gap(tmp_path: Path) -> None:
    columns = {name: np.delete(column, slice(5000, 5400)) for name, column in damage.motion().items()}
    recording = imported(tmp_path, damage.rounded(columns, 1e-3))
    steps = np.diff(recording.column("time"))
    assert int(np.argmax(steps)) == 4999 and steps.max() == pytest.approx(401 * 0.5e-3, abs=1e-3)
    assert np.delete(steps, 4999) == pytest.approx(0.5e-3, rel=1e-3)


@pytest.mark.parametrize("lost", [slice(3000, 3001), slice(3000, 4000)])
def test_lost_rows_are_no_rounded_clock(tmp_path: Path, lost: slice) -> None:
    """Exact stamps at one rate, of which some are missing, stay as they are."""
    columns = {name: np.delete(column, lost) for name, column in damage.motion(2000.0).items()}
    recording = imported(tmp_path, columns)
    assert repairs(recording) == []
    np.testing.assert_allclose(recording.column("time"), columns["time"] - columns["time"][0], rtol=1e-9, atol=1e-9)


def test_irregular_stamps_stay(tmp_path: Path) -> None:
    columns = damage.jittered(damage.motion(), 0.3)
    recording = imported(tmp_path, columns)
    assert repairs(recording) == []
    np.testing.assert_allclose(recording.column("time"), columns["time"] - columns["time"][0], rtol=1e-9, atol=1e-9)


def test_rows_written_twice_are_left_out(tmp_path: Path) -> None:
    columns = damage.motion()
    twice = {name: np.repeat(column, 2) for name, column in columns.items()}
    recording = imported(tmp_path, twice)
    np.testing.assert_allclose(recording.column("time"), columns["time"])
    assert len(repairs(recording)) == 1


def with_repeats(rows: list[int]) -> Columns:
    """A log on an uneven clock, in which some rows stand twice."""
    columns = damage.jittered(damage.motion(), 0.3)
    return {name: np.insert(column, rows, column[rows]) for name, column in columns.items()}


@pytest.mark.parametrize("rows", [[1440], [1440, 2812, 2812, 2812, 9000]])
def test_a_row_that_stands_twice_costs_no_other(tmp_path: Path, rows: list[int]) -> None:
    """Identification and diagnosis read the same rows as from the log without them."""
    read_back = imported(tmp_path, with_repeats(rows))
    np.testing.assert_allclose(read_back.column("time"), damage.jittered(damage.motion(), 0.3)["time"], atol=2e-4)
    (note,) = repairs(read_back)
    assert note.startswith(f"{len(rows)} of {12000 + len(rows)} rows repeat") and " 0.72" in note


def with_conflicts(rows: list[int]) -> Columns:
    """A log on an uneven clock, in which some stamps stand twice, with different values."""
    columns = with_repeats(rows)
    again = np.asarray(rows) + np.arange(1, len(rows) + 1)
    columns["current"][again] += 0.3
    return columns


def test_a_few_rows_that_share_a_time_cost_only_themselves(tmp_path: Path) -> None:
    """Which of two values is right is not known, so neither is used."""
    rows = [1440, 2812, 9000]
    read_back = imported(tmp_path, with_conflicts(rows))
    kept = np.delete(damage.jittered(damage.motion(), 0.3)["current"], rows)
    np.testing.assert_allclose(read_back.column("measured_current"), kept, rtol=1e-9, atol=1e-12)
    (note,) = repairs(read_back)
    assert note.startswith("6 of 12003 rows share their time") and " 0.72" in note


def test_many_rows_that_share_a_time_are_refused_with_their_rows(tmp_path: Path) -> None:
    """Beside rows that only stand twice, and that are none of the reason."""
    rows = list(range(2812, 9000, 50))
    columns = with_conflicts(rows)
    columns = {name: np.insert(column, 1440, column[1440]) for name, column in columns.items()}
    with refused(RecordingError, kind=ProblemKind.CONFLICT, column="time_s", row=2815) as caught:
        imported(tmp_path, columns)
    assert "rows 2814 to 2815" in str(caught.value) and f"{len(rows)} of 12124 rows" in str(caught.value)


def test_rows_at_rest_are_no_repeats_under_a_rounded_clock(tmp_path: Path) -> None:
    columns = damage.motion()
    for name in ("position", "current"):
        columns[name][3000:5000] = columns[name][3000]
    recording = imported(tmp_path, damage.rounded(columns, 1e-3))
    assert len(recording.samples) == 12000 and recording.meta["dt"] == pytest.approx(0.5e-3, rel=1e-5)


@pytest.mark.parametrize("size", [TURN, TURN * (1 << 14) / (1 << 16), TURN * 20_000 / (1 << 16)])
def test_a_position_that_wraps_is_unwrapped(tmp_path: Path, size: float) -> None:
    """At one turn, at a power of two of counts, and at a range that only its own jumps show."""
    columns = damage.motion()
    recording = imported(tmp_path, damage.wrapped(columns, size))
    away = recording.column("measured") - columns["position"]
    assert np.ptp(away) < 1e-3 * size and len(repairs(recording)) == 1


@pytest.mark.parametrize("name", ["position", "current"])
@pytest.mark.parametrize("size", [40.0, -700.0])
def test_single_misread_values_are_left_out(tmp_path: Path, name: str, size: float) -> None:
    columns = damage.motion()
    recording = imported(tmp_path, damage.spiked(columns, name, [1234, 7000], size))
    assert len(recording.samples) == len(columns["time"]) - 2 and len(repairs(recording)) == 1
    kept = np.delete(columns["position"], [1234, 7000])
    np.testing.assert_allclose(recording.column("measured"), kept, rtol=1e-9, atol=1e-12)


def test_a_spike_of_the_command_that_the_current_follows_is_real(tmp_path: Path) -> None:
    """A jump of the reference's speed asked for far more in one period; the drive gave it in the next."""
    columns = damage.spiked(damage.motion(), "current", [1235, 3000, 7001], -40.0)
    columns["command"] = np.roll(columns["current"], -1)
    columns["command"][2999] = columns["command"][2998]  # nobody has asked for the second one
    path = damage.write(tmp_path / "log.csv", columns, "time_s,position_rad,current_A,current_command_A")
    (recording,) = read(path)
    (note,) = repairs(recording)
    assert len(recording.samples) == len(columns["time"]) - 1 and "1.5 s" in note


@pytest.mark.parametrize("end", ["EOF\n", "EOF", "6.0,1.2", "6.0,1.2,-", "6.0,1.2,3.1e", "\nEOF\n"])
def test_a_last_line_that_is_no_row_is_left_out(tmp_path: Path, end: str) -> None:
    columns = damage.motion()
    recording = imported(tmp_path, columns, end)
    assert len(recording.samples) == len(columns["time"]) and len(repairs(recording)) == 1


def test_a_clipped_current_is_named_with_its_level(tmp_path: Path) -> None:
    columns = damage.motion()
    cut = {**columns, "current": np.clip(columns["current"], -4.25, 4.25)}
    (note,) = repairs(imported(tmp_path, cut))
    assert "4.25 A" in note


def test_columns_of_other_rates_meet(tmp_path: Path) -> None:
    """The position every millisecond, the current between its rows."""
    columns = damage.motion()
    columns["position"][1::2] = np.nan
    columns["current"][::2] = np.nan
    recording = imported(tmp_path, columns)
    assert recording.meta["dt"] == pytest.approx(1e-3) and len(repairs(recording)) == 2
    sound = damage.motion()["current"][2:-2:2]
    assert np.std(recording.column("measured_current")[1:-1] - sound) < 0.05


@pytest.mark.parametrize("header", ["time [s],position (rad),torque [N m]", "time_s,position_rad,torque_N m"])
def test_units_in_brackets_and_spaces(tmp_path: Path, header: str) -> None:
    (tmp_path / "nominal.yaml").write_text("stage: {kind: rotary, force_constant: 0.5}")
    columns = damage.motion(seconds=1.0)
    (recording,) = read(damage.write(tmp_path / "log.csv", columns, header))
    np.testing.assert_allclose(recording.column("measured_current"), 2.0 * columns["current"], rtol=1e-9)


@pytest.mark.parametrize("header", ["motor_position_rad,load_position_rad", "load_position_rad,motor_position_rad"])
def test_the_motor_comes_before_the_load(tmp_path: Path, header: str) -> None:
    """Of two encoders the motor's is the position; the load's alone is one, too."""
    columns = damage.motion(seconds=1.0)
    motor, load = columns["position"], 1.01 * columns["position"]
    pair = [motor, load] if header.startswith("motor") else [load, motor]
    table = {"time": columns["time"], "a": pair[0], "b": pair[1]}
    (recording,) = read(damage.write(tmp_path / "two.csv", table, f"time_s,{header}"))
    np.testing.assert_allclose(recording.column("measured"), motor, rtol=1e-9, atol=1e-12)
    assert len(repairs(recording)) == 1
    alone = {"time": columns["time"], "position": load}
    (recording,) = read(damage.write(tmp_path / "one.csv", alone, "time_s,load_position_rad"))
    np.testing.assert_allclose(recording.column("measured"), load, rtol=1e-9, atol=1e-12)
