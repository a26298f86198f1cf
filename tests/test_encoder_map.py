"""A controller that knows the encoder's errors: how its tracking is judged, and where its map begins."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.evaluation import evaluate
from stagectl.gap.experiment_design.experiment import yaml_of
from stagectl.gap.experiment_design.unseen import unseen
from stagectl.kernels.effects import Harmonic
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.service.single_motion import Motion, starting_at
from stagectl.workflows.motion import Commanded, lay_out
from stagectl.workflows.simulated_motion import simulated

AMPLITUDE = 4e-4  # rad, about 0.8 um of the table


@pytest.fixture
def machine(ball_screw: Setup) -> Setup:
    p = ball_screw.stage
    return ball_screw._replace(stage=p._replace(encoder=p.encoder._replace(eccentricity=Harmonic(AMPLITUDE, 1.0, 0.3))))


def strokes(setup: Setup, without: frozenset[str]) -> Motion:
    motion = next(one for one in unseen(setup) if one.name == "unseen-strokes")
    return lay_out(setup, Commanded(f"{motion.name}.yaml", yaml_of(motion), motion.trajectory), without, Path("run.h5"))


def test_a_map_is_no_tracking_error(machine: Setup) -> None:
    """The reading differs from the reference by what the encoder adds: that is how it should read."""
    rms = []
    for without in (frozenset({"encoder_eccentricity"}), frozenset[str]()):
        recording = simulated(strokes(machine, without), machine)
        rms.append(evaluate(recording.samples, recording.meta)["tracking_error"]["rms"])
    assert rms[1] < 1.1 * rms[0] < 0.1 * AMPLITUDE * machine.file.axis.travel_per_unit


def test_a_map_begins_where_the_axis_stands(machine: Setup) -> None:
    motion, column = strokes(machine, frozenset()), SETPOINT_COLUMNS["target"]
    place = 1.0
    there = starting_at(motion, place).plan.setpoints
    assert motion.located is not None
    assert np.array_equal(there[:, column], motion.located(place).setpoints[:, column])
    assert np.abs(there - motion.plan.setpoints)[:, column].max() > 0.5 * AMPLITUDE
