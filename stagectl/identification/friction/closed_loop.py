"""A record's reference simulated through the controller it was recorded with, on a stage model: the four errors.

The servo of the EMPS benchmark, a position gain around a velocity gain, with the mean of two positions differentiated::

    i[k] = kv (kp (r[k] - q[k]) - (f[k] - f[k-1])/Ts)        f[k] = (q[k] + q[k-1])/2        limited

Each error is the norm of the difference over the norm of the record, in percent; velocity and acceleration of both
sides by the same filter, a zero-phase Butterworth low-pass of fourth order at 100 Hz and central differences.

Source: A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, Workshop on Nonlinear System
Identification Benchmarks, 2019.
"""

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal
from stagectl.identification.filtering import FilterDesign, FilteredMotion, filtered_motion
from stagectl.kernels import stage
from stagectl.kernels.jit import kernel
from stagectl.units import Quantity


class Servo(NamedTuple):
    """The controller of the record."""

    position_gain: Annotated[float, Quantity("1/s", "(0, 1e6]", "kp")]
    velocity_gain: Annotated[float, Quantity("A s/rad | A s/m", "(0, 1e9]", "kv")]
    current_limit: Annotated[float, Quantity("A", "(0, inf]", "the command saturates here")] = math.inf


class SimulationErrors(NamedTuple):
    """Norm of the difference over norm of the record, in percent."""

    position: float
    velocity: float
    acceleration: float
    force: float


PUBLISHED = SimulationErrors(0.013752, 0.22911, 8.6036, 5.848)  # EMPS, symmetric model, unit delay in its simulation


class Simulated(NamedTuple):
    """Columns (n,) of the run."""

    position: Array  # rad | m, as the encoder reports it
    current: Array  # A


def simulated(p: stage.Stage, servo: Servo, capture: Capture, substeps: int = thresholds.SERVO_SUBSTEPS) -> Simulated:
    """The reference of `capture` on the stage `p`, which begins as the record does: in motion, its friction slipping.

    Raises IdentificationError where the capture has no reference, or the run is unstable.
    """
    if capture.reference is None:
        text = (
            f"{capture.name} has no reference, so it cannot be simulated in closed loop; record the reference with it"
        )
        raise IdentificationError(text, Refusal.MISSING_COLUMN, capture=capture.name, value="reference")
    begin = float(motion(capture.position, capture).velocity[0])
    rows = np.empty((len(capture.reference), 2))
    before = float(capture.position[0]) - begin * capture.dt
    memory = (before, before - 0.5 * begin * capture.dt)
    x = stage.as_read(p, float(capture.position[0]), 0.0, (begin, float(capture.current[0])), capture.dt)
    _run(p, servo, (x, *memory), capture.reference, rows, (capture.dt, substeps))
    limit = thresholds.UNSTABLE_STROKES * float(np.ptp(capture.position))
    if not float(np.ptp(rows[:, 0])) < limit:
        raise IdentificationError(
            f"{capture.name}: the closed loop on this model is unstable, so its parameters cannot be right",
            Refusal.UNSTABLE,
            capture=capture.name,
            value=float(np.ptp(rows[:, 0])),
            unit="rad | m",
            admissible=f"[0, {limit:g})",
        )
    return Simulated(rows[:, 0], rows[:, 1])


def errors(run: Simulated, capture: Capture) -> SimulationErrors:
    """The four errors of a run against its record."""
    simulated, recorded = motion(run.position, capture), motion(capture.position, capture)
    return SimulationErrors(
        _percent(run.position, capture.position),
        _percent(simulated.velocity, recorded.velocity),
        _percent(simulated.acceleration, recorded.acceleration),
        _percent(run.current, capture.current),
    )


def motion(position: Array, capture: Capture) -> FilteredMotion:
    """Position (n,), velocity and acceleration by the errors' own filter."""
    cutoff = min(thresholds.ERROR_CUTOFF, 0.4 / capture.dt)
    smooth = filtered_motion(position, FilterDesign(cutoff, 1, capture.dt)).position
    velocity = np.gradient(smooth, capture.dt)
    return FilteredMotion(smooth, velocity, np.gradient(velocity, capture.dt))


def _percent(simulated: Array, recorded: Array) -> float:
    return 100.0 * float(np.linalg.norm(simulated - recorded) / np.linalg.norm(recorded))


@kernel
def _run(p: stage.Stage, servo: Servo, start: Any, reference: Any, rows: Any, steps: tuple[float, int]) -> None:
    """Fill `rows` (n, 2): measured position and current; `start` is the plant and the servo's two memories."""
    x, last, mean = start
    dt, substeps = steps
    silent, held = stage.Noise(0.0, 0.0, 0.0), stage.steps(p, dt, substeps)
    for k in range(len(reference)):
        measured = stage.measured(p.encoder, x, silent)
        now = 0.5 * (measured + last)
        current = servo.velocity_gain * (servo.position_gain * (reference[k] - measured) - (now - mean) / dt)
        current = min(max(current, -servo.current_limit), servo.current_limit)
        last, mean = measured, now
        rows[k, 0], rows[k, 1] = measured, current
        x = stage.period_of(p, x, current, silent, held)
