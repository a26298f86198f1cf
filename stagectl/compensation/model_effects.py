"""Current against all that the stage model holds beyond inertia, viscous and rolling friction.

The whole model and the plain one are both inverted along the same reference (`kernels.inverse`); the difference is what
the further effects demand::

    reference --+--> inverse of the whole model --(+)--> mean of each period --> current
                +--> inverse of the plain one ----(-)

Perfect tracking and the friction compensation answer the plain model, to the last bit as before; where a model has no
further effect the difference is zero.  What is demanded at rest, before the first motion, is left to the
feedback, which holds it already.

A wrong value must not do harm.  Each effect has its share of the current limit, all together have another.  A motion
begins with the current that holds since the last one; where the model has changed in between, the difference fades.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.compensation import encoder_map, period_currents
from stagectl.compensation.constants import EFFECT_SHARE, EFFECTS_SHARE, INVERSE_STEPS, ROUNDING
from stagectl.kernels import drive_effects, effects, friction, inverse, stage, transmission
from stagectl.kernels.fields import get, put
from stagectl.kernels.law import SETPOINT_COLUMNS

Array = NDArray[np.float64]


class Memory(NamedTuple):
    """Both models as an earlier motion left them; their friction states change in place."""

    whole: stage.State
    plain: stage.State
    origin: float  # rad | m, where the axis stood before the first motion
    held: float = 0.0  # A, the current at the end of the last motion, which holds since
    released: float | None = None  # A, beyond its whole load, with which a brake released it there; None: no brake did

    def copy(self) -> Memory:
        """One of its own to move on, for the kernels of this process: another may have interpreted its own."""
        return self._replace(whole=stage.copied(self.whole), plain=stage.copied(self.plain))

    def at(self, clock: float) -> Memory:
        """The same at another time (s) of the session's clock: an axis that stands changes its temperature, too."""
        return self._replace(whole=_at(self.whole, clock), plain=_at(self.plain, clock))


def _at(x: stage.State, clock: float) -> stage.State:
    return x._replace(memory=x.memory._replace(time=clock))


class Limited(NamedTuple):
    """An effect that demands more than its share of the current limit."""

    place: str  # dotted; empty: all effects together
    demanded: float  # A, its largest current
    most: float  # A, what it may take
    periods: int  # in which it is limited


class Answer(NamedTuple):
    """What the current against the effects of a motion came to."""

    memory: Memory | None = None  # at the motion's end; None where the model has no effects
    limited: tuple[Limited, ...] = ()
    mapped: bool = False  # whether the encoder's map is in the target


def present(p: stage.Stage) -> bool:
    """Whether the model holds anything beyond tracking and rolling friction that is answered."""
    known = plain(p)
    path = (p.drive.offset, p.drive.gain, p.drive.gain_asymmetry, p.drive.directed_offset)
    body = (p.motor, p.mechanics, path) != (known.motor, known.mechanics, (0.0, 0.0, 0.0, 0.0))
    rubbing = p.friction[1:] != known.friction[1:]
    return body or rubbing or p.residual.coordinate != effects.NONE or encoder_map.mapped(p)


def put_into(rows: Array, p: stage.Stage, current: Array, held: float) -> None:
    """Add `current` (n,) A to setpoints `rows` (n, 8), and make commands of currents; the feedback holds `held` (A)."""
    rows[:, SETPOINT_COLUMNS["friction"]] += current
    if p.drive != plain(p).drive:
        known = rows[:, SETPOINT_COLUMNS["feedforward"]] + rows[:, SETPOINT_COLUMNS["friction"]]
        rows[:, SETPOINT_COLUMNS["friction"]] += _called_for(p.drive, known, held) - known


def _called_for(p: stage.Drive, current: Array, held: float) -> Array:
    """What commands (n,) A beside `held` (A) give these currents (n,) A beside its own: `drive_effects.called_for`."""
    wanted = current + drive_effects.amplified(p, held)
    side = np.sign(wanted)
    left = np.maximum(np.abs(wanted) - p.directed_offset, 0.0)
    commands: Array = side * left / (1.0 + p.gain + side * p.gain_asymmetry) - held
    return commands


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
    least = INVERSE_STEPS * (2 if _sudden(p, dt) else 1)
    return least * int(transmission.finer(p.mechanics, dt / least))


def _sudden(p: stage.Stage, dt: float) -> bool:
    """Whether the effort changes within a step, and what a period then gives early or late is to be right."""
    gap = p.mechanics.transmission.backlash > 0.0 and period_currents.resolved(p, dt)
    return gap or p.friction.step.share != 0.0 or p.mechanics.viscous_step.share != 0.0


def begun(p: stage.Stage, position: float, clock: float = 0.0, released: float | None = None) -> Memory:
    """The memory of an axis that stands at `position` (rad | m) at the session `clock` (s), and has not moved yet."""
    known = stage.at_rest(plain(p), position, clock)  # without a load, its friction has nothing to carry
    return Memory(_at_rest(p, position, clock, released), known, position, released=released)


def _at_rest(p: stage.Stage, position: float, clock: float, released: float | None) -> stage.State:
    """The model before its first motion: its friction carries what the brake's release left to it, without one all."""
    held = 0.0 if released is None else stage.released(p, position) + released
    return stage.at_rest(p, position, clock, held)


