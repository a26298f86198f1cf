"""How far, how fast and how hard the logs of a session went: the range that the next experiment is made for.

A capture folder has no stage file, so limits are not known; what the machine has done before it can do again.
"""

import math
from typing import NamedTuple

import numpy as np

from stagectl.gap.experiment_design import stage_scale, thresholds
from stagectl.gap.experiment_design.experiment import Experiment, number
from stagectl.gap.experiment_design.stage_scale import StageScale
from stagectl.gap.logs import deployed_controller, deployed_setpoints
from stagectl.gap.logs.deployed_controller import DeployedController
from stagectl.gap.logs.grid import LoggedReference
from stagectl.gap.logs.nominal_values import of_file
from stagectl.gap.logs.session import Array, GapError, Log, Session
from stagectl.gap.residuals.thresholds import TRACKER_BANDWIDTH
from stagectl.kernels import feedback, feedforward, stage
from stagectl.kernels.law import Law
from stagectl.plan import SETTLE
from stagectl.problem import Problem, ProblemKind
from stagectl.trajectories import phases


class LoggedExtremes(NamedTuple):
    """The extremes of all logs, in axis units."""

    low: float  # rad | m
    high: float
    begins: float  # where most logs begin, by their reference
    speed: float  # rad/s | m/s
    acceleration: float  # rad/s^2 | m/s^2
    current: float  # A


class OperatingRange(NamedTuple):
    """What an experiment on the machine of a session is made for."""

    seen: LoggedExtremes
    scale: StageScale
    start: float  # rad | m, initial position of the axis
    deployed: DeployedController  # what goes into the setpoints
    law: Law
    known: bool  # whether that is the deployed controller, or one that stands in for it
    per_unit: float  # m of travel per rad | m; 1 where the travel is an angle

    def cautions(self) -> list[str]:
        """What whoever runs an experiment must know of where it begins, how far it goes and what its loop is."""
        unit, p = self.scale.unit, self.seen
        lines = []
        if self.start != p.begins:
            lines.append(f"Start in the middle of the travel, at {number(self.start * self.per_unit, unit)}.")
        low, high = (thresholds.GOES_FARTHER * (end - self.start) * self.per_unit for end in (p.low, p.high))
        if self.scale.low < low or self.scale.high > high:
            ends = f"{number(self.scale.low, unit)} and {number(self.scale.high, unit)}"
            lines.append(f"It may go farther than the logs did, between {ends}: check that the machine allows it.")
        if not self.known:
            lines.append(
                "The deployed controller is not known: the separation is that under a controller of our own design."
            )
        return lines


def extremes_of(session: Session) -> LoggedExtremes:
    """How far, fast and hard the machine went.  Raises GapError where it never moved."""
    positions = [log.position for log in session.logs]
    low, high = min(float(x.min()) for x in positions), max(float(x.max()) for x in positions)
    begins = float(np.median([path_of(log)[0] for log in session.logs]))
    rates = np.array([_rates(log, session.dt) for log in session.logs])
    speed, acceleration = (float(rate) for rate in rates.max(axis=0))
    if not (high > low and speed > 0.0):
        reason = f"no log of {session.place} moves, so no experiment can be scaled to the machine"
        raise GapError(Problem(reason, ProblemKind.MISSING, remedy="record one sine that moves it first"))
    known = [log.command if log.current is None else log.current for log in session.logs]
    current = max((float(np.abs(values).max()) for values in known if values is not None), default=0.0)
    return LoggedExtremes(low, high, begins, speed, acceleration, current)


def path_of(log: Log) -> Array:
    """The reference (n,) of a log, or its position where none is known."""
    return log.position if log.reference is None else log.reference


def _rates(log: Log, dt: float) -> tuple[float, float]:
    """Largest speed and acceleration."""
    window = max(round(thresholds.SPEED_WINDOW / dt), 1)
    path = path_of(log)
    speed = (path[window:] - path[:-window]) / (window * dt)
    change = (speed[window:] - speed[:-window]) / (window * dt)
    return float(np.abs(speed).max(initial=0.0)), float(np.abs(change).max(initial=0.0))


