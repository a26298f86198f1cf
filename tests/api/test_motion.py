"""`simulate` and `run`: the rows of the command line, layers, seeds, and a friction law of one's own."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl import simulation
from stagectl.api.arguments import ArgumentError
from stagectl.api.record import MotionRecord
from stagectl.api.stage import DesignedStage
from stagectl.kernels import friction
from stagectl.trajectories import TrajectoryError
from stagectl.units import StageError
from tests.api.conftest import SINE, STAGE
from tests.conftest import CONFIG, Command


def test_the_command_gives_the_same(run: MotionRecord, command: Command) -> None:
    code, out, _ = command("simulate", STAGE, SINE, "-o", "run.h5", "--json", "-")
    assert code == 0
    assert json.loads(out) == json.loads(json.dumps(run.summary | {"recording": "run.h5"}))
    same = sc.load_log("run.h5")
    assert isinstance(same, MotionRecord) and same.samples.tobytes() == run.samples.tobytes()


def test_nothing_is_written(stage: DesignedStage, folder: Path) -> None:
    sc.simulate(stage, SINE)
    assert list(folder.iterdir()) == []


def test_layers_are_switched_off(stage: DesignedStage, run: MotionRecord) -> None:
    bare = sc.simulate(stage, SINE, without=["friction"])
    assert bare.recording.meta["layers"] == ["ptc"] and not bare["friction"].any()
    ratio = bare.summary["tracking_error"]["peak"] / run.summary["tracking_error"]["peak"]
    assert 100.0 < ratio < 500.0
    with pytest.raises(ArgumentError) as error:
        sc.simulate(stage, SINE, without=["pid"])
    assert (error.value.name, error.value.value) == ("without", "pid")


def test_a_seed_is_that_of_the_noise(stage: DesignedStage) -> None:
    noisy = stage.changed({"simulation.current_noise": 5e-3})
    rows = [sc.simulate(stage, SINE, plant=noisy, seed=seed).samples.tobytes() for seed in (1, 2, 2)]
    assert rows[0] != rows[1] == rows[2]


def test_beyond_a_limit_nothing_runs(stage: DesignedStage, folder: Path) -> None:
    (folder / "far.yaml").write_text("type: sine\namplitude: 51 mm\nfrequency: 0.1 Hz\nperiods: 1\n")
    with pytest.raises(TrajectoryError):
        sc.simulate(stage, "far.yaml")
    with pytest.raises(StageError):
        sc.simulate(stage, SINE, plant=CONFIG / "linear-slider.yaml")


def test_without_friction_the_interpreted_loop_gives_the_same_bits(stage: DesignedStage) -> None:
    smooth = stage.setup._replace(stage=simulation._without_friction(stage.setup))
    compiled = sc.simulate(stage, SINE, plant=DesignedStage(smooth))
    interpreted = sc.simulate(stage, SINE, friction=lambda velocity, position, step: 0.0)
    assert interpreted.samples.tobytes() == compiled.samples.tobytes()


def test_the_friction_of_the_model_as_a_law_of_ones_own(stage: DesignedStage, run: MotionRecord) -> None:
    """The force is held over a step, so the two differ by about one encoder step, 6 urad."""
    operators = stage.setup.stage.friction.operators
    states, last = friction.relaxed(operators), [0.0]

    def law(velocity: float, position: float, step: float) -> float:
        force = friction.stops(operators, states, position - last[0])
        last[0] = position
        return float(force)

    own = sc.simulate(stage, SINE, friction=law)
    assert 1e-6 < float(np.max(np.abs(own["true_position"] - run["true_position"]))) < 8e-6


def test_a_friction_that_moves_the_axis_is_noted(stage: DesignedStage) -> None:
    """Held over a step, a force that is far too steep throws the axis to and fro, and out of its travel."""
    run = sc.simulate(stage, SINE, friction=lambda velocity, position, step: math.copysign(1e9, velocity))
    assert len(run.notes) == 1 and run.summary["fault"]
    assert run.sheet().answer.startswith(run.summary["fault"][1:20], 1)
    helped = sc.simulate(stage, SINE, friction=lambda velocity, position, step: -0.01 * velocity)
    assert len(helped.notes) == 1 and not helped.summary["fault"]


def test_a_law_that_cannot_be_simulated(stage: DesignedStage) -> None:
    with pytest.raises(StageError):
        sc.simulate(stage, SINE, friction=lambda velocity, position, step: float("nan"))
    cogging = stage.changed({"motor.cogging": {"amplitude": 0.01}})
    with pytest.raises(StageError):
        sc.simulate(stage, SINE, plant=cogging, friction=lambda velocity, position, step: 0.0)


@pytest.mark.parametrize(("acceleration", "noted"), [("50 mm/s^2", 0), ("0.1 mm/s^2", 1)])
def test_a_velocity_that_is_never_reached_is_noted(
    stage: DesignedStage, folder: Path, acceleration: str, noted: int
) -> None:
    """A slip by a thousand in one unit makes a motion that creeps."""
    move = "{type: trapezoid, distance: 0.05 mm, velocity: 1 mm/s, acceleration: " + acceleration + "}"
    (folder / "move.yaml").write_text("{type: sequence, parts: [" + move + "]}")
    assert len(sc.simulate(stage, "move.yaml").notes) == noted
