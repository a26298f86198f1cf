"""Constant speed: the damping within 0.1 %, whatever the ripple; intervals that hold; refusal with the reason."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.identification.capture import Capture, IdentificationError, Refusal
from stagectl.identification.constant_speed import SpeedSpan, _quantile, identify, straight_line
from stagectl.identification.result import Note, Topic, topics
from stagectl.trajectories import Sequence, Sine, Trapezoid
from tests.identification.virtual import STAGE_A, Machine, held

SETUP = load_stage(STAGE_A)
KT, J, D, TC = 0.72, 0.010, 0.14, 1.0
ROTATION = 2.0 * np.pi / 12e-3  # rad/m
SPEEDS = (0.01, 0.02, 0.04, 0.06, 0.08, 0.1)  # m/s
FILE = SETUP.file


def followed(machine: Machine, motion: Any) -> Capture:
    """Closed loop with the linear model fed forward: without it the PID alone would run into the current limit."""
    t = SETUP.dt * np.arange(round((motion.duration + 0.1) / SETUP.dt))
    x, v, a = (ROTATION * column for column in motion.at(t))
    return held(machine, x, (J * a + D * v) / KT, excitation=None)


def there_and_back(speeds: tuple[float, ...], revolutions: float = 3.0, one_way: bool = False) -> Sequence:
    """Trapezoids of so many whole revolutions at each speed, and what speeding up and settling takes."""
    ways = [revolutions * 0.012 + 0.5 * v for v in speeds]
    return Sequence(tuple(Trapezoid(s, v, 0.5, 0.1, one_way=one_way) for s, v in zip(ways, speeds, strict=True)))


@pytest.mark.parametrize("ripple", [0.0, 0.05])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_damping_within_a_tenth_of_a_per_cent(ripple: float, seed: int) -> None:
    result = identify([followed(Machine(SETUP, ripple=ripple, seed=seed), there_and_back(SPEEDS))], FILE)
    assert result.parameters["viscous"].value == pytest.approx(D, rel=1e-3)
    assert result.parameters["coulomb"].value == pytest.approx(TC, abs=0.003)
    assert result.parameters["offset"].value == pytest.approx(0.0, abs=0.003)
    assert result.changes == {"mechanics.viscous": result.parameters["viscous"].value}
    assert len(result.details["spans"]) == 2 * len(SPEEDS)
    assert all(span["revolutions"] >= 3 for span in result.details["spans"])
    assert max(map(abs, result.details["residual"])) < 0.01  # N m, of forces of up to 8 N m
    json.dumps(result.details, allow_nan=False)


def test_averaged_over_time_ripple_biases_and_it_is_noted() -> None:
    """The same ripple over 0.7 of a revolution: what whole revolutions are good for."""
    speeds = (0.01, 0.02, 0.04)
    ways = tuple(Trapezoid(0.7 * 0.012 + 0.25 * v, v, 0.5, 0.1) for v in speeds)
    result = identify([followed(Machine(SETUP, ripple=0.05), Sequence(ways))], FILE)
    assert Topic.REVOLUTION in topics(result.notes)
    assert 0.001 < abs(result.parameters["coulomb"].value / TC - 1.0) < 0.05


def test_one_capture_per_speed_is_the_same() -> None:
    captures = [followed(Machine(SETUP, seed=k), there_and_back((v,))) for k, v in enumerate((0.02, 0.05, 0.1))]
    result = identify(captures, FILE)
    assert result.parameters["viscous"].value == pytest.approx(D, rel=1e-3)
    assert len(result.details["spans"]) == 6


def test_gravity_is_the_offset() -> None:
    p = SETUP.stage
    machine = Machine(SETUP._replace(stage=p._replace(mechanics=p.mechanics._replace(bias=-0.3))))
    result = identify([followed(machine, there_and_back((0.02, 0.06)))], FILE)
    assert result.parameters["offset"].value == pytest.approx(0.3, abs=0.01)
    assert result.parameters["coulomb"].value == pytest.approx(TC, abs=0.01)
    assert result.details["coulomb_positive"] == pytest.approx(1.3, abs=0.01)
    assert result.details["coulomb_negative"] == pytest.approx(0.7, abs=0.01)


def spans(seed: int, deviation: float) -> list[SpeedSpan]:
    """Spans as they would be measured: six speeds both ways, force with normal errors."""
    source = np.random.default_rng(seed)
    speeds = [s * v for v in (5.0, 10.0, 20.0, 30.0, 40.0, 50.0) for s in (1.0, -1.0)]
    forces = [D * v + math.copysign(TC, v) + source.normal(0.0, deviation) for v in speeds]
    return [SpeedSpan("made", 0.0, 1.0, 3, v, f, deviation, 0.0, 0.0) for v, f in zip(speeds, forces, strict=True)]


def test_covariance_is_the_spread_over_repetitions() -> None:
    runs = [straight_line(spans(seed, 0.01), both=True) for seed in range(300)]
    spread = np.std([values for values, _, _ in runs], axis=0)
    claimed = np.sqrt(np.mean([np.diag(covariance) for _, covariance, _ in runs], axis=0))
    assert spread == pytest.approx(claimed, rel=0.15)


def test_a_line_that_scatters_more_than_its_noise_is_known_by_its_few_spans_alone() -> None:
    """Student's quantile of their own freedom; where the batches' noise explains the scatter, of all batches."""
    assert _quantile(2, 5, 10.0) == pytest.approx(4.3027, abs=1e-4)
    assert _quantile(2, 5, 1.0) == pytest.approx(2.0117, abs=1e-4)  # 47 degrees of freedom


def test_intervals_hold_the_truth() -> None:
    """15 runs of two speeds both ways, D, T_c and offset: 43 of 45 are expected, 37 to 45 accepted."""
    motion = there_and_back((0.05, 0.1))
    hits = 0
    for seed in range(15):
        parameters = identify([followed(Machine(SETUP, seed=seed), motion)], FILE).parameters
        truths = {"viscous": D, "coulomb": TC, "offset": 0.0}
        hits += sum(parameters[name].low <= truth <= parameters[name].high for name, truth in truths.items())
    assert 37 <= hits <= 45
    assert parameters["viscous"].high - parameters["viscous"].low < 0.003 * D


def test_one_way_only_says_what_it_cannot_tell() -> None:
    motion = there_and_back((0.01, 0.02, 0.04), one_way=True)
    result = identify([followed(Machine(SETUP), motion)], FILE)
    assert set(result.parameters) == {"viscous", "coulomb"}
    assert result.parameters["viscous"].value == pytest.approx(D, rel=5e-3)
    assert Topic.OFFSET in topics(result.notes)


def test_a_span_at_the_current_limit_is_left_out() -> None:
    capture = followed(Machine(SETUP), there_and_back((0.02, 0.04, 0.08)))
    clipped = capture._replace(current=np.clip(capture.current, -9.0, 9.0))
    limited = FILE._replace(drive=FILE.drive._replace(current_limit=9.0))
    result = identify([clipped], limited)
    assert sum(isinstance(note, Note) and note.topic is Topic.CLIPPED for note in result.notes) == 2
    assert result.parameters["viscous"].value == pytest.approx(D, rel=5e-3)


def test_captures_without_two_speeds_are_refused() -> None:
    once = followed(Machine(SETUP), there_and_back((0.02,)))
    slow = followed(Machine(SETUP), Sine(0.02, 0.2, 2.0))
    rows = once.time < 2.6
    uneven = once._replace(**{name: getattr(once, name)[rows] for name in ("time", "position", "current")})
    for captures, reason, value in (
        ([once], Refusal.NO_STEADY_SPEED, 1),
        ([slow], Refusal.NO_STEADY_SPEED, 0),
        ([uneven], Refusal.NO_STEADY_SPEED, 1),
        ([once._replace(current=np.full(len(once.time), 2.0))], Refusal.CONSTANT_CURRENT, 2.0),
    ):
        with pytest.raises(IdentificationError) as caught:
            identify(captures, FILE)
        assert (caught.value.reason, caught.value.value) == (reason, value)
