r"""Identification by the step response, which the ball-screw paper calls unsuitable (section IV.A.1).

A current step in open loop, from rest; the first-order model of the paper's (1) is fitted to the position::

    x(t) = Kt i/D [t - T (1 - exp(-t/T))],   T = J/D

Friction takes Tc off the torque for the whole rise.  The response keeps its shape and loses height, so J and D both
come out too large, by ``1 / (1 - Tc/(Kt i))``: the less, the larger the step.
"""

from typing import NamedTuple

import numpy as np
from scipy import optimize

from stagectl.compensation.legs import Array
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.plan import command_delay, plan
from stagectl.simulation import simulate
from stagectl.trajectories import CurrentSine
from stagectl_studies.reproduction import chosen
from stagectl_studies.reproduction.bench import NO_FRICTION, Bench


class StepResponse(NamedTuple):
    """One step, and the model fitted to it."""

    current: float  # A
    time: Array  # (n,) s, from when the current begins to act
    position: Array  # (n,) rad, from rest
    inertia: float  # kg m^2
    viscous: float  # N m s/rad


def steps(bench: Bench) -> list[StepResponse]:
    """All steps of `chosen.STEPS` (A)."""
    return [_step(bench, current) for current in chosen.STEPS]


def rise(time: Array, torque: float, inertia: float, viscous: float) -> Array:
    """Position (n,) rad of the first-order model under a constant `torque` (N m)."""
    constant = inertia / viscous
    return np.asarray(torque / viscous * (time + constant * np.expm1(-time / constant)), dtype=np.float64)


def _step(bench: Bench, current: float) -> StepResponse:
    believed = bench.believed
    controller = believed.controller.without(NO_FRICTION)
    length = chosen.STEP_START + chosen.STEP_LENGTH
    open_loop = CurrentSine(current, 4.0 / length, 4.0)  # planned for its length; its current is replaced
    laid_out = plan(believed, open_loop, controller.feedforward)
    rows = laid_out.setpoints.copy()
    time: Array = bench.machine.dt * np.arange(len(rows), dtype=np.float64)
    on = (time >= chosen.STEP_START) & (time < length)
    rows[:, SETPOINT_COLUMNS["injection"]] = np.where(on, current, 0.0)
    samples = simulate(believed, laid_out._replace(setpoints=rows), controller.law, bench.machine)
    acting = time - chosen.STEP_START - command_delay(bench.machine)
    inside = (acting >= 0.0) & (time < length)
    return _fitted(bench, current, acting[inside], samples["measured"][inside] - samples["measured"][0])


def _fitted(bench: Bench, current: float, time: Array, position: Array) -> StepResponse:
    torque = bench.believed.stage.motor.force_constant * current
    believed = bench.believed.stage.mechanics
    (inertia, viscous), _ = optimize.curve_fit(
        lambda t, j, d: rise(t, torque, j, d), time, position, (believed.inertia, believed.viscous)
    )
    return StepResponse(current, time, position, float(inertia), float(viscous))
