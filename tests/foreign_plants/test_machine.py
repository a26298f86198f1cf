"""The machine against closed forms, and its steps against half of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.foreign_plants import machine
from tests.foreign_plants.capture_cases import command_delay, current_delay
from tests.foreign_plants.friction import LAWS
from tests.foreign_plants.machine import NOISE_PERIOD, Plant
from tests.foreign_plants.test_friction_laws import law

Array = NDArray[np.float64]
COUNT = 2.0 * math.pi / 2**20  # rad


def plant(name: str = "dahl", step: float = 1e-5, **friction: Any) -> Plant:
    controller = machine.Controller(0.5e-3, 0.01 * 80.0**2, 2.0 * 80.0 * 0.01, 0.0, 800.0)
    mechanics = machine.Mechanics(0.01, 0.14, 0.05, 0.005, 6.0, 0.3, 0.01, 4.0)
    drive = machine.Drive(0.72, 0.33e-3, 0.15e-3, 4e-3, 15.0)
    return Plant(mechanics, drive, machine.Encoder(COUNT, 0.3, 0.2e-3), controller, law(name, **friction), step)


def smooth(p: Plant) -> Plant:
    """`p` without friction, ripple and offset."""
    bare = p.mechanics._replace(offset=0.0, ripple=0.0, cogging=0.0)
    return p._replace(mechanics=bare, friction=p.friction._replace(coulomb=1e-12, static=1e-12, stiffness=1e-9))


def silence(rows: int, period: float) -> Array:
    return np.zeros(math.ceil(rows * period / NOISE_PERIOD) + 1)


def open_loop(p: Plant, commands: Any) -> machine.Trace:
    return machine.run(p, commands, silence(len(commands), p.controller.period), closed=False)


@pytest.mark.parametrize("name", LAWS)
def test_half_the_step_moves_the_axis_alike(name: str) -> None:
    """Within a fifth of a count of 2^20, in open loop, where nothing brings an error back; gms is less smooth.

    An element of gms forgets that it slipped at any touch of standstill, so that a reversal may go two ways.
    """
    time = np.arange(2000) * 0.5e-3
    commands = 5.0 * np.sin(2.0 * np.pi * 1.6 * time) + 1.5 * np.sin(2.0 * np.pi * 7.3 * time)
    ends = [open_loop(plant(name, step), commands).position[:: round(1e-5 / step)] for step in (1e-5, 0.5e-5)]
    assert np.ptp(ends[0]) > 1.0
    assert np.max(np.abs(ends[0] - ends[1])) < (3.0 if name == "gms" else 0.2) * COUNT


def test_a_free_axis_rises_exponentially() -> None:
    p = smooth(plant())
    trace = open_loop(p, np.full(400, 2.0))
    time = np.arange(len(trace.velocity)) * p.step - (p.drive.delay + p.drive.lag)
    late = time > 0.01
    exact = 0.72 * 2.0 / 0.14 * (1.0 - np.exp(-0.14 / 0.01 * time[late]))
    np.testing.assert_allclose(trace.velocity[late], exact, rtol=2e-5)


@pytest.mark.parametrize("delay", [0.0, 0.217e-3, 0.5e-3, 1.304e-3])
@pytest.mark.parametrize("period", [0.1e-3, 0.5e-3])
def test_delays_are_those_of_a_ramp(delay: float, period: float) -> None:
    """The definitions of the package, measured: a command that rises evenly, and the mean of the current."""
    p = smooth(plant())
    drive = p.drive._replace(delay=delay, quantum=1e-9, limit=1e3)
    p = p._replace(drive=drive, controller=p.controller._replace(period=period))
    time, each = np.arange(round(0.02 / period)) * period, round(period / p.step)
    trace = open_loop(p, time)  # 1 A/s
    samples = trace.current[each * np.arange(len(time))]
    lines = np.linspace(0.0, time[-1] + period, len(trace.current)) - trace.current
    mean = np.mean(0.5 * (lines[1:] + lines[:-1])[-4 * each :])  # trapezoids over four periods
    assert mean == pytest.approx(command_delay(drive, period), abs=2e-7)
    behind = (time - samples)[time > 0.01]
    assert mean - behind.mean() == pytest.approx(current_delay(drive, period), abs=2e-7)


def test_a_delay_between_two_steps_is_kept() -> None:
    p = smooth(plant())
    ends = []
    for late in (0.3e-3, 0.3043e-3):
        trace = open_loop(p._replace(drive=p.drive._replace(delay=late)), np.full(200, 2.0))
        ends.append(trace.position[-1])
    speed = trace.velocity[-1]
    assert ends[0] - ends[1] == pytest.approx(4.3e-6 * speed, rel=0.02)


def test_the_noise_that_flows_has_its_size() -> None:
    p = smooth(plant())
    rows, fall = 4000, math.exp(-NOISE_PERIOD / p.drive.lag)
    held = 0.05 * math.sqrt((1.0 + fall) / (1.0 - fall))
    noise = np.random.default_rng(1).normal(0.0, held, len(silence(rows, 0.5e-3)))
    trace = machine.run(p, np.zeros(rows), noise, closed=False)
    assert np.std(trace.current[:: round(NOISE_PERIOD / p.step)]) == pytest.approx(0.05, rel=0.03)


def test_the_encoder_reads_whole_counts_of_an_earlier_position() -> None:
    p = plant()
    trace = open_loop(p, np.full(400, 3.0))
    at = np.arange(400) * 0.5e-3 - p.encoder.age
    true = np.interp(at, np.arange(len(trace.position)) * p.step, trace.position)
    error = (trace.measured - true) / COUNT
    assert np.max(np.abs(error)) < 0.51
    assert np.ptp(error) > 0.9


def test_the_torques_balance() -> None:
    p = plant("lugre")
    bare = p._replace(mechanics=p.mechanics._replace(ripple=0.0, cogging=0.0))
    trace = open_loop(bare, 5.0 * np.sin(2.0 * np.pi * 2.0 * np.arange(1000) * 0.5e-3))
    m, time = bare.mechanics, len(trace.drift) * p.step
    impulse = p.drive.force_constant * np.mean(trace.current) * time
    spent = m.inertia * trace.velocity[-1] + m.viscous * trace.position[-1] + m.offset * time
    assert impulse - spent - np.mean(trace.friction) * time == pytest.approx(0.0, abs=1e-5)
