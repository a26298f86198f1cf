"""`load_trajectory`: bound to an axis where it is used, or made of samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.api.arguments import ArgumentError
from stagectl.api.stage import DesignedStage
from stagectl.config.source import ConfigError
from stagectl.recording.hdf5 import open_recording
from stagectl.trajectories import Sine, TrajectoryError
from tests.api.conftest import SINE, STAGE
from tests.conftest import CONFIG


def test_the_axis_decides_what_a_length_is(folder: Path) -> None:
    (folder / "turn.yaml").write_text("type: sine\namplitude: 1 rev\nfrequency: 1 Hz\nperiods: 2\n")
    turn = sc.load_trajectory("turn.yaml")
    bound = turn.bound(sc.load_stage(STAGE).setup).experiment
    assert isinstance(bound, Sine) and bound.amplitude == pytest.approx(0.012)  # the lead
    with pytest.raises(ConfigError):
        turn.bound(sc.load_stage(CONFIG / "linear-slider.yaml").setup)


def test_with_a_stage_it_is_checked_at_once(stage: DesignedStage, folder: Path) -> None:
    (folder / "bad.yaml").write_text("type: sine\namplitude: 1 kg\nfrequency: 1 Hz\nperiods: 2\n")
    later = sc.load_trajectory("bad.yaml")
    with pytest.raises(ConfigError):
        sc.load_trajectory("bad.yaml", stage)
    with pytest.raises(ConfigError):
        sc.simulate(stage, later)
    with pytest.raises(ConfigError):
        sc.load_trajectory("none.yaml")


def test_its_text_is_what_was_read(stage: DesignedStage, folder: Path) -> None:
    path = folder / "sine.yaml"
    path.write_bytes(SINE.read_bytes())
    sine = sc.load_trajectory("sine.yaml")
    path.write_text("type: sine\n")
    run = sc.simulate(stage, sine)
    assert run.recording.meta["files"]["trajectory"]["text"] == SINE.read_text() == sine.text


def test_what_it_does_with_units(stage: DesignedStage) -> None:
    sine = sc.load_trajectory(SINE, stage)
    arrays = sine.to_arrays()
    assert set(arrays) == {"time", "position", "current"}
    assert np.ptp(arrays["position"]) == pytest.approx(4e-3, rel=1e-3)
    assert "-0.002 to 0.002 m" in repr(sine) and "amplitude: 2 mm" in repr(sc.load_trajectory(SINE))
    assert sine.plot().axes[0].get_ylabel() == "position [m]"
    with pytest.raises(ArgumentError) as error:
        sc.load_trajectory(SINE).to_arrays()
    assert error.value.name == "stage"


def test_samples_are_a_trajectory(stage: DesignedStage) -> None:
    time = np.linspace(0.0, 1.0, 51)
    position = 1e-3 * (10 * time**3 - 15 * time**4 + 6 * time**5)
    run = sc.simulate(stage, (time, position))
    assert run["reference"][-1] * run.recording.meta["axis"]["travel_per_unit"] == pytest.approx(1e-3, rel=1e-6)
    assert run.summary["trajectory"] == "samples"
    text = open_recording(run.save("run.h5")).meta["files"]["trajectory"]["text"]
    assert text.splitlines()[0] == "time_s,reference_m" and len(text.splitlines()) == 52


def test_samples_that_do_not_fit() -> None:
    with pytest.raises(ArgumentError) as error:
        sc.load_trajectory(([0.0, 1.0], [0.0]))
    assert error.value.name == "source"
    with pytest.raises(TrajectoryError):
        sc.load_trajectory((np.zeros(9), np.zeros(9)))
