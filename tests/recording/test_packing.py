"""Rows go into a file and come back bit for bit, whatever they hold; what follows from other columns takes no room."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.config.stage_file import load_stage
from stagectl.design import design
from stagectl.kernels import rollout
from stagectl.plan import plan
from stagectl.recording.constants import BLOCK
from stagectl.recording.hdf5 import Writer, open_recording, repair, save
from stagectl.recording.metadata import of_axis
from stagectl.recording.packing import RULES
from stagectl.simulation import simulate
from stagectl.trajectories import Sine
from tests.conftest import CONFIG

SPECIAL = [0.0, -0.0, np.nan, -np.nan, np.inf, -np.inf, 5e-324, 1e300, -1e300, 2.0**53, 1.0]
AN_HOUR = 3600 * 2000  # rows at 2 kHz
MIB = 2.0**20  # bytes


def about(name: str, noise: str = "") -> tuple[dict[str, Any], NDArray[Any]]:
    """What a recording of a shipped stage says about itself, and a sine of it as its drive reports it."""
    path = CONFIG / name
    text = path.read_text().replace("  substeps: 10", f"  substeps: 10{noise}")
    setup = load_stage(path, text=text)
    controller = design(setup.stage, setup.file.control)
    rows = simulate(setup, plan(setup, Sine(5e-3, 1.6, 6), controller.feedforward), controller.law)
    step = getattr(setup.file.drive.wire, "current_scale", 1.0)
    rows["measured_current"] = np.round(rows["measured_current"] / step) * step + 0.0  # a count is never -0
    rows["true_position"] = np.nan
    rows["lateness"] = np.random.default_rng(1).gamma(2.0, 20e-6, len(rows)).round(9)
    return of_axis(setup, setup.controller, text), rows


@pytest.fixture(scope="module")
def motion() -> tuple[dict[str, Any], NDArray[Any]]:
    return about("ball-screw.yaml", "\n  encoder_noise: 20 nm\n  current_noise: 45 mA")


def written(path: Path, meta: dict[str, Any], rows: NDArray[Any], block: int = 512) -> Path:
    writer = Writer(path, meta, rows.dtype.names or ())
    for first in range(0, len(rows), block):
        writer.append(np.ascontiguousarray(rows[first : first + block]).tobytes())
    writer.close("complete", 0)
    return path


def same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    return a.dtype == b.dtype and np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes()


@pytest.mark.parametrize("block", [1, 100, 512, 100_000])
def test_each_bit_comes_back_however_it_is_cut(tmp_path: Path, motion: Any, block: int) -> None:
    meta, rows = motion
    rows = rows[:600] if block == 1 else rows
    assert same(open_recording(written(tmp_path / "a.h5", meta, rows, block)).samples, rows)


def test_what_follows_from_other_columns_takes_no_room(tmp_path: Path, motion: Any) -> None:
    """Every prediction of the law and of the counts is exact, so an hour with noise in every column is 250 MiB."""
    meta, rows = motion
    path = written(tmp_path / "a.h5", meta, rows)
    with h5py.File(path) as file:
        assert {*RULES, "measured", "measured_current", "time"} == set(file["remainders"].dtype.names)
        wrong = {name: np.count_nonzero(file["remainders"][name]) for name in file["remainders"].dtype.names}
        assert not any(wrong.values()), wrong
        stored = sum(file[name].id.get_storage_size() for name in ("samples", "counts", "remainders"))
    assert 150.0 < stored / len(rows) * AN_HOUR / MIB <= 250.0


def test_any_bits_come_back(tmp_path: Path, motion: Any) -> None:
    """Rows that no law gave: noise, infinities, what is not a number, the loop open and closed, wrong gains."""
    meta, rows = motion
    source, wild = np.random.default_rng(5), rows[:3000].copy()
    for name in wild.dtype.names:
        places = source.integers(0, len(wild), 200)
        wild[name][places] = source.choice(SPECIAL, 200)
        wild[name][places[:50]] = source.integers(0, 2**63, 50).astype("<u8").view("<f8")
    assert same(open_recording(written(tmp_path / "a.h5", meta, wild)).samples, wild)
    noise = np.frombuffer(source.bytes(wild.nbytes), wild.dtype)
    assert same(open_recording(written(tmp_path / "b.h5", meta, noise)).samples, noise)


def test_other_gains_cost_room_and_no_bit(tmp_path: Path, motion: Any) -> None:
    meta, rows = motion
    wrong = {**meta, "law": {**meta["law"], "feedback": {**meta["law"]["feedback"], "integral": 1.0}}}
    assert same(open_recording(written(tmp_path / "a.h5", wrong, rows)).samples, rows)


@pytest.mark.parametrize("name", ["linear-slider.yaml", "emps.yaml", "odrive.yaml"])
def test_other_machines_and_laws(tmp_path: Path, name: str) -> None:
    """A linear axis, a cascade, a drive without counts of current."""
    meta, rows = about(name)
    assert same(open_recording(written(tmp_path / "a.h5", meta, rows)).samples, rows)


def test_some_columns_are_the_same_as_among_all(tmp_path: Path, motion: Any) -> None:
    meta, rows = motion
    some = open_recording(written(tmp_path / "a.h5", meta, rows), only=("current", "measured", "reference")).samples
    assert some.dtype.names == ("reference", "current", "measured")
    assert all(same(some[name], rows[name]) for name in some.dtype.names)


def test_an_import_without_a_law_is_stored_as_it_is(tmp_path: Path) -> None:
    rows = np.zeros(10, [(name, "<f8") for name in rollout.COLUMNS])
    save(tmp_path / "a.h5", {"created": "now", "axis": {"kind": "rotary"}}, rows, "imported")
    with h5py.File(tmp_path / "a.h5") as file:
        assert set(file) == {"samples"}
    assert same(open_recording(tmp_path / "a.h5").samples, rows)


def test_a_file_of_the_first_format_is_read(tmp_path: Path, motion: Any) -> None:
    """As it was until then: all columns in one dataset."""
    _, rows = motion
    path = written(tmp_path / "a.h5", {"created": "then", "axis": {"kind": "rotary"}}, rows)
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = "stagectl-recording/1"
        del file["samples"].attrs["columns"]
    assert same(open_recording(path).samples, rows)


def test_a_killed_writer_leaves_the_rows_that_all_datasets_have(tmp_path: Path, motion: Any) -> None:
    """As it lies on the disk before the writer closes it; and where the last block is there in part."""
    meta, rows = motion
    writer = Writer(tmp_path / "a.h5", meta, rows.dtype.names or ())
    for first in range(0, 4096, BLOCK):
        writer.append(np.ascontiguousarray(rows[first : first + BLOCK]).tobytes())
    assert same(open_recording(tmp_path / "a.h5").samples, rows[:4096])
    shutil.copy(tmp_path / "a.h5", tmp_path / "killed.h5")
    writer.close("complete", 0)
    assert repair(tmp_path / "killed.h5")
    killed = open_recording(tmp_path / "killed.h5")
    assert not killed.complete and same(killed.samples, rows[:4096])
    with h5py.File(tmp_path / "killed.h5", "r+") as file:
        file["samples"].resize((4096 - BLOCK,))
    assert same(open_recording(tmp_path / "killed.h5").samples, rows[: 4096 - BLOCK])


@pytest.mark.parametrize("count", [1, 7500])
def test_room_that_was_not_needed_is_given_back(
    motion: tuple[dict[str, Any], NDArray[Any]], tmp_path: Path, count: int
) -> None:
    meta, rows = motion
    save(tmp_path / "a.h5", meta, rows[:count], "complete")
    with h5py.File(tmp_path / "a.h5") as file:
        content = sum(each.id.get_storage_size() for each in file.values())
    assert (tmp_path / "a.h5").stat().st_size < content + (1 << 16)
    assert (tmp_path / "a.h5").stat().st_blocks * 512 < content + (1 << 16)
