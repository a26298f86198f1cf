"""How long and how far an axis may go on after a fault, from the stage file and the table of faults.

::

    time      = what notices it (time-outs, periods, following error)  +  braking on the ramp, or coasting
    distance  = speed x the time until it is noticed  +  what the fault itself may move  +  braking

Coasting from v under Coulomb friction T and viscous friction D, with the inertia J (both closed forms)::

    t = J/D ln(1 + D v/T)        x = J/D (v - T/D ln(1 + D v/T))
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.daemon.envelope import acceleration
from stagectl.drives.drive import Canopen
from stagectl.drives.faults import Row
from stagectl.kernels import stage

_CYCLES = 12  # periods in which what is seen at once is acted upon: three bent answers, the way to the drive and back
_SETTLES = 0.06  # s of a braked stop beyond its ramp: the drive's velocity loop
_MARGIN = 1.5  # on braking: a ramp that is followed, not led
_WATCH = 0.02  # s in which an axis that gets faster under its stop is found out
_TRIES = 40  # chances after which what happens by chance has happened
LONGEST = 2.0  # s that a motion takes
_LOOP = 0.005  # s between two looks of the drive at its time-outs, with what is on the way


class Limit(NamedTuple):
    """The most that is admitted."""

    time: float  # s from the fault to standstill
    distance: float  # rad | m


def limit(setup: Setup, row: Row, block: Any, speed: float) -> Limit:
    """For an axis that moves at `speed` (rad/s | m/s) as the fault begins."""
    noticed = unnoticed(setup, row, block, speed)
    error = setup.file.limits.following_error
    force = acceleration(setup.stage)
    pushed = "error" in row.must.noticed or "chance" in row.must.noticed
    faster = speed + (math.sqrt(2.0 * force * error) + force * _WATCH) * pushed
    time, way = coast(setup.stage, faster) if row.must.brakes == "coast" else ramp(setup, faster)
    return Limit(noticed + time, speed * noticed + error + faster * _WATCH + way)


def unnoticed(setup: Setup, row: Row, block: Any, speed: float) -> float:
    """Time (s) until the fault is noticed by an axis that moves at `speed` (rad/s | m/s)."""
    return sum(_noticed(setup, name, block, speed) for name in row.must.noticed)


def pushed(p: stage.Stage, acceleration: float, time: float) -> tuple[float, float]:
    """Way and speed that an axis gets which a command for so much `acceleration` pushes for so long against friction.

    With the viscous rate d = D/J and a less the friction:  v = a/d (1 - exp(-d t)),  x = (a t - v)/d
    """
    left = max(acceleration - 2.0 * stage.sliding(p.friction) / p.mechanics.inertia, 0.0)  # it helped the braking
    rate = p.mechanics.viscous / p.mechanics.inertia
    if rate <= 0.0:
        return left * time * time / 2.0, left * time
    speed = -math.expm1(-rate * time) * left / rate
    return (left * time - speed) / rate, speed


def ramp(setup: Setup, speed: float) -> Limit:
    """Of the drive's own stop."""
    wire = setup.file.drive.wire
    assert isinstance(wire, Canopen)
    a = wire.quick_stop_deceleration
    return Limit(_MARGIN * speed / a + _SETTLES, _MARGIN * speed * speed / (2.0 * a) + speed * _SETTLES)


def coast(p: stage.Stage, speed: float) -> Limit:
    """Of an axis without power; infinite where nothing would stop it."""
    inertia, viscous, coulomb = p.mechanics.inertia, p.mechanics.viscous, stage.sliding(p.friction)
    if coulomb <= 0.0:
        return Limit(math.inf, math.inf)
    if viscous <= 0.0:
        return Limit(_MARGIN * inertia * speed / coulomb, _MARGIN * inertia * speed * speed / (2.0 * coulomb))
    decay, ratio = inertia / viscous, math.log1p(viscous * speed / coulomb)
    return Limit(_MARGIN * decay * ratio + _SETTLES, _MARGIN * decay * (speed - coulomb / viscous * ratio))


def _noticed(setup: Setup, name: str, block: Any, speed: float) -> float:
    """Time (s) until it is noticed by this means."""
    wire, dt = setup.file.drive.wire, setup.dt
    assert isinstance(wire, Canopen)
    silence = wire.heartbeat_timeout + wire.heartbeat + _LOOP
    command = wire.rpdo_timeout + _LOOP if wire.rpdo_timeout else silence
    found: dict[str, float] = {
        "cycle": _CYCLES * dt,
        "feedback": wire.feedback_timeout + _CYCLES * dt,
        "heartbeat": silence,
        "command": command,
        "supervision": min(silence, command),
        "chance": _TRIES * dt / getattr(block, "share", 1.0),
        "error": 2.0 * setup.file.limits.following_error / speed + _LOOP if speed else _LOOP,
        "motion": LONGEST,  # where the current that was right will be so no more
        "delay": _CYCLES * getattr(block, "delay", 0.0),
        "unbraked": _MARGIN * speed / wire.quick_stop_deceleration + _SETTLES + _CYCLES * dt,  # see `canopen_stop`
    }
    return found[name]
