"""Three motions under the same commands, in the other simulator and in ours: how far the positions are apart.

The commands are a current without feedback, in whole steps of the drive's command: sines within the rolling zone,
close to break-away, and beyond it.  A loop would hide what a model gets wrong.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.kernels import friction, friction_bristle, stage

Array = NDArray[np.float64]
Simulated = Callable[[Array], Array]  # commands (n,) A, one a control period -> positions (n,) rad | m


# Chosen.
TRIED = 2.0  # Hz, of the commands' sines: slow enough that the friction decides, in the axes that are shipped
MOTION_PERIODS = 3.0  # periods of them; the amplitude rises over the first one
MOTIONS = {"within the rolling zone": 0.3, "close to break-away": 0.9, "sliding": 1.8}  # times what friction holds


class Compared(NamedTuple):
    """One motion, here and there."""

    name: str
    time: Array  # (n,) s
    ours: Array  # (n,) rad | m
    theirs: Array
    frictionless: Array  # ours, without friction

    @property
    def difference(self) -> float:
        """Rms of the difference (rad | m)."""
        return _rms(self.theirs - self.ours)

    @property
    def of_friction(self) -> float:
        """That over what the friction changes of the motion."""
        return self.difference / _rms(self.ours - self.frictionless)

    @property
    def of_motion(self) -> float:
        """That over the motion itself."""
        return self.difference / _rms(self.ours - self.ours[0])


def compared(setup: Setup, there: Simulated) -> list[Compared]:
    """The three motions, simulated `there` and here."""
    each = []
    for name, current in commands(setup).items():
        time = setup.dt * np.arange(len(current), dtype=np.float64)
        free = _without_friction(setup)
        each.append(Compared(name, time, positions(setup, current), there(current), positions(free, current)))
    return each


def commands(setup: Setup) -> dict[str, Array]:
    """Currents (n,) A of the motions, by their name."""
    p = setup.stage
    holds = stage.sliding(p.friction) / p.motor.force_constant
    periods = round(MOTION_PERIODS / TRIED / setup.dt)
    t = setup.dt * np.arange(periods)
    wave = np.sin(2.0 * np.pi * TRIED * t) * np.minimum(t * TRIED, 1.0)
    quantum = p.drive.current_quantum
    currents = {name: share * holds * wave for name, share in MOTIONS.items()}
    return {name: np.floor(x / quantum + 0.5) * quantum if quantum else x for name, x in currents.items()}


def positions(setup: Setup, current: Array) -> Array:
    """Positions (n,) rad | m at the beginnings of the periods, from rest."""
    x, found = stage.at_rest(setup.stage), np.empty(len(current))
    for k, command in enumerate(current.tolist()):
        found[k] = x.position
        x = stage.period(setup.stage, x, command, stage.SILENT, setup.dt, setup.file.simulation.substeps)
    return found


def _without_friction(setup: Setup) -> Setup:
    p = setup.stage.friction
    none = p._replace(operators=friction.bundle([0.0], [1.0]), bristle=friction_bristle.NEUTRAL)
    return setup._replace(stage=setup.stage._replace(friction=none))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))
