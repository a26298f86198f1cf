"""The scales of one machine and its session, from which the library's typical values and grids follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from stagectl.gap.effects.effect import Scales
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.selection.thresholds import LARGEST_SPEED, NATURAL_DAMPING


def scales(session: Session, runs: Sequence[Run], orders: Mapping[str, tuple[float, ...]]) -> Scales:
    """The machine's scales, from the nominal model and the logs; `orders` of the pitch are by effect."""
    p = session.stage
    position = np.concatenate([run.mean.rows[:, 1] for run in runs])
    current = np.concatenate([_delivered_current(run) for run in runs])
    velocity = np.concatenate([np.gradient(run.mean.rows[:, 1], session.dt) for run in runs])
    low, high = float(position.min()), float(position.max())
    drive = p.drive
    voltage = np.abs(drive.resistance * current + drive.back_emf * velocity)
    return Scales(
        coulomb=friction_family.size(p),
        viscous=p.mechanics.viscous or NATURAL_DAMPING * p.mechanics.inertia / session.dt,
        inertia=p.mechanics.inertia,
        force_constant=p.motor.force_constant,
        length=friction_family.length(p.friction),
        speed=float(np.percentile(np.abs(velocity), LARGEST_SPEED)),
        centre=0.5 * (low + high),
        stroke=0.5 * (high - low),
        current=float(np.abs(current).max()),
        pitch=p.mechanics.pitch,
        dt=session.dt,
        session=tuple(sorted({log.start for run in runs for log in run.logs})),
        orders=orders,
        periods=p.encoder.interpolation.order if p.encoder.interpolation.order > 1.0 else 0.0,
        voltage=float(voltage.max()) if drive.back_emf > 0.0 else 0.0,
    )


def _delivered_current(run: Run) -> Array:
    """The current (n,) A of the drive where it is measured, else the command: a command beyond a limit is no scale."""
    command, measured = run.mean.rows[:, 0], run.mean.rows[:, 2]
    return np.where(np.isnan(measured), command, measured)
