"""What sampling does to a response from recorded current to recorded position, and its correction.

All of it is known, and taken out exactly, line by line (x = 2 pi f Ts, a = exp(-Ts/tau)):

* the current is a staircase behind a current loop of first order, tau; measured at the end of each step it is
  ``(1 - a)/(exp(jx) - a)`` of the command that acts, and the wave in it ``(1 - exp(-jx))/(jx (1 + jx tau/Ts))``;
* central differences have the gain ``sin(x)/x``;
* the images of the staircase fold back into the sampled position, on an inertia by the share
  ``sum_n (x/x_n)^3 (1 + jx tau/Ts)/(1 + jx_n tau/Ts)``, ``x_n = x + 2 pi n``;
* a command acts nd periods late; captures have their positions at the instants they were latched at.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.units import LINEAR, ROTARY

Complex = NDArray[np.complex128]

IMAGES = 200  # of the staircase, either way
LEAST_CURRENT = 1e-6  # A, of an excitation


def check(capture: Capture) -> None:
    """Raise IdentificationError where the columns hold no response at all."""
    length = {ROTARY: "rad", LINEAR: "m"}.get(capture.meta.get("axis", {}).get("kind"), "rad | m")
    for name, column, unit in (("position", capture.position, length), ("current", capture.current, "A")):
        if column.shape != capture.time.shape or not np.all(np.isfinite(column)):
            row = int(np.argmin(np.isfinite(column)))
            raise IdentificationError(
                f"{capture.name}: {name}[{row}] = {column[row] if len(column) else math.nan:g} {unit}; {name} must be "
                f"finite in all {len(capture.time)} rows: cut the record to a part without gaps"
            )
    if len(capture.time) < 100:
        raise IdentificationError(f"{capture.name}: {len(capture.time)} rows; must have at least 100: record longer")
    if not np.ptp(capture.current) > LEAST_CURRENT:
        raise IdentificationError(
            f"{capture.name}: the {capture.current_column} never changes, {capture.current[0]:g} A throughout; without "
            "excitation there is no response: command a current_sine or current_multisine, or inject one"
        )
    if not np.ptp(capture.position) > 10.0 * capture.encoder_step:
        raise IdentificationError(
            f"{capture.name}: the position moves by {np.ptp(capture.position):g} {length} in all; must be more than "
            f"ten encoder steps of {capture.encoder_step:g}: raise the amplitude, or check that the drive was enabled"
        )


def sampled(frequency: Array, capture: Capture, file: StageFile) -> Complex:
    """Factor (m,) on W/I of central differences and recorded current: the corrections of this module's head."""
    x = 2.0 * np.pi * frequency * capture.dt
    lag = file.drive.current_lag / capture.dt
    wave = -np.expm1(-1j * x) / (1j * x * (1.0 + 1j * x * lag))
    if capture.current_column == "measured_current":
        kept = math.exp(-1.0 / lag) if lag > 0.0 else 0.0
        wave *= (np.exp(1j * x) - kept) / (1.0 - kept)
    else:
        told = capture.meta.get("nd")  # a record that is not ours does not say
        wave *= np.exp(-1j * x * (file.drive.delay_samples if told is None else told))
    all_x = x[:, None] + 2.0 * np.pi * np.arange(-IMAGES, IMAGES + 1)
    folded = np.sum((x[:, None] / all_x) ** 3 * (1.0 + 1j * lag * x[:, None]) / (1.0 + 1j * lag * all_x), axis=1)
    return np.asarray(x / np.sin(x) / (wave * folded), dtype=np.complex128)


def known_delay(capture: Capture, file: StageFile) -> float:
    """What `sampled` takes out, as a delay (s) from the recorded current to the recorded position."""
    low = np.array([1e-3 / capture.dt])
    return float(np.angle(sampled(low, capture, file))[0] / (2.0 * np.pi * low[0]))


def velocity(capture: Capture) -> Array:
    """Central differences of the position, (n,) rad/s | m/s."""
    return np.asarray(np.gradient(capture.position, capture.dt), dtype=np.float64)
