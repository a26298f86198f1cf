"""How far, how fast and how hard the logs of a session went: the room that the next experiment is made for.

A capture folder has no stage file, so limits are not known; what the machine has done before it can do again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stagectl.gap.experiment_design import scale
from stagectl.gap.experiment_design.experiment import Experiment
from stagectl.gap.experiment_design.scale import WORKING, Scale
from stagectl.gap.experiment_design.trajectory_text import number
from stagectl.gap.logs import deployed_controller, setpoints
from stagectl.gap.logs.deployed_controller import DeployedController
from stagectl.gap.logs.grid import LoggedReference
from stagectl.gap.logs.nominal_values import of_file
from stagectl.gap.logs.session import Array, GapError, Log, Session
from stagectl.gap.residuals.thresholds import TRACKER_BANDWIDTH
from stagectl.kernels import feedback, feedforward, stage
from stagectl.kernels.law import Law
from stagectl.plan import SETTLE
from stagectl.trajectories import phases

WINDOW = 0.01  # s over which a speed is differenced
# The experiments move to their places at half the limit of the speed, so that twice what was seen brings no more.
SHARE = 2.0
ONE_SIDED = 0.2  # of the stroke: a start nearer to its end leaves no room, and the middle is taken
SLOWEST = 0.5  # of the deployed loop's own design: a loop of ours that stands in for it


class Seen(NamedTuple):
    """The extremes of all logs, in axis units."""

    low: float  # rad | m
    high: float
    begins: float  # where most logs begin, by their reference
    speed: float  # rad/s | m/s
    acceleration: float  # rad/s^2 | m/s^2
    current: float  # A


class Room(NamedTuple):
    """What an experiment on the machine of a session is made for."""

    seen: Seen
    scale: Scale
    start: float  # rad | m, where the axis stands
    deployed: DeployedController  # what goes into the setpoints
    law: Law
    known: bool  # whether that is the deployed controller, or one that stands in for it
    per_unit: float  # m of travel per rad | m; 1 where the travel is an angle

    def heeds(self) -> list[str]:
        """What whoever runs an experiment must know of where it begins, how far it goes and what its loop is."""
        unit, p = self.scale.unit, self.seen
        said = []
        if self.start != p.begins:
            said.append(f"Start in the middle of the travel, at {number(self.start * self.per_unit, unit)}.")
        low, high = p.low - self.start, p.high - self.start
        if self.scale.low < 1.01 * low * self.per_unit or self.scale.high > 1.01 * high * self.per_unit:
            ends = f"{number(self.scale.low, unit)} and {number(self.scale.high, unit)}"
            said.append(f"It may go farther than the logs have been, between {ends}: see that the machine may.")
        if not self.known:
            said.append("The deployed controller is not known: the separation is that under a loop of our own design.")
        return said


def seen(session: Session) -> Seen:
    """How far, fast and hard the machine went.

    Raises GapError where it never moved.
    """
    positions = [log.position for log in session.logs]
    low, high = min(float(x.min()) for x in positions), max(float(x.max()) for x in positions)
    begins = float(np.median([(log.position if log.reference is None else log.reference)[0] for log in session.logs]))
    rates = np.array([_rates(log, session.dt) for log in session.logs])
    speed, acceleration = (float(one) for one in rates.max(axis=0))
    if not (high > low and speed > 0.0):
        raise GapError(
            f"no log of {session.place} moves: no experiment can be made to the machine's measure; record one sine "
            "that moves it first"
        )
    current = max(float(np.abs(_current(log)).max()) for log in session.logs)
    return Seen(low, high, begins, speed, acceleration, current)


def _rates(log: Log, dt: float) -> tuple[float, float]:
    """Largest speed and acceleration, of the reference where it is known."""
    window = max(round(WINDOW / dt), 1)
    path = log.position if log.reference is None else log.reference
    speed = (path[window:] - path[:-window]) / (window * dt)
    change = (speed[window:] - speed[:-window]) / (window * dt)
    return float(np.abs(speed).max(initial=0.0)), float(np.abs(change).max(initial=0.0))


def _current(log: Log) -> Array:
    known = log.command if log.current is None else log.current
    return np.zeros(1) if known is None else known


def room(session: Session) -> Room:
    """The room of a session: travel as it was, twice the speed, acceleration and current that its logs have shown.

    Raises GapError where they never move, or the machine's current does not suffice to.
    """
    extremes = seen(session)
    running = _running(session)
    known = running is not None and session.law is not None
    made = running if running is not None and known else _stand_in(session)
    law = session.law if session.law is not None and known else made.law
    start = _start(extremes)
    return Room(extremes, _scale(session, extremes, start, law), start, made, law, known, session.travel_per_unit)


def _start(p: Seen) -> float:
    """Where the logs begin, or the middle of the travel where that is near its end."""
    nearer = min(p.begins - p.low, p.high - p.begins)
    return p.begins if nearer > ONE_SIDED * (p.high - p.low) else 0.5 * (p.low + p.high)


def _scale(session: Session, p: Seen, start: float, law: Law) -> Scale:
    model, per_unit = session.stage, session.travel_per_unit
    presliding = max(scale.presliding(model.friction), scale.COARSEST * model.encoder.step)
    beyond = 10.0 * presliding  # a travel that is shorter leaves no room for any experiment
    resisting = stage.sliding(model.friction) + abs(model.mechanics.bias)
    needed = 1.2 * resisting / (WORKING * model.motor.force_constant)
    limit = min(max(SHARE * p.current, needed), law.current_limit, model.drive.current_limit)
    found = Scale(
        unit=session.travel_unit,
        low=scale.rounded(min(p.low - start, -beyond) * per_unit),
        high=scale.rounded(max(p.high - start, beyond) * per_unit),
        speed=SHARE * p.speed * per_unit,
        acceleration=SHARE * p.acceleration * per_unit,
        effort=model.motor.force_constant * limit,
        resisting=resisting,
        viscous=model.mechanics.viscous / per_unit,
        inertia=model.mechanics.inertia / per_unit,
        presliding=presliding * per_unit,
        pitch=model.mechanics.pitch * per_unit,
        encoder_step=model.encoder.step * per_unit,
        current_limit=limit,
        dt=session.dt,
    )
    return scale.checked(found, str(session.place))


def _running(session: Session) -> DeployedController | None:
    """The deployed controller as the session's own description has it."""
    if not session.nominal:
        return None
    return deployed_controller.read(of_file(session.nominal, session.place / "nominal.yaml", session.kind))


