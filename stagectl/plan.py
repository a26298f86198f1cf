"""A trajectory on a stage: checked against the limits, then laid out period by period.

The delay rule, with ``L = current lag + nd Ts + dead time`` and the measurement late by ``nm Ts``::

    feedforward   desired states at t + L             (the current acts L later)
    target y0     desired states at t - nm Ts         (so late is the measurement)
    friction      position at t + L + Ts/2            (the middle of the period it acts in)
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.compensation import encoder_map, model_effects
from stagectl.compensation.forms import Model
from stagectl.compensation.legs import legs
from stagectl.config.stage_file import Setup
from stagectl.kernels import equilibrium, friction_path, rollout
from stagectl.kernels.feedforward import Feedforward, Foreseen, setpoints
from stagectl.kernels.friction import relaxed
from stagectl.kernels.friction_bristle import Bristle
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.kernels.stage import Stage
from stagectl.motion_limits import check_current, check_duration, check_jumps, check_limits, check_open
from stagectl.trajectories import Experiment, Phases, Span, Trajectory, phases
from stagectl.trajectories.approach import Approach
from stagectl.trajectories.motion import Array

# Chosen, not derived:
LONGEST = 10_000_000  # control periods of a trajectory, 83 minutes at 2 kHz: what a memory holds
SETTLE = 0.1  # s of standstill after the motion, in which the axis must come into position


class Start(NamedTuple):
    """Where a motion begins, and what earlier ones left of the friction."""

    position: float = 0.0  # rad | m, of the axis: the motion's reference is relative to it
    stops: Any = None  # friction operators; None: relaxed
    effects: model_effects.Memory | None = None  # None: at rest, not moved yet
    clock: float = 0.0  # s since the axis was cold, as far as is known
    reading: float | None = None  # rad | m, what the encoder is held at; None: the position, as after switching on

    def copy(self) -> Start:
        """One of its own to move on."""
        stops = None if self.stops is None else np.array(self.stops)
        return self._replace(stops=stops, effects=None if self.effects is None else self.effects.copy())


AT_ZERO = Start()
Path = Trajectory | Approach


class Plan(NamedTuple):
    """A motion laid out period by period."""

    setpoints: NDArray[np.float64]  # (n, 8), fields of kernels.law.Setpoint, relative to the axis' position
    steady: tuple[float, float]  # s, window of the tracking error
    duration: float  # s, without the standstill at its end
    excitation: tuple[Span, ...] = ()  # steady parts of an injected current
    effects: model_effects.Memory | None = None  # of the model's effects at its end; None where it has none
    limited: tuple[model_effects.Limited, ...] = ()  # effects whose current reached its share of the limit
    mapped: bool = False  # whether the target holds what the encoder adds to the reference


def command_delay(setup: Setup) -> float:
    """L (s): from the command to the current, its dead time included."""
    drive = setup.stage.drive
    return drive.current_lag + drive.delay_samples * setup.dt + drive.dead_time


def plan(setup: Setup, experiment: Experiment, feedforward: Feedforward, start: Start = AT_ZERO) -> Plan:
    """Check against the stage's limits and lay out the rows.

    `start` is what earlier motions left; its friction states are moved on.

    Raises LimitError with value, limit and the field to change; nothing has moved then.
    """
    parts = phases(experiment)
    check_duration(parts.duration, setup.dt, LONGEST)
    check_limits(setup, parts.motion)
    true, motion = _true_path(setup, parts.motion, start) if feedforward.with_effects else (start, parts.motion)
    seen = foresee(setup, motion, parts.duration)
    check_jumps(setup, seen)
    force = _further_friction(setup, motion, seen) if feedforward.with_friction else None
    model = isinstance(setup.file.compensation, Model)
    ahead = feedforward._replace(with_friction=feedforward.with_friction and model)
    rows = setpoint_rows(ahead, seen, relaxed(feedforward.friction) if start.stops is None else start.stops, force)
    answer = _add_effects(setup, motion, rows, true) if feedforward.with_effects else model_effects.Answer()
    if answer.mapped:
        _map(setup, parts.motion, rows, (start.position, true.position))
    _experiment(setup, parts, rows)
    spans, begins = parts.current.spans if parts.current is not None else (), parts.start
    excitation = tuple(span._replace(start=span.start + begins, end=span.end + begins) for span in spans)
    return Plan(rows, parts.steady, parts.duration, excitation, *answer)


def setpoint_rows(p: Feedforward, seen: Foreseen, stops: Array, force: Array | None) -> NDArray[np.float64]:
    """Rows (n, 8) of `kernels.law.Setpoint`, for a reference at the instants `seen`.

    The friction operators move on from their state `stops`; `force` (n,) N m | N is friction of any other law.
    """
    rows = np.zeros((len(seen.reference), rollout.SETPOINTS))
    setpoints(p, seen, stops, rows)
    column = SETPOINT_COLUMNS["friction"]
    if force is not None:
        current = force / p.force_constant
        rows[:, column] = rows[:, column] + current if p.with_friction else current
    rows[:, column] *= p.friction_scale
    return rows


def _answered(setup: Setup) -> Stage:
    """The model as far as the controller answers it."""
    return model_effects.without(setup.stage, setup.file.control.unanswered)


def _true_path(setup: Setup, motion: Trajectory, start: Start) -> tuple[Start, Path]:
    """Where the axis stands and its way from there: by the map of its encoder, where it has one."""
    p = _answered(setup)
    if not encoder_map.mapped(p):
        return start, motion
    place = equilibrium.read(p, start.position if start.reading is None else start.reading)
    off = (place - start.position) * setup.file.axis.travel_per_unit
    return start._replace(position=place), Approach(motion, off)


def _map(setup: Setup, motion: Trajectory, rows: Array, begins: tuple[float, float]) -> None:
    """Make the target what the encoder will show, and the reference that of `motion`; the way `begins` at both."""
    reference, target = (SETPOINT_COLUMNS[name] for name in ("reference", "target"))
    t: Array = setup.dt * np.arange(len(rows), dtype=np.float64)
    rows[:, reference] = _at(setup, motion, t)[:, 0]
    rows[:, target] = encoder_map.shown(_answered(setup), begins[1] + rows[:, target]) - begins[0]


def _add_effects(setup: Setup, motion: Path, rows: Array, start: Start) -> model_effects.Answer:
    """Put the current against the model's further effects into `rows`, with the friction."""
    p, dt = _answered(setup), setup.dt
    if not isinstance(setup.file.compensation, Model):
        p = model_effects.rubbing_answered(p)
    lead = command_delay(setup)
    released = setup.file.brake.beyond(setup.stage, start.position)
    memory = model_effects.going_on(p, start.position, start.effects, start.clock + lead, released)
    if not model_effects.present(p) and memory.held == 0.0 and not memory.released:
        return model_effects.Answer()
    each = model_effects.steps(p, dt)
    t: Array = dt / each * np.arange(each * len(rows) + 1, dtype=np.float64) + lead
    path = np.stack(motion.at(t)[:3], axis=1) / setup.file.axis.travel_per_unit
    path[:, 0] += start.position
    current, answer = model_effects.along(p, memory, path, dt)
    model_effects.put_into(rows, p, current, memory.whole.commands[0])
    return answer


