"""A learned current fits only what it was learned on, and says what differs."""

from __future__ import annotations

import errno
import resource
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from stagectl.config.stage_file import Setup
from stagectl.problem import ProblemKind
from stagectl.recording import learned_current
from stagectl.recording.exports import export
from stagectl.recording.hdf5 import open_recording
from stagectl.units import StageError
from stagectl.workflows.motion import blank, prepare, with_current
from stagectl.workflows.simulated_motion import pretend
from tests import problems
from tests.conftest import CONFIG

SINE = CONFIG / "trajectories" / "sine-3.2hz.yaml"
NOTHING: frozenset[str] = frozenset()


def made(setup: Setup, path: Path, without: frozenset[str] = NOTHING) -> learned_current.Learned:
    """A current learned on the sine of 3.2 Hz, written to `path` and read back."""
    here = blank(prepare(setup, SINE, without, None))
    current = np.sin(np.arange(len(here.current)) * 0.01)
    learned_current.save(path, here._replace(current=current, meta={**here.meta, "kept": 3}))
    return learned_current.load(path)


def test_it_survives_the_file_and_reaches_the_setpoints(ball_screw: Setup, tmp_path: Path) -> None:
    written = made(ball_screw, tmp_path / "a.h5")
    motion = prepare(ball_screw, SINE, NOTHING, None, tmp_path / "a.h5")
    assert np.array_equal(motion.plan.setpoints[:, 5], np.sin(np.arange(len(written.current)) * 0.01))
    assert motion.meta["layers"] == ["friction", "ptc", "ilc"]
    assert motion.meta["learned"]["kept"] == 3
    bare = prepare(ball_screw, SINE, NOTHING, None)
    assert np.array_equal(np.delete(motion.plan.setpoints, 5, 1), np.delete(bare.plan.setpoints, 5, 1))
    assert np.array_equal(with_current(bare, written.current).plan.setpoints, motion.plan.setpoints)


def changed(setup: Setup, **changes: Any) -> Setup:
    body = setup.stage.mechanics
    if "inertia" in changes:
        return setup._replace(stage=setup.stage._replace(mechanics=body._replace(inertia=changes["inertia"])))
    return setup.having(control=setup.file.control._replace(**changes))


def refused(setup: Setup, path: Path, words: str, trajectory: Path = SINE, without: frozenset[str] = NOTHING) -> None:
    with pytest.raises(learned_current.LearnedError, match=words) as error:
        prepare(setup, trajectory, without, None, path)
    assert "nothing has moved" in str(error.value)
    assert "Learn again with `stagectl learn`, or run without --learned" in str(error.value)


def test_another_motion_is_refused(ball_screw: Setup, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    made(ball_screw, path)
    other = tmp_path / "other.yaml"
    refused(
        ball_screw,
        path,
        r"sine-3.2hz of 1\.975 s, this one \(sine-1.6hz\) takes 3\.225 s",
        SINE.with_name("sine-1.6hz.yaml"),
    )
    other.write_text(SINE.read_text().replace("2 mm", "2.001 mm"))
    refused(ball_screw, path, r"whose reference differs from this one \(other\) from 0\.0\d+ s on", other)
    other.write_text("# the same motion by another name\n" + SINE.read_text())
    assert prepare(ball_screw, other, NOTHING, None, path).meta["layers"][-1] == "ilc"


def test_other_circumstances_are_refused(ball_screw: Setup, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    made(ball_screw, path)
    refused(ball_screw, path, r"with the layers friction\+ptc, this run has ptc", without=frozenset({"friction"}))
    slower = changed(ball_screw, period=4e-4)
    refused(slower, path, r"at a period of 0\.5 ms, this stage runs at 0\.4 ms")
    heavier = changed(ball_screw, inertia=0.011)
    refused(heavier, path, r"with (law\.feedback\.|stage\.mechanics\.inertia)")
    slow = changed(ball_screw, bandwidth=35.0)
    refused(slow, path, r"with law\.feedback\.decay = ")


def test_files_that_are_none(ball_screw: Setup, tmp_path: Path) -> None:
    with problems.refused(learned_current.LearnedError, kind=ProblemKind.FILE, file=tmp_path / "absent.h5"):
        learned_current.load(tmp_path / "absent.h5")
    (tmp_path / "text.h5").write_text("not a current")
    with problems.refused(learned_current.LearnedError, kind=ProblemKind.SYNTAX, file=tmp_path / "text.h5"):
        learned_current.load(tmp_path / "text.h5")
    here = blank(prepare(ball_screw, SINE, NOTHING, None))
    with problems.refused(StageError, kind=ProblemKind.CONFLICT, file=tmp_path / "text.h5"):
        learned_current.save(tmp_path / "text.h5", here)
    assert (tmp_path / "text.h5").read_text() == "not a current"
    made(ball_screw, tmp_path / "b.h5")
    made(ball_screw, tmp_path / "b.h5")  # one of ours may be written over


def test_a_disk_that_is_full_leaves_what_was_there(ball_screw: Setup, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    learned, before = made(ball_screw, path), path.read_bytes()
    room = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, room[1]))
    try:
        with pytest.raises(learned_current.LearnedError) as error:
            learned_current.save(path, learned)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, room)
    assert isinstance(error.value.__cause__, OSError)
    assert error.value.__cause__.errno == errno.EFBIG
    assert error.value.problems[0].kind is ProblemKind.FILE
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_holds_the_learned_current_and_the_observer(ball_screw: Setup, tmp_path: Path) -> None:
    """The added current stands in a file of its own, which captures.yaml names; the observer in nominal.yaml."""
    control = ball_screw.file.control._replace(layers=("ptc", "observer"))
    motion = prepare(ball_screw.having(control=control), SINE, NOTHING, tmp_path / "r.h5")
    pretend(with_current(motion, np.full(len(motion.plan.setpoints), 0.1)))
    folder = export([open_recording(tmp_path / "r.h5")], "folder", tmp_path / "there")[0].path
    (capture,) = yaml.safe_load((folder / "captures.yaml").read_text())["captures"]
    added = np.loadtxt(folder / capture["injection"], delimiter=",", skiprows=1)
    rows = len((folder / capture["file"]).read_text().splitlines()) - 1
    np.testing.assert_array_equal(added[:, 1], np.full(rows, 0.1))
    controller = yaml.safe_load((folder / "nominal.yaml").read_text())["controller"]
    assert controller["observer_gains"][2] == motion.law.observer.disturbance
    assert controller["observer_model"]["share"] == pytest.approx(1.0 - 0.159 / 0.5)
