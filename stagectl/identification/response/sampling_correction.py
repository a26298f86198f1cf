"""What sampling does to a response from recorded current to recorded position, and its correction.

All of it is known, and is removed exactly, line by line (x = 2 pi f Ts, a = exp(-Ts/tau)):

* the current is a staircase behind a current loop of first order, tau; measured at the end of each step it is
  ``(1 - a)/(exp(jx) - a)`` of the command that acts, and the wave in it ``(1 - exp(-jx))/(jx (1 + jx tau/Ts))``;
* central differences have the gain ``sin(x)/x``;
* the images of the staircase fold back into the sampled position, on an inertia by the share
  ``sum_n (x/x_n)^3 (1 + jx tau/Ts)/(1 + jx_n tau/Ts)``, ``x_n = x + 2 pi n``;
* a command acts nd periods late; captures have their positions at the instants they were latched at.
"""

import math

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture

Complex = NDArray[np.complex128]


def sampling_correction(frequency: Array, capture: Capture, file: StageFile) -> Complex:
    """Factor (m,) on W/I of central differences and recorded current: see this module's docstring."""
    x = 2.0 * np.pi * frequency * capture.dt
    lag = file.drive.current_lag / capture.dt
    wave = -np.expm1(-1j * x) / (1j * x * (1.0 + 1j * x * lag))
    if capture.current_column == "measured_current":
        kept = math.exp(-1.0 / lag) if lag > 0.0 else 0.0
        wave *= (np.exp(1j * x) - kept) / (1.0 - kept)
    else:
        recorded_delay = capture.meta.get("nd")  # an imported log does not have it
        wave *= np.exp(-1j * x * (file.drive.delay_samples if recorded_delay is None else recorded_delay))
    all_x = x[:, None] + 2.0 * np.pi * np.arange(-thresholds.IMAGES, thresholds.IMAGES + 1)
    folded = np.sum((x[:, None] / all_x) ** 3 * (1.0 + 1j * lag * x[:, None]) / (1.0 + 1j * lag * all_x), axis=1)
    return np.asarray(x / np.sin(x) / (wave * folded), dtype=np.complex128)


def known_delay(capture: Capture, file: StageFile) -> float:
    """What `sampling_correction` takes out, as a delay (s) from the recorded current to the recorded position."""
    low = np.array([1e-3 / capture.dt])
    return float(np.angle(sampling_correction(low, capture, file))[0] / (2.0 * np.pi * low[0]))


def velocity(capture: Capture) -> Array:
    """Central differences of the position, (n,) rad/s | m/s."""
    return np.asarray(np.gradient(capture.position, capture.dt), dtype=np.float64)
