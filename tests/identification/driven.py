"""The stage model driven by a current in open loop, with a torque ripple: records for the identification's tests."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.identification.capture import Capture
from stagectl.kernels import stage
from stagectl.kernels.jit import kernel


class Sensor(NamedTuple):
    """What makes a record differ from what happened."""

    process: float = 0.0  # A rms, acts on the motor
    sensor: float = 0.0  # A rms, added to the current's column alone
    column: str = "measured_current"  # or command
    ripple: float = 0.0  # N m | N, once per 2 pi of the position
    seed: int = 1


@kernel
def driven(p: stage.Stage, x: stage.State, inputs: Any, dt: float, substeps: int) -> stage.State:
    """Fill rows (n, 2) of measured position and current from inputs = (command (n,), noise (n, 2), ripple, rows)."""
    command, noises, ripple, rows = inputs
    for k in range(len(command)):
        noise = stage.Noise(noises[k] - ripple * math.sin(x.position) / p.motor.force_constant, 0.0, 0.0)
        rows[k, 0] = stage.measured(p.encoder, x, noise)
        rows[k, 1] = x.current
        x = stage.period(p, x, command[k], noise, dt, substeps)
    return x


def capture(p: stage.Stage, command: NDArray[np.float64], dt: float, how: Sensor) -> Capture:
    """What is recorded while `command` (n,) A drives `p` from rest."""
    source = np.random.default_rng(how.seed)
    noises = how.process * source.standard_normal(len(command))
    rows = np.zeros((len(command), 2))
    driven(p, stage.at_rest(p), (command, noises, how.ripple, rows), dt, max(round(dt / 5e-5), 5))
    current = rows[:, 1] if how.column == "measured_current" else command
    current = current + how.sensor * source.standard_normal(len(command))
    time = np.arange(len(command), dtype=np.float64) * dt
    return Capture(
        "driven", time, rows[:, 0].copy(), current, dt, how.column, excitation=command, encoder_step=p.encoder.step
    )


def sine(amplitude: float, frequency: float, duration: float, dt: float, phase: float = 0.0) -> NDArray[np.float64]:
    """Current (n,) A of a sine that starts at once, as in the paper's Fig. 8."""
    time = np.arange(round(duration / dt)) * dt
    return np.asarray(amplitude * np.sin(2.0 * math.pi * frequency * time + phase), dtype=np.float64)