def going_on(p: stage.Stage, position: float, left: Memory | None, clock: float, released: float | None) -> Memory:
    """The memory of an axis that stands at `position` (rad | m) at the session `clock` (s).

    It is what the last motion `left`, if that ended there; else that of an axis which a brake `released`, or none.
    """
    if left is None or abs(left.whole.position - position) > p.encoder.step + ROUNDING * (1.0 + abs(position)):
        return begun(p, position, clock, released)
    return left.at(clock)


def along(p: stage.Stage, memory: Memory, motion: Array, dt: float) -> tuple[Array, Answer]:
    """Current (n,) A of each control period `dt` (s), within the limits, and what it came to.

    `motion` (n `steps` + 1, 3) is position, velocity and acceleration (axis units) at the times in which the current
    acts, from the beginning of the first period to the end of the last.
    """
    each, known = steps(p, dt), plain(p)
    hold = period_currents.hold(p, dt)
    way = _Way(known, np.ascontiguousarray(motion), (dt / each, each), memory.origin, memory.released is not None, hold)
    begins = memory.copy().plain
    time = memory.whole.memory.time
    current, whole = way.demanded(p, memory.whole, _at_rest(p, memory.origin, time, memory.released))
    without, plain_end = way.demanded(known, memory.plain, stage.at_rest(known, memory.origin, time))
    current -= without
    limited = _within_shares(p, way, begins, without, current)
    most = EFFECTS_SHARE * p.drive.current_limit
    limited += _limited("", current, most)
    np.clip(current, -most, most, out=current)
    held = float(current[-1])
    periods = current[1:] + period_currents.fading(memory.held - float(current[0]), len(current) - 1, dt)
    return periods, Answer(memory._replace(whole=whole, plain=plain_end, held=held), limited, encoder_map.mapped(p))


class _Way(NamedTuple):
    """A motion that models are inverted along."""

    plain: stage.Stage
    motion: Array  # (n `steps[1]` + 1, 3)
    steps: tuple[float, int]  # s between its rows, and how many of them are a control period
    origin: float  # rad | m, where what is demanded at rest is left to the feedback
    braked: bool  # whether a brake held the axis there
    hold: period_currents.Hold  # of all models alike, as they are subtracted

    def for_model(self, p: stage.Stage) -> _Way:
        """The same in no finer steps than this model needs."""
        h, each = self.steps
        needed = steps(p, h * each)
        if each % needed:
            return self
        return self._replace(motion=self.motion[:: each // needed].copy(), steps=(h * each / needed, needed))

    def demanded(self, p: stage.Stage, x: stage.State, first: stage.State) -> tuple[Array, stage.State]:
        """Current (n + 1,) A at rest and in each period, beyond that of the `first` state; the state at the end."""
        at_origin, begins = _resting(p, first), _resting(p, x)
        out = np.empty(len(self.motion))
        end = inverse.along(p, x, self.motion, self.steps[0], out)
        acting = self.hold.commands(0.5 * (out[1:] + out[:-1]), self.steps[1])
        return np.concatenate([[begins], acting]) - at_origin, end


def _resting(p: stage.Stage, x: stage.State) -> float:
    """Current (A) that holds the axis at rest where it is; its state `x` stays."""
    out = np.empty(1)
    inverse.along(p, stage.copied(x), np.array([[x.position, 0.0, 0.0]]), 1.0, out)
    return float(out[0])


def _within_shares(
    p: stage.Stage, way: _Way, begins: stage.State, without: Array, current: Array
) -> tuple[Limited, ...]:
    """Take from `current` (n + 1,) A, in place, what an effect demands on its own beyond its share of the limit.

    `without` (n + 1,) A is what the plain model demands; it `begins` in this state.  Where all effects together stay
    within the share of one, none is limited, and none is looked at: each one costs an inverse.
    """
    most, limited = EFFECT_SHARE * p.drive.current_limit, list[Limited]()
    if float(np.abs(current).max()) <= most:
        return ()
    for effect in places(p):
        alone = put(way.plain, effect, get(p, effect))
        rubs = stage.copied(begins)
        rubbing = {"force": rubs.force, "stops": rubs.stops, "bristle": rubs.bristle}
        first, rests = (
            _at_rest(alone, place, begins.memory.time, 0.0 if way.braked else None)
            for place in (way.origin, begins.position)
        )
        behind = stage.Contact(rubs.force, rubs.bristle, rubs.memory.lagged, rubs.memory.rested)
        memory = rests.memory._replace(behind=behind, stops=stage.copied(rubs).stops)  # a rigid model has one friction
        rests = rests._replace(memory=memory, **rubbing)
        own, _ = way.for_model(alone).demanded(alone, rests, first)
        own -= without
        current -= own - period_currents.spread(own, most)
        limited += _limited(effect, own, most)
    return tuple(limited)


def places(p: stage.Stage) -> list[str]:
    """Dotted places of the fields that hold an effect which a current answers."""
    known, groups = plain(p), (("drive", p.drive), ("motor", p.motor), ("mechanics", p.mechanics),
                               ("friction", p.friction))  # fmt: skip
    every = ("residual", *(f"{name}.{field}" for name, group in groups for field in group._fields))
    return [place for place in every if get(p, place) != get(known, place)]


def _limited(place: str, current: Array, most: float) -> tuple[Limited, ...]:
    """The record of a `current` (n + 1,) A beyond `most` (A); none where it is not."""
    largest = np.abs(current[1:])
    periods = int(np.sum(largest > most))
    return (Limited(place, float(largest.max()), most, periods),) if periods else ()
