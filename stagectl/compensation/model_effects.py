"""Current against all that the stage model holds beyond inertia, viscous and rolling friction.

The whole model and the plain one are both inverted along the same reference (`kernels.inverse`); the difference is what
the further effects demand::

    reference --+--> inverse of the whole model --(+)--> mean of each period --> current
                +--> inverse of the plain one ----(-)

What the encoder's grating adds to the position is no force: it goes into the target, which is compared with it.

Perfect tracking and the friction compensation answer the plain model, to the last bit as before; where a model has no
further effect the difference is zero.  What is demanded at rest, before the motion, is left to the
feedback, which holds it already.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.compensation.constants import EFFECTS_SHARE, INVERSE_STEPS
from stagectl.kernels import effects, equilibrium, friction, inverse, plant_with_effects, stage, transmission
from stagectl.kernels.fields import get, put
from stagectl.kernels.law import SETPOINT_COLUMNS

Array = NDArray[np.float64]


class Memory(NamedTuple):
    """Both models as an earlier motion left them; their friction states change in place."""

    whole: stage.State
    plain: stage.State
    at_rest: float  # A, what was demanded before the first motion

    def copy(self) -> Memory:
        """One of its own to move on."""
        whole, plain = (x._replace(stops=x.stops.copy()) for x in (self.whole, self.plain))
        return Memory(whole, plain, self.at_rest)


class Answer(NamedTuple):
    """What the current against the effects of a motion came to."""

    memory: Memory | None = None  # at the motion's end; None where the model has no effects
    limited: int = 0  # periods in which it reached its share of the limit
    largest: tuple[str, float] = ("", 0.0)  # place of the effect that demands the most and its current (A), if known


def present(p: stage.Stage) -> bool:
    """Whether the model holds anything beyond tracking and rolling friction that is answered."""
    known = plain(p)
    body = (p.motor, p.mechanics, p.drive.offset) != (known.motor, known.mechanics, 0.0)
    rubbing = p.friction[1:] != known.friction[1:]
    return body or rubbing or p.residual.coordinate != effects.NONE or mapped(p)


def mapped(p: stage.Stage) -> bool:
    """Whether the encoder's readings have errors that depend on the position."""
    return p.encoder[2:] != plain(p).encoder[2:]


def put_into(rows: Array, p: stage.Stage, current: Array, place: float) -> int:
    """Add `current` (n,) A within its share of the limit, and the encoder's map, to setpoints `rows` (n, 8).

    The axis begins where its encoder reads `place` (rad | m).  Returns in how many periods the current was limited.
    """
    most = EFFECTS_SHARE * p.drive.current_limit
    rows[:, SETPOINT_COLUMNS["friction"]] += np.clip(current, -most, most)
    if mapped(p):
        target = SETPOINT_COLUMNS["target"]
        rows[:, target] += read_beside(p, place, rows[:, target])
    return int(np.sum(np.abs(current) > most))


def largest(p: stage.Stage, motion: Array, dt: float) -> tuple[str, float]:
    """Dotted place of the effect that demands the largest current along `motion` on its own, and that current (A).

    `motion` and `dt` as in `along`; the axis begins at rest.
    """
    known, each, demanded = plain(p), steps(p, dt), dict[str, float]()
    groups = (("drive", p.drive), ("motor", p.motor), ("mechanics", p.mechanics), ("friction", p.friction))
    for place in ("residual", *(f"{name}.{field}" for name, group in groups for field in group._fields)):
        if (value := get(p, place)) != get(known, place):
            alone = put(known, place, value)
            memory = begun(alone, float(motion[0, 0]))
            further, _ = _further((alone, known), memory, motion, (dt / each, each))
            demanded[place] = float(np.abs(further - memory.at_rest).max())
    return max(demanded.items(), key=lambda item: item[1])


def read_beside(p: stage.Stage, place: float, way: Array) -> Array:
    """What the encoder adds to each of `way` (n,) rad | m, counted from where it reads `place`."""
    origin = equilibrium.read(p, place)
    seen = (plant_with_effects.seen(p.encoder, p.mechanics.pitch, origin + x) for x in way.tolist())
    return np.fromiter(seen, np.float64, len(way)) - place - way


def plain(p: stage.Stage) -> stage.Stage:
    """What tracking and rolling friction know of the model."""
    drive, motor = stage.Drive(*p.drive[:4]), type(p.motor)(p.motor.force_constant)
    mechanics = stage.Mechanics(p.mechanics.inertia, p.mechanics.viscous, pitch=p.mechanics.pitch)
    rolling = stage.Friction(p.friction.operators, friction.Stribeck(), p.friction.bristle)
    return stage.Stage(drive, motor, mechanics, rolling, stage.Encoder(*p.encoder[:2]))


def rubbing_answered(p: stage.Stage) -> stage.Stage:
    """The model where a compensator of its own answers all that rubs: no effect of the friction is left."""
    return p._replace(friction=plain(p).friction)


def without(p: stage.Stage, places: Iterable[str]) -> stage.Stage:
    """The model with the fields at these dotted `places` neutral."""
    known = plain(p)
    for place in places:
        p = put(p, place, get(known, place))
    return p


def steps(p: stage.Stage, dt: float) -> int:
    """Into how many steps a control period `dt` (s) is divided for the inverse."""
    return INVERSE_STEPS * int(transmission.finer(p.mechanics, dt / INVERSE_STEPS))


def begun(p: stage.Stage, position: float) -> Memory:
    """The memory of an axis that stands at `position` (rad | m) and has not moved yet."""
    known = plain(p)
    memory = Memory(stage.at_rest(p, position), stage.at_rest(known, position), 0.0)
    further, _ = _further((p, known), memory.copy(), np.array([[position, 0.0, 0.0]]), (1.0, 1))
    return memory._replace(at_rest=float(further[0]))


def along(p: stage.Stage, memory: Memory, motion: Array, dt: float) -> tuple[Array, Memory]:
    """Current (n,) A of each control period `dt` (s), and the memory at the motion's end.

    `motion` (n `steps` + 1, 3) is position, velocity and acceleration (axis units) at the times in which the current
    acts, from the beginning of the first period to the end of the last.
    """
    each = steps(p, dt)
    further, at_end = _further((p, plain(p)), memory, motion, (dt / each, each))
    further -= memory.at_rest
    return (0.5 * (further[1:] + further[:-1])).reshape(-1, each).mean(axis=1), at_end


def _further(
    models: tuple[stage.Stage, stage.Stage], memory: Memory, motion: Array, steps: tuple[float, int]
) -> tuple[Array, Memory]:
    """Current (n,) A that the whole of the `models` demands beyond the plain one; the memory at the motion's end."""
    motion = np.ascontiguousarray(motion)
    whole, known = np.empty((2, len(motion)))
    whole_end, known_end = (
        inverse.along(p, x, motion, steps, out) for p, x, out in zip(models, memory[:2], (whole, known), strict=True)
    )
    return whole - known, Memory(whole_end, known_end, memory.at_rest)