def _further_friction(setup: Setup, motion: Path, seen: Foreseen) -> Array | None:
    """Friction (n,) N m | N to compensate that is not of stop operators; None where there is none."""
    compensation, dt = setup.file.compensation, setup.dt
    if not isinstance(compensation, Model):  # the form that the stage file chose, at t + L + Ts/2
        t: Array = dt * np.arange(len(seen.reference), dtype=np.float64) + (command_delay(setup) + 0.5 * dt)
        place, speed = _at(setup, motion, t).T
        force: Array = compensation.along(legs(place, speed, dt))
        return force
    bristle = setup.stage.friction.bristle
    return bristle_force(bristle, seen, dt) if bristle.coulomb > 0.0 else None


def _experiment(setup: Setup, parts: Phases, rows: NDArray[np.float64]) -> None:
    """Put the injected current into `rows`, and open the loop where the experiment does."""
    t = setup.dt * np.arange(len(rows))
    if parts.current is not None:
        check_current(setup, parts.current.amplitude)
        rows[:, SETPOINT_COLUMNS["injection"]] = parts.current.at(t - parts.start)
    opened = t >= parts.opens - 1e-9
    for name in ("feedforward", "friction", "velocity", "closed"):
        rows[opened, SETPOINT_COLUMNS[name]] = 0.0
    if parts.opens == 0.0:
        check_open(setup, rows[:, SETPOINT_COLUMNS["injection"]])


def bristle_force(p: Bristle, seen: Foreseen, dt: float) -> Array:
    """Friction (n,) N m | N of a bristle along the reference, from rest."""
    place = np.concatenate([seen.reference[:1], seen.friction])
    columns = np.empty((len(place), 2))
    friction_path.bristle(p, place, dt, columns)
    force: Array = (columns[:, 0] + p.damping * columns[:, 1])[1:]
    return force


def foresee(setup: Setup, trajectory: Path, duration: float) -> Foreseen:
    """The trajectory over `duration` (s), at the instants that the feedforward needs, by the delay rule."""
    dt, lead = setup.dt, command_delay(setup)
    t: Array = dt * np.arange(2 * math.ceil((duration + SETTLE) / (2.0 * dt)) + 2, dtype=np.float64)
    late = _at(setup, trajectory, t - setup.stage.encoder.delay_samples * dt)
    friction = _at(setup, trajectory, t[:-2] + (lead + 0.5 * dt))
    return Foreseen(_at(setup, trajectory, t[:-2])[:, 0], _at(setup, trajectory, t + lead), late, friction[:, 0])


def _at(setup: Setup, trajectory: Path, t: Array) -> Array:
    """Position and velocity (n, 2) in axis units."""
    motion = trajectory.at(t)
    return np.ascontiguousarray(np.stack(motion[:2], axis=1) / setup.file.axis.travel_per_unit)
