"""Columns of the equation of motion, piece by piece."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.identification.capture import Array, Capture
from stagectl.identification.simultaneous.friction_columns import followed, path
from stagectl.identification.simultaneous.regressors import Part, _lightly_smoothed, part, stepped
from stagectl.identification.simultaneous.sensor_noise import _differences
from stagectl.identification.simultaneous.windows import Rows, knots, resolution


def test_the_operators_follow_a_motion_and_a_third_of_the_rounding() -> None:
    """A cubic B-spline leaves a ramp as it is, and (4 - 2)/6 of what alternates from sample to sample."""
    ramp = 3.0 * np.arange(10.0)
    assert _lightly_smoothed(ramp) == pytest.approx(ramp)
    dither = np.where(np.arange(10) % 2, 1.0, -1.0)
    assert _lightly_smoothed(dither)[1:-1] == pytest.approx(dither[1:-1] / 3.0)


def test_fourth_differences_tell_noise_from_a_motion_that_is_sampled_slowly() -> None:
    """Of noise those of every second sample are as large, of jumps twice as large, of what is smooth far larger."""
    noise = np.random.default_rng(2).normal(0.0, 0.1, 20000)
    jumps = np.repeat(np.where(np.arange(200) % 2, 1.0, -1.0), 100)
    smooth = np.sin(0.3 * np.arange(20000))
    assert _differences(noise, 1) == pytest.approx(70.0 * 0.01, rel=0.05)
    assert _differences(noise, 2) == pytest.approx(_differences(noise, 1), rel=0.05)
    assert _differences(jumps, 2) == pytest.approx(2.0 * _differences(jumps, 1), rel=0.05)
    assert _differences(smooth, 2) > 100.0 * _differences(smooth, 1)


TIME: Array = np.arange(4000, dtype=np.float64) * 5e-3
COUNT = 1e-5


def moved(noise: Array) -> Capture:
    """A sine of 1 rad with this `noise` (n,) rad, without a current."""
    position = np.sin(2.0 * np.pi * 0.7 * TIME) + noise
    return Capture("sine", TIME, position, np.zeros(len(TIME)), 5e-3, encoder_step=COUNT)


def test_noise_that_grows_with_the_speed_is_no_rounding_and_does_not_hide_a_reversal() -> None:
    """Time stamps that jitter by 0.3 ms: at a reversal the axis does not move meanwhile."""
    late = np.random.default_rng(4).normal(0.0, 0.3e-3, len(TIME))
    jitter = moved(4.4 * np.cos(2.0 * np.pi * 0.7 * TIME) * late)
    even = moved(np.random.default_rng(4).normal(0.0, 1e-3, len(TIME)))
    assert resolution(jitter) < 0.3 * resolution(even)
    assert not stepped(Part(jitter, Rows(0, 1, 6), 6))
    assert stepped(Part(moved(np.zeros(len(TIME))), Rows(0, 1, 6), 6))


def test_a_model_that_strays_from_the_rows_is_not_followed() -> None:
    """One of next to no inertia, whose acceleration is what force and friction leave over next to nothing."""
    capture = moved(np.zeros(len(TIME)))
    p = Part(capture, Rows(30, 600, 6), 6)
    along = path(p, np.zeros(600))
    wild = 300.0 * np.sign(np.sin(2.0 * np.pi * 9.0 * along.dt * np.arange(len(along.position))))
    assert followed(p, along, wild) is along
    right = -((2.0 * np.pi * 0.7) ** 2) * along.position
    assert followed(p, along, right) is not along


def test_rows_of_a_standing_axis_and_of_its_first_counts_are_between_the_spans() -> None:
    """Two moves of a radian with a rest of 1 s within a count: then the friction may be any."""
    there = np.clip(TIME - 5.0, 0.0, 1.0) - np.clip(TIME - 7.0, 0.0, 1.0)
    swing = np.where(TIME < 5.0, np.sin(2.0 * np.pi * 0.7 * TIME), 0.0)
    count = 1e-2
    moving = moved(np.zeros(len(TIME)))._replace(
        position=count * np.round((swing + 0.3 * there) / count), encoder_step=count
    )
    p = part(moving, 6, 0.0, 0.0)
    seconds = TIME[p.places.samples]
    assert p.rows == len(seconds) < p.uncut.rows
    assert not np.any((seconds > 6.05) & (seconds < 7.05))  # at rest, and four counts of 10 mrad at 0.3 rad/s
    assert np.any((seconds > 7.2) & (seconds < 7.9))
    assert part(moving._replace(encoder_step=0.0), 6, 0.0, 0.0).places.spans == ()


def test_the_rows_of_the_spans_are_those_of_all_rows() -> None:
    rows = Rows(10, 12, 3, spans=((1, 4), (6, 11)))
    assert rows.counts == (3, 5)
    assert rows.samples.tolist() == [13, 16, 19, 28, 31, 34, 37, 40]
    assert rows.head(5).samples.tolist() == rows.samples[:5].tolist() and rows.head(5).number == 8
    assert rows.head(2).spans == ((1, 3),) and rows.head(99) == rows._replace(number=11)
    assert rows.thinned(2).samples.tolist() == [16, 28, 34, 40]


def test_the_speed_around_a_reversal_is_not_that_of_a_window_for_accelerations() -> None:
    """2 kHz and 20,000 counts: friction that falls within 0.2 rad/s of a reversal is still there."""
    time: Array = np.arange(8000, dtype=np.float64) * 0.5e-3
    count, turn = 2.0 * np.pi / 20000, 2.0 * np.pi * 1.6
    swing = np.sin(turn * time) / turn
    capture = moved(np.zeros(len(TIME)))._replace(
        time=time, position=count * np.round(swing / count), current=np.zeros(len(time)), dt=0.5e-3, encoder_step=count
    )
    p = part(capture, knots(capture), 0.0, 0.0)
    speed = path(p, np.zeros(p.rows)).velocity
    rows = slice(200, -200)
    assert stepped(p) and p.wide > 5
    assert float(np.std(speed[rows] - np.cos(turn * time)[rows])) < 0.05
