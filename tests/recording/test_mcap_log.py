"""MCAP, read back by another package's own parser: every bit, with units and times, and what the recording is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.extras import MissingExtraError
from stagectl.recording.exports import export
from stagectl.recording.hdf5 import Recording, open_recording
from stagectl.workflows.motion import prepare
from stagectl.workflows.simulated_motion import pretend
from tests.conftest import CONFIG

pytest.importorskip("rosbags", reason="rosbags is not installed: pip install rosbags")


@pytest.fixture(scope="module")
def sine(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("mcap")
    (folder / "sine.yaml").write_text("type: sine\namplitude: 5 mm\nfrequency: 1.6 Hz\nperiods: 1\nramp: 0.5\n")
    pretend(prepare(load_stage(CONFIG / "ball-screw.yaml"), folder / "sine.yaml", frozenset(), folder / "sine.h5"))
    return open_recording(folder / "sine.h5")


def test_another_reader_finds_every_bit(sine: Recording, tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader

    ((path, notes),) = export([sine], "mcap", tmp_path / "sine.mcap")
    assert notes == []
    with AnyReader([path]) as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == ("/axis", "stagectl_msgs/msg/Period")
        assert "float64 current_A  # command handed to the drive, after the limit\n" in connection.msgdef.data
        messages = [(stamp, reader.deserialize(raw, connection.msgtype)) for _, stamp, raw in reader.messages()]
    names = {"time_s": "time", "error_rad": "error", "measured_rad": "measured", "current_A": "current"}
    for header, name in names.items():
        assert np.array_equal([getattr(row, header) for _, row in messages], sine.column(name)), header
    assert np.all(np.diff([stamp for stamp, _ in messages]) == 500_000)


def test_it_says_what_it_is(sine: Recording, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    export([sine], "mcap", tmp_path / "sine.mcap")
    with (tmp_path / "sine.mcap").open("rb") as file:
        reader = make_reader(file)
        (about,) = reader.iter_metadata()
        names = [iter_attachment.name for iter_attachment in reader.iter_attachments()]
    assert json.loads(about.metadata["meta"]) == sine.meta
    assert names == ["ball-screw.yaml", "sine.yaml"]


def test_without_the_package_it_says_how_to_get_it(
    sine: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mcap", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'stagectl\[mcap\]'") as caught:
        export([sine], "mcap", tmp_path / "sine.mcap")
    assert (caught.value.package, caught.value.extra) == ("mcap", "mcap")
