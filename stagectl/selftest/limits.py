"""How long and how far an axis may go on after a fault, from the stage file and the table of faults.

::

    time      = what notices it (time-outs, periods, following error)  +  braking on the ramp, or coasting
    distance  = speed x the time until it is noticed  +  what the fault itself may move  +  braking

A fault may itself move the axis where it is seen by the following error, or by chance: then by that error, up to the
speed that all the force gives over it.  Else the axis goes on as it went until somebody notices.

Coasting from v under Coulomb friction T and viscous friction D, with the inertia J (both closed forms)::

    t = J/D ln(1 + D v/T)        x = J/D (v - T/D ln(1 + D v/T))
"""

import math
from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.drives.faults import FaultType
from stagectl.kernels import stage
from stagectl.realtime.envelope import acceleration
from stagectl.service.virtual_drive import VELOCITY_LOOP

_CYCLES = 12  # periods in which what is seen at once is acted upon: three bent answers, the way to the drive and back
_LAG = 1.0 / (2.0 * math.pi * VELOCITY_LOOP)  # s by which the speed is behind the drive's ramp
_SETTLES = 7.5 * _LAG  # s of a braked stop beyond its ramp, until 1/2000 of its speed is left
_MARGIN = 1.5  # on braking: a ramp that is followed, not led
_WATCH = 0.02  # s in which an axis that gets faster under its stop is found out
_WILD = {"error", "chance"}
_TRIES = 40  # chances after which what happens by chance has happened
LONGEST = 2.0  # s that a motion takes
_LOOP = 0.005  # s between two looks of the drive at its time-outs, with what is on the way


class Limit(NamedTuple):
    """The most that is admitted."""

    time: float  # s from the fault to standstill
    distance: float  # rad | m


def limit(setup: Setup, row: FaultType, block: Any, speed: float) -> Limit:
    """For an axis that moves at `speed` (rad/s | m/s) as the fault begins."""
    noticed, way, faster = unnoticed(setup, row, block, speed), 0.0, speed
    if _WILD & set(row.required.noticed):
        error, force = setup.file.limits.following_error, acceleration(setup)
        faster = speed + math.sqrt(2.0 * force * error) + force * _WATCH
        way = error + faster * _WATCH
    stop = braked(setup, row, faster)
    return Limit(noticed + stop.time, speed * noticed + way + stop.distance)


def turned(setup: Setup, row: FaultType, block: Any, calm: float) -> Limit:
    """For an axis that braked by its controller with the deceleration `calm` (rad/s^2 | m/s^2) as the fault began.

    A drive that hears nothing keeps the current that braked: the axis comes to a stand, and is pushed back by it.
    """
    noticed = unnoticed(setup, row, block, 0.0)
    way, back = pushed(setup.stage, calm, noticed)
    stop = braked(setup, row, back)
    return Limit(noticed + stop.time, way + stop.distance)


def braked(setup: Setup, row: FaultType, speed: float) -> Limit:
    """The stop that this fault leaves; where a drive that should brake may coast, the longer one of both."""
    if row.required.brakes == "ramp":
        return ramp(setup, speed)
    coasting = coast(setup.stage, speed)
    return coasting if row.required.category == 0 else larger(coasting, ramp(setup, speed))


def larger(first: Limit, second: Limit) -> Limit:
    """The most of both."""
    return Limit(*map(max, first, second))


def unnoticed(setup: Setup, row: FaultType, block: Any, speed: float) -> float:
    """Time (s) until the fault is noticed by an axis that moves at `speed` (rad/s | m/s)."""
    return sum(_noticed(setup, name, block, speed) for name in row.required.noticed)


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
    a = setup.canopen.quick_stop_deceleration
    return Limit(_MARGIN * speed / a + _SETTLES, _MARGIN * (speed * speed / (2.0 * a) + speed * _LAG))


def coast(p: stage.Stage, speed: float) -> Limit:
    """Of an axis without power; infinite where nothing would stop it."""
    inertia, viscous, coulomb = p.mechanics.inertia, p.mechanics.viscous, stage.sliding(p.friction)
    if coulomb <= 0.0:
        return Limit(math.inf, math.inf)
    if viscous <= 0.0:
        return Limit(_MARGIN * inertia * speed / coulomb, _MARGIN * inertia * speed * speed / (2.0 * coulomb))
    decay, ratio = inertia / viscous, math.log1p(viscous * speed / coulomb)
    return Limit(_MARGIN * decay * ratio, _MARGIN * decay * (speed - coulomb / viscous * ratio))


def _noticed(setup: Setup, name: str, block: Any, speed: float) -> float:
    """Time (s) until it is noticed by this means."""
    wire, dt = setup.canopen, setup.dt
    silence = wire.heartbeat_timeout + wire.heartbeat + _LOOP
    error = 2.0 * setup.file.limits.following_error / speed + _LOOP if speed else _LOOP
    # A drive without an RPDO time-out keeps its last current, as long as it hears heartbeats: see "motion".
    command = wire.rpdo_timeout + _LOOP if wire.rpdo_timeout else LONGEST + error
    times: dict[str, float] = {
        "cycle": _CYCLES * dt,
        "feedback": wire.feedback_timeout + _CYCLES * dt,
        "heartbeat": silence,
        "command": command,
        "supervision": min(silence, command),
        "chance": _TRIES * dt / getattr(block, "share", 1.0),
        "error": error,
        "motion": LONGEST,  # where the current that was right will be so no more
        "delay": _CYCLES * getattr(block, "delay", 0.0),
        "unbraked": _MARGIN * speed / wire.quick_stop_deceleration + _SETTLES + _CYCLES * dt,  # see `canopen_stop`
    }
    return times[name]