def operating_range(session: Session) -> OperatingRange:
    """The range of a session: travel as it was, twice the speed, acceleration and current that its logs have shown.

    Raises GapError where they never move, or the machine's current does not suffice to.
    """
    seen = extremes_of(session)
    described = _described(session)
    known = described is not None and session.law is not None
    deployed = described if described is not None and known else _stand_in(session)
    law = session.law if session.law is not None and known else deployed.law
    start = _start(seen)
    return OperatingRange(seen, _scale(session, seen, start, law), start, deployed, law, known, session.travel_per_unit)


def _start(p: LoggedExtremes) -> float:
    """Where the logs begin, or the middle of the travel where that is near its end."""
    nearer = min(p.begins - p.low, p.high - p.begins)
    return p.begins if nearer > thresholds.ONE_SIDED * (p.high - p.low) else 0.5 * (p.low + p.high)


def _scale(session: Session, p: LoggedExtremes, start: float, law: Law) -> StageScale:
    model, per_unit = session.stage, session.travel_per_unit
    presliding = stage_scale.visible_presliding(model)
    beyond = thresholds.LEAST_TRAVEL * presliding
    resisting = stage.sliding(model.friction) + abs(model.mechanics.bias)
    needed = thresholds.CURRENT_RESERVE * resisting / (thresholds.WORKING_EFFORT * model.motor.force_constant)
    limit = min(max(thresholds.BEYOND_SEEN * p.current, needed), law.current_limit, model.drive.current_limit)
    scale = StageScale(
        unit=session.travel_unit,
        low=stage_scale.rounded(min(p.low - start, -beyond) * per_unit),
        high=stage_scale.rounded(max(p.high - start, beyond) * per_unit),
        speed=thresholds.BEYOND_SEEN * p.speed * per_unit,
        acceleration=thresholds.BEYOND_SEEN * p.acceleration * per_unit,
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
    return stage_scale.checked(scale, str(session.place))


def _described(session: Session) -> DeployedController | None:
    """The deployed controller as the session's own description has it."""
    if not session.nominal:
        return None
    return deployed_controller.read(of_file(session.nominal, session.place / "nominal.yaml", session.kind))


def _stand_in(session: Session) -> DeployedController:
    """A loop designed for the nominal model, slow enough for any delay."""
    p, dt = session.stage, session.dt
    bandwidth = thresholds.STAND_IN_BANDWIDTH * TRACKER_BANDWIDTH / dt
    gains = feedback.place_poles(p.mechanics, p.motor.force_constant, bandwidth)
    law = Law(feedback.discretised(gains, dt), p.drive.current_limit)
    plant = feedforward.held(p.mechanics, p.motor.force_constant, dt)
    ahead = feedforward.Feedforward(plant, p.friction.operators, p.motor.force_constant, True, True)
    advance = p.drive.current_lag + p.drive.delay_samples * dt + p.drive.dead_time
    return DeployedController(law, dt, ahead, advance, advance + 0.5 * dt, p.encoder.delay_samples)


def setpoints_for(session: Session, p: OperatingRange, experiment: Experiment) -> Array:
    """Rows (n, 8) of `kernels.law.Setpoint`, as the controller would have them, from the initial position."""
    parts = phases(experiment.trajectory)
    rows = 2 * math.ceil((parts.duration + SETTLE) / (2.0 * session.dt))
    t: Array = session.dt * np.arange(rows, dtype=np.float64)
    reference = p.start + parts.motion.at(t).position / session.travel_per_unit
    injection = None if parts.current is None else parts.current.at(t - parts.start)
    return deployed_setpoints.setpoints_of(p.deployed, LoggedReference(t, reference), rows, injection)
