"""The black box over rows of a real motion: what it keeps, and that every export takes it."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import yaml
from mcap.reader import make_reader
from scipy.io import loadmat

from stagectl.config.stage_file import load_stage
from stagectl.drives.drive import Fault
from stagectl.kernels import rollout
from stagectl.realtime.shared_memory import Status
from stagectl.realtime.states import State
from stagectl.recording.exports import FORMATS, export
from stagectl.recording.hdf5 import Recording, open_recording
from stagectl.recording.replay import replay
from stagectl.service.axis_controller import COLUMNS, AxisController
from stagectl.service.black_box import AFTER, BlackBoxOrder, Watcher
from stagectl.service.recordings import about
from stagectl.workflows.motion import prepare
from stagectl.workflows.simulated_motion import pretend
from tests.conftest import CONFIG

SINE = "type: sine\namplitude: 5 mm\nfrequency: 1.6 Hz\nperiods: 2\nramp: 0.5\n"
STARTED = 3600.0  # s: the service has run for an hour
LATE = 5  # rows that nd = 1 leaves out at the end of a motion cut short


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A fault in the last fifth of a sine, whose rows go on after it."""
    folder = tmp_path_factory.mktemp("box")
    (folder / "stage.yaml").write_text((CONFIG / "ball-screw.yaml").read_text().replace("eds: ", f"eds: {CONFIG}/"))
    (folder / "sine.yaml").write_text(SINE)
    setup = load_stage(folder / "stage.yaml")
    pretend(prepare(setup, folder / "sine.yaml", frozenset(), folder / "sine.h5"))
    rows = open_recording(folder / "sine.h5").samples[list(rollout.COLUMNS)]
    axis = AxisController("axis", setup)
    alive, _ = os.pipe()
    board = axis.board.descriptor
    meta = about(axis, "black box")
    p = BlackBoxOrder(axis.ring.place, board, alive, str(folder), meta, COLUMNS, 5e-4)
    watcher, fault = Watcher(p), len(rows) - round(AFTER / p.dt) // 10
    for row in rows[:fault].tolist():
        axis.ring.write((STARTED + row[0], *row[1:], float(State.MOVING)))
    assert watcher.look(False) is None
    axis.board.say("the encoder jumps")
    axis.board.show(Status(state=float(State.FAULT), fault=float(Fault.JUMP), faults=1.0))
    for row in rows[fault:].tolist():
        axis.ring.write((STARTED + row[0], *row[1:], float(State.FAULT)))
    axis.ring.close()
    path = watcher.look(True)
    assert path is not None
    return open_recording(path)


def test_a_fault_while_it_starts_is_kept(tmp_path: Path) -> None:
    """The process takes a second to be there; the one before it was killed, and now the service dies, too."""
    axis = AxisController("axis", load_stage(CONFIG / "ball-screw.yaml"))
    alive, _ = os.pipe()
    shared = (axis.ring.place, axis.board.descriptor, alive)
    axis.board.show(Status(state=float(State.FAULT), fault=float(Fault.JUMP), faults=3.0))
    axis.ring.write((0.0,) * len(COLUMNS))
    p = BlackBoxOrder(*shared, str(tmp_path), about(axis, "black box"), COLUMNS, axis.setup.dt, faults=2)
    kept = Watcher(p).look(True)
    assert kept is not None and "jump" in kept.name
    assert Watcher(p._replace(faults=3)).look(True) is None


@pytest.mark.parametrize("state", [State.MOVING, State.ENGAGING, State.DRIVE_HOMING, State.COASTING])
def test_a_death_of_the_loop_in_a_state_with_power_is_kept(tmp_path: Path, state: State) -> None:
    axis = AxisController("axis", load_stage(CONFIG / "ball-screw.yaml"))
    alive, _ = os.pipe()
    axis.ring.write((0.0,) * len(COLUMNS))
    p = BlackBoxOrder(
        axis.ring.place, axis.board.descriptor, alive, str(tmp_path), about(axis, "black box"), COLUMNS, axis.setup.dt
    )
    watcher = Watcher(p)
    axis.board.show(Status(state=float(state)))
    kept = watcher.look(True)
    assert kept is not None and "process_died" in kept.name


def test_it_outlives_a_service_that_it_has_not_answered_yet(tmp_path: Path) -> None:
    axis = AxisController("axis", load_stage(CONFIG / "ball-screw.yaml"))
    (alive, loop), (nobody, answer) = os.pipe(), os.pipe()
    shared = (axis.ring.place, axis.board.descriptor, alive)
    axis.board.show(Status(state=float(State.FAULT), fault=float(Fault.JUMP), faults=3.0))
    axis.ring.write((0.0,) * len(COLUMNS))
    p = BlackBoxOrder(*shared, str(tmp_path), about(axis, "black box"), COLUMNS, axis.setup.dt, faults=2)
    for end in (nobody, loop):
        os.close(end)
    words = [sys.executable, "-m", "stagectl.service.black_box"]
    done = subprocess.run(
        words, input=pickle.dumps(p), stdout=answer, pass_fds=(axis.ring.descriptor, *shared[1:]), timeout=300
    )
    os.close(answer)
    assert done.returncode == 0
    (kept,) = tmp_path.glob("*.h5")
    assert "jump" in kept.name


def test_it_knows_its_fault_its_time_and_its_stage(box: Recording) -> None:
    assert box.meta["blackbox"]["fault"] == "jump"
    assert box.meta["blackbox"]["words"] == "the encoder jumps"
    first, last = box.column("time")[[0, -1]]
    assert first >= STARTED
    assert box.meta["steady"] == pytest.approx([first, last + 5e-4])
    assert box.meta["duration"] == last
    assert box.meta["files"]["stage"]["text"] == (box.path.parent / "stage.yaml").read_text()
    assert replay(box)["identical"]  # it holds the motion from its first row on


@pytest.mark.parametrize("to", FORMATS)
def test_every_export_takes_it(box: Recording, tmp_path: Path, to: str) -> None:
    target = tmp_path / ("captures" if to == "folder" else f"box.{to}")
    (done,) = export([box], to, target)
    measured = box.column("measured")
    if to == "csv":
        assert np.array_equal(pyarrow.csv.read_csv(target)["measured_rad"].to_numpy(), measured)
    elif to == "parquet":
        columns = pyarrow.parquet.read_table(target)
        assert np.array_equal(columns["measured"].to_numpy(), measured)
        assert json.loads(columns.schema.metadata[b"stagectl"])["blackbox"]["fault"] == "jump"
    elif to == "mat":
        assert np.array_equal(loadmat(target)["samples"]["measured"][0, 0].ravel(), measured)
    elif to == "mcap":
        with target.open("rb") as file:
            assert sum(1 for _ in make_reader(file).iter_messages()) >= len(measured)
    elif to == "trajectory":
        assert "type: csv" in target.read_text()
    else:
        (capture,) = yaml.safe_load((target / "captures.yaml").read_text())["captures"]
        table = pyarrow.csv.read_csv(target / capture["file"])
        assert np.array_equal(table["position_rad"].to_numpy(), measured[:-LATE])
        assert yaml.safe_load((target / "nominal.yaml").read_text())["controller"]["Ts"] == 5e-4
        assert any("left out" in note for note in done.notes)
