"""Captures of a virtual stage: its current commanded, or its position held by a PID while a current is injected.

Law and stage are the project's kernels; the loop around them is written once more here, so that the records that test
an identification do not come through the code that is planned, run and recorded elsewhere.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.identification.capture import Capture
from stagectl.kernels import feedback, stage
from stagectl.kernels.jit import kernel

Array = NDArray[np.float64]
MICRON = 2.0 * np.pi / 12e-3 * 1e-6  # rad of the ball screw's 12 mm lead
STAGE_A = Path(__file__).parents[2] / "config" / "ball-screw.yaml"
SENSOR = 0.045  # A rms, of the paper's drive


class Machine(NamedTuple):
    """A virtual stage, and what is wrong with it."""

    setup: Setup
    acting: float = SENSOR  # A rms, current noise that moves the axis and is not measured
    sensed: float = 0.0  # A rms, noise of the measured current
    ripple: float = 0.0  # N m, amplitude of a torque once per revolution
    bandwidth: float = 40.0  # Hz, of the PID
    seed: int = 1
    substeps: int = 10  # a control period, of the integration


@kernel
def _run(loop: tuple[stage.Stage, feedback.Pid], plant: stage.State, inputs: Any, dt: float, what: Any) -> None:
    """Fill the rows (n, 3) of `inputs` = (asked (n, 2), noise (n,), rows): measured, current, command.

    `what` is (1.0 where the loop is closed, ripple as a current, substeps).
    """
    p, pid = loop
    asked, noises, rows = inputs
    closed, ripple, substeps = what
    x = feedback.AT_REST
    for k in range(len(asked)):
        noise = stage.Noise(noises[k] + ripple * np.sin(plant.position), 0.0, 0.0)
        measured = stage.measured(p.encoder, plant, noise)
        terms, x = feedback.step(pid, x, asked[k, 0] - measured)
        command = closed * (terms.proportional + terms.integral + terms.derivative) + asked[k, 1]
        command = min(max(command, -p.drive.current_limit), p.drive.current_limit)
        rows[k, 0], rows[k, 1], rows[k, 2] = measured, plant.current, command
        plant = stage.period(p, plant, command, noise, dt, substeps)


def opened(machine: Machine, current: Array, column: str = "measured_current", **known: Any) -> Capture:
    """The axis under a commanded `current` (n,) A."""
    asked = np.column_stack([np.zeros(len(current)), current])
    return _captured(machine, asked, 0.0, column, {"excitation": current, **known})


def held(machine: Machine, reference: Array, injected: Array | None = None, **known: Any) -> Capture:
    """The axis on a `reference` (n,) rad in closed loop, with an `injected` (n,) A."""
    extra = np.zeros(len(reference)) if injected is None else injected
    asked = np.column_stack([reference, extra])
    return _captured(machine, asked, 1.0, "measured_current", {"reference": reference, "excitation": injected} | known)


def _captured(machine: Machine, asked: Array, closed: float, column: str, known: dict[str, Any]) -> Capture:
    p, dt = machine.setup.stage, machine.setup.dt
    source = np.random.default_rng(machine.seed)
    rows = np.zeros((len(asked), 3))
    pid = feedback.discretised(feedback.place_poles(p.mechanics, p.motor.force_constant, machine.bandwidth), dt)
    noise = source.normal(0.0, machine.acting, len(asked))
    what = (closed, machine.ripple / p.motor.force_constant, machine.substeps)
    _run((p, pid), stage.at_rest(p), (asked, noise, rows), dt, what)
    current = rows[:, 1] + source.normal(0.0, machine.sensed, len(asked)) if column != "command" else rows[:, 2]
    late = p.encoder.delay_samples  # captures have their positions at the instants they were latched at
    position = np.append(rows[late:, 0], np.full(late, rows[-1, 0]))
    time = dt * np.arange(len(asked), dtype=np.float64)
    return Capture("virtual", time, position, current, dt, column, encoder_step=p.encoder.step, **known)