def _stand_in(session: Session) -> DeployedController:
    """A loop designed for the nominal model, slow enough for any delay."""
    p, dt = session.stage, session.dt
    gains = feedback.place_poles(p.mechanics, p.motor.force_constant, SLOWEST * TRACKER_BANDWIDTH / dt)
    law = Law(feedback.discretised(gains, dt), p.drive.current_limit)
    plant = feedforward.held(p.mechanics, p.motor.force_constant, dt)
    ahead = feedforward.Feedforward(plant, p.friction.operators, p.motor.force_constant, True, True)
    advance = p.drive.current_lag + p.drive.delay_samples * dt
    return DeployedController(law, dt, ahead, advance, advance + 0.5 * dt, p.encoder.delay_samples)


def laid_out(session: Session, p: Room, experiment: Experiment) -> Array:
    """Rows (n, 8) of `kernels.law.Setpoint`, as the controller would have them, from where the axis stands."""
    parts = phases(experiment.trajectory)
    rows = 2 * math.ceil((parts.duration + SETTLE) / (2.0 * session.dt))
    t: Array = session.dt * np.arange(rows, dtype=np.float64)
    reference = p.start + parts.motion.at(t).position / session.travel_per_unit
    injection = None if parts.current is None else parts.current.at(t - parts.start)
    return setpoints.from_reference(p.deployed, LoggedReference(t, reference), rows, injection)
