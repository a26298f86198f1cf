"""What the loop accepts, from the stage file: the limits that stand in it, and those that follow from the model."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_checks import decelerations
from stagectl.config.stage_file import Setup
from stagectl.drives import limits as decided
from stagectl.drives.drive import Canopen
from stagectl.kernels import equilibrium, stage
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.motion_limits import LimitError
from stagectl.problem import Problem, ProblemKind
from stagectl.realtime.safety import Envelope

_SPEED = 1.1  # of limits.speed: what a reference at the limit overshoots
_CURRENT, _CURRENT_TIME = 1.5, 0.01  # of drive.current_limit, and s that it may be beyond
_FORCE = 2.0  # times the model's largest acceleration; load and base are not modelled to the last
_BREAKAWAY, _BREAKAWAY_TIME = 2.0, 0.02  # times the model's friction, and s under it without a count
_JUMP, _FREEZE = 0.25, 0.5  # of limits.following_error
_COUNTS = 4.0  # encoder steps that are nothing yet


def envelope(setup: Setup) -> Envelope:
    """The stage's envelope in axis units."""
    limits, p, realtime = setup.file.limits, setup.stage, setup.file.realtime
    moving = limits.following_error
    rest = moving if limits.following_error_at_rest is None else limits.following_error_at_rest
    speed = limits.speed * _SPEED
    return Envelope(
        low=limits.travel[0],
        high=limits.travel[1],
        speed=speed,
        following_error=rest,
        late_limit=realtime.late_limit,
        error_ramp=(moving - rest) / limits.speed,
        error_time=limits.following_error_time,
        deceleration=braking(setup),
        jump=_counted(p, limits.encoder_jump, _JUMP * moving),
        acceleration=_FORCE * acceleration(setup),
        freeze=_counted(p, limits.encoder_freeze, _FREEZE * moving),
        breakaway=_breakaway(setup),
        freeze_time=_BREAKAWAY_TIME,
        current=_CURRENT * setup.file.drive.current_limit if limits.current is None else limits.current,
        current_time=_CURRENT_TIME,
        continuous_current=math.inf if limits.continuous_current is None else limits.continuous_current,
        thermal_time=limits.thermal_time,
        **_followed(setup),
    )


def _followed(setup: Setup) -> dict[str, Any]:
    """When the measured current is not the commanded one: from the model's drive and its measurement."""
    drive, wire, dt = setup.stage.drive, setup.file.drive.wire, setup.dt
    measured = wire.current_scale if isinstance(wire, Canopen) else 0.0
    count = max(measured, drive.current_quantum)  # A; a smaller change of the command shows in neither
    noise, errors = decided.CURRENT_NOISE * setup.file.simulation.current_noise, drive.telemetry
    floor = max(decided.CURRENT_FLOOR * drive.current_limit, 2.0 * count) + noise
    floor += abs(drive.offset) + abs(drive.directed_offset) + abs(errors.offset)
    given = setup.file.limits.current_deviation
    settling = decided.CURRENT_LAGS * drive.current_lag + errors.late + drive.dead_time + (drive.delay_samples + 2) * dt
    return {
        "current_floor": floor if given is None else given,
        "current_share": decided.CURRENT_SHARE + abs(errors.gain) + abs(drive.gain) + abs(drive.gain_asymmetry),
        "current_settling": settling,
        "unfollowed_time": decided.CURRENT_TIME + settling,
        "frozen": decided.FROZEN_QUANTA * count + noise,
        "frozen_time": decided.FROZEN_TIME + settling,
    }


def acceleration(setup: Setup) -> float:
    """Largest acceleration (rad/s^2 | m/s^2) by the model: all current, and friction and load with it."""
    p = setup.stage
    effort = p.drive.current_limit * p.motor.force_constant + stage.sliding(p.friction) + setup.load
    return effort / p.mechanics.inertia


def braking(setup: Setup) -> float:
    """With how much the axis can be braked (rad/s^2 | m/s^2): the drive's ramp, as far as the current carries it."""
    limits, p = setup.file.limits, setup.stage
    if limits.deceleration is not None:
        return limits.deceleration
    effort = p.drive.current_limit * p.motor.force_constant + stage.sliding(p.friction)
    return min(setup.file.own_ramp, max(effort - equilibrium.weight(p.mechanics), 0.0) / p.mechanics.inertia)


def check_braking(setup: Setup, rows: NDArray[np.float64]) -> None:
    """Refuse a motion of these `rows` (n, 8) that the loop would stop as one that cannot brake within the travel.

    Raises LimitError, which names the entry that brakes least.
    """
    p = envelope(setup)
    reference, speed = (rows[:, SETPOINT_COLUMNS[name]] for name in ("reference", "velocity"))
    room = np.where(speed > 0.0, p.high - reference, reference - p.low) + p.following_error
    beyond = speed**2 > 2.0 * p.deceleration * room
    if not beyond.any():
        return
    needed = float(np.max(speed**2 / (2.0 * np.maximum(room, p.following_error))))
    raise _unbraked(setup, float(np.argmax(beyond)) * setup.dt, p.deceleration, needed)


def _unbraked(setup: Setup, at: float, allowed: float, needed: float) -> LimitError:
    """The refusal of a motion that needs a deceleration (rad/s^2 | m/s^2) at this time (s)."""
    every, travel = decelerations(setup.file), setup.file.axis.travel
    unit, scale = f"{travel.unit}/s^2", travel.per_unit
    entry = next(iter(every)) if "limits.deceleration" in every else min(every, key=lambda each: every[each])
    value, least = (travel.length(each, "/s^2") for each in (allowed, needed))
    stops = f"at {at:.3g} s of the motion the axis could no longer stop within limits.travel"
    remedy = f"nothing has moved; the motion needs {least}: check the unit, or make it slower"
    if "," in entry:  # no entry of its own
        problem = Problem(f"{stops}, as {entry} brake it with {value}", ProblemKind.LIMIT, unit=unit)
    else:
        problem = Problem(stops, ProblemKind.LIMIT, entry, value, unit)
    return LimitError(problem._replace(remedy=remedy), needed * scale, allowed * scale)


def _breakaway(setup: Setup) -> float:
    """Current (A) under which the axis must move; inf where the drive cannot give it: see `unwatched`."""
    current = _needed(setup)
    return current if current < setup.stage.drive.current_limit else math.inf


def _needed(setup: Setup) -> float:
    """Current (A) under which no axis stands by the model, with room for what the model does not know."""
    p = setup.stage
    effort = stage.sliding(p.friction) * (1.0 + p.friction.stribeck.rise) + setup.load
    return _BREAKAWAY * effort / p.motor.force_constant


def unwatched(setup: Setup) -> str:
    """What to say of an axis at rest whose frozen encoder no current shows; empty where one does."""
    needed, most = _needed(setup), setup.stage.drive.current_limit
    if needed < most:
        return ""
    return (
        "limits: an encoder that freezes while the axis stands does not trip `freeze`: friction and load of the model"
        f" hold the axis up to {needed / _BREAKAWAY:.3g} A, and drive.current_limit = {most:.3g} A is not more than"
        f" {_BREAKAWAY:g} times that"
    )


def _counted(p: stage.Stage, given: float | None, otherwise: float) -> float:
    return otherwise + _COUNTS * p.encoder.step if given is None else given
