"""What the tracker answers to an effort, by frequency, and the way back from its answer to the effort.

The correction that holds a model on the measured path is the missing effort, filtered by the tracking loop
``T = C P / (1 + C P)`` of the tracker C and a free mass P with its damping.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.model_tracking import ticks
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.residuals.thresholds import LEAST_TRACKED
from stagectl.kernels.plant import Mechanics

Response = NDArray[np.complex128]


def tracking(p: TrackedModel, lines: Array, dt: float) -> Response:
    """Response (f,) of the tracking loop of `p` at the frequencies `lines` (f,) Hz; `dt` is the period (s)."""
    count = ticks(dt)
    tick = dt / count
    z = np.exp(2j * np.pi * tick * lines)
    z = np.where(z == 1.0, 1.0 + 1e-9, z)  # the integrators are infinite at rest
    c = p.tracker
    controller = c.proportional + c.integral * (z + 1.0) / (z - 1.0) + c.derivative * (z - 1.0) / (z - c.decay)
    late = p.stage.encoder.delay_samples if count == 1 else 0  # ticks know where the machine is
    loop = controller * p.stage.motor.force_constant * _mass(p.stage.mechanics, z, tick) * z ** -float(late)
    mean = np.polyval(np.ones(count), z) / count  # over the ticks of a period
    return np.asarray(loop / (1.0 + loop) * mean, dtype=np.complex128)


def _mass(m: Mechanics, z: Response, dt: float) -> Response:
    """Position per held effort: velocity decays by ``a = exp(-D dt / J)``."""
    if m.viscous <= 0.0:
        return dt * dt / (2.0 * m.inertia) * (z + 1.0) / (z - 1.0) ** 2
    rate = m.viscous / m.inertia
    a, gain = np.exp(-rate * dt), 1.0 / m.viscous
    velocity = (1.0 - a) / (z - a)  # times gain
    position: Response = (dt - (1.0 - a) / rate + (1.0 - a) / rate * velocity) / (z - 1.0)
    return gain * position


def lines_of(count: int, dt: float) -> Array:
    """Frequencies (f,) Hz of signals of `count` rows at `dt` (s), mirrored and padded as in `filtered`."""
    return np.asarray(fft.rfftfreq(2 * fft.next_fast_len(count, real=True), dt), dtype=np.float64)


def filtered(signals: Array, response: Array | Response) -> Array:
    """`signals` (..., n) through a filter with the response (f,) at `lines_of`, mirrored so that no end rings."""
    count, rows = signals.shape[-1], 2 * (len(response) - 1)
    padding = np.repeat(signals[..., :1], rows - 2 * count, axis=-1)
    mirrored = np.concatenate([signals, signals[..., ::-1], padding], axis=-1)
    return fft.irfft(fft.rfft(mirrored) * response, rows)[..., :count]


def untracked(effort: Array, p: TrackedModel, dt: float) -> Array:
    """The effort (n,) that acted, from the tracker's answer `effort` (n,) to it (N m | N).

    The tracking loop is divided out where it follows at all: by ``conj(T) / (|T|^2 + e^2)``.
    """
    response = tracking(p, lines_of(len(effort), dt), dt)
    inverse = (np.conj(response) / (np.abs(response) ** 2 + LEAST_TRACKED**2)).astype(np.complex128)
    return filtered(effort, inverse) * (1.0 + LEAST_TRACKED**2)


def in_time(effort: Array, p: TrackedModel, dt: float, every: int) -> Array:
    """The tracker's answer `effort` (n,), one of `every` samples of it, without its delay at any frequency."""
    response = tracking(p, lines_of(len(effort), dt * every), dt)
    return filtered(effort, np.conj(response) / np.maximum(np.abs(response), np.finfo(np.float64).tiny))
