"""What the twin's tests share: a simulated run's rows, and the twin over them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl import design
from stagectl.config.stage_file import Setup
from stagectl.kernels import friction, stage
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.trajectories import Sine
from stagectl.twin import estimate, live_model
from stagectl.twin.thresholds import BLOCK

Array = NDArray[np.float64]
SINE = Sine(0.005, 1.6, 5.0, 1.0)


def machine(setup: Setup, noise: float = 0.045, seed: int = 3, **changes: Any) -> Setup:
    """The machine behind the drive: `setup` with other mechanics, force constant, friction or lag, and noise (A)."""
    p = setup.stage
    body = {name: value for name, value in changes.items() if name in p.mechanics._fields}
    p = p._replace(mechanics=p.mechanics._replace(**body))
    p = p._replace(motor=p.motor._replace(force_constant=changes.get("force_constant", p.motor.force_constant)))
    p = p._replace(drive=p.drive._replace(current_lag=changes.get("current_lag", p.drive.current_lag)))
    rolling = p.friction.operators
    scaled = friction.bundle(rolling.weight * changes.get("coulomb", 1.0), rolling.slip)
    p = p._replace(friction=changes.get("friction", p.friction._replace(operators=scaled)))
    simulation = setup.file.simulation._replace(current_noise=noise, seed=seed)
    return setup._replace(stage=p, file=setup.file._replace(simulation=simulation))


def rows_of(setup: Setup, plant: Setup | None = None, motion: Sine = SINE) -> Array:
    """(n, WIDTH) of a simulated run."""
    controller = design.design(setup.stage, setup.file.control)
    samples = simulate(setup, plan(setup, motion, controller.feedforward), controller.law, plant)
    return samples.view(np.float64).reshape(len(samples), -1)


def beside(setup: Setup) -> live_model.Twin:
    """The twin of the stage as its file has it."""
    return live_model.twin_of(design.design(setup.stage, setup.file.control).law, setup.stage, setup.dt)


def followed(p: live_model.Twin, rows: Array, size: int | None = None) -> list[live_model.TwinBlock]:
    """All blocks of `rows`, as large as live ones unless a `size` is given."""
    x, blocks = None, []
    size = size or round(BLOCK / p.dt)
    for start in range(0, len(rows), size):
        for piece in live_model.pieces(rows[start : start + size], p.dt):
            block, x = live_model.step(p, x, piece)
            blocks.append(block)
    return blocks


def seen(setup: Setup, plant: Setup) -> estimate.TwinStatus:
    """What the twin says at the end of a run on `plant`."""
    p = beside(setup)
    return estimate.status_of(p, followed(p, rows_of(setup, plant)))


def names(status: estimate.TwinStatus) -> list[str]:
    """The effects that are named."""
    return [named.drift.candidate.name for named in status.named]


def dahl(length: float) -> stage.Friction:
    """1 N m of Dahl's friction with this displacement (rad) of its bristle."""
    from stagectl.kernels.friction_bristle import Bristle

    none = friction.bundle([0.0], [1.0])
    return stage.Friction(none, friction.Stribeck(), Bristle(1.0, 1.0 / length))
