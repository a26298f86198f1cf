"""An axis in open loop whose motor is disturbed: Dahl friction, Heun's steps, no code of stagectl's simulator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.config.stage_file import load_stage
from stagectl.identification.capture import Capture
from stagectl.identification.simultaneous.method import identify
from tests.foreign_plants.compiled import compiled
from tests.foreign_plants.nominal import STAGE_FILE, nominal

Array = NDArray[np.float64]
STEP, ROW, SECONDS = 20e-6, 0.5e-3, 6.0  # s
LAG, ZONE = 0.1e-3, 3e-3  # s of the current loop, rad of the friction
COUNTS = 2**20


@compiled
def moved(current: Array, plant: tuple[float, ...], position: Array) -> None:
    """Fill `position` (n,) rad while `current` (n,) A acts from rest; `plant` is J, D, Tc and Kt, SI."""
    inertia, viscous, coulomb, gain = plant
    x = v = bent = lagged = 0.0
    for k in range(len(current)):
        position[k] = x
        lagged += STEP / LAG * (current[k] - lagged)
        middle = v + 0.5 * STEP * (gain * lagged - viscous * v - coulomb * bent) / inertia
        end = math.copysign(1.0, middle)
        bent = end + (bent - end) * math.exp(-abs(STEP * middle) / ZONE)
        v += STEP * (gain * lagged - viscous * middle - coulomb * bent) / inertia
        x += STEP * middle


def record(inertia: float, noise: float, rows: int) -> Capture:
    """A current sine of 5 A and 1.6 Hz; `noise` (A rms, held for `rows`) acts on the motor and is not recorded."""
    axis, time = nominal(), np.arange(round(SECONDS / STEP), dtype=np.float64)
    time *= STEP
    injected, position, per_row = 5.0 * np.sin(3.2 * math.pi * time), np.zeros(len(time)), round(ROW / STEP)
    held = rows * per_row
    acting = injected + np.repeat(np.random.default_rng(1).normal(0.0, noise, len(time) // held), held)
    moved(acting, (inertia, axis.viscous, axis.coulomb, axis.force_constant), position)
    step, sine = 2.0 * math.pi / COUNTS, injected[::per_row].copy()
    seen = step * np.round(position[::per_row] / step)
    return Capture("disturbed", time[::per_row], seen, sine, ROW, "command", excitation=sine, encoder_step=step)


@pytest.mark.parametrize(
    ("share", "noise", "rows"),
    [
        (1.07, 0.0, 1),
        (1.07, 0.045, 1),
        (0.8, 0.045, 1),
        (1.07, 0.2, 1),
        (0.8, 0.2, 1),
        (1.07, 0.045, 4),
        (1.07, 0.045, 20),
    ],
)
def test_an_interval_holds_the_inertia_whatever_disturbs_the_motor(share: float, noise: float, rows: int) -> None:
    inertia = share * nominal().inertia
    found = identify([record(inertia, noise, rows)], load_stage(STAGE_FILE).file).parameters["inertia"]
    assert abs(found.value - inertia) <= found.half <= 0.2 * inertia
