"""One axis as the service sees it: its orders, its motions, its parameters.  No drive is touched here: see `board`."""

import math
import os
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

from stagectl import design
from stagectl.compensation import model_effects
from stagectl.config.lengths import Lengths
from stagectl.config.machine_file import split
from stagectl.config.stage_file import Setup
from stagectl.config.unit_format import worded
from stagectl.kernels import rollout, stage
from stagectl.kernels.friction import relaxed
from stagectl.plan import Start
from stagectl.problem import meant
from stagectl.realtime.axis_data import LAW, Orders
from stagectl.realtime.bumpless_transfer import flattened
from stagectl.realtime.shared_memory import AHEAD, Board, Move, Order, Status
from stagectl.realtime.states import Event, State, why_not
from stagectl.recording.metadata import portable
from stagectl.recording.ring import Ring
from stagectl.service.axis_status import Shown
from stagectl.service.file_in_use import FileInUse
from stagectl.service.job_from_stage import CALM, orders
from stagectl.service.planning import Motion, Task, Upload, check_time, leaving
from stagectl.service.planning import ServiceError as ServiceError
from stagectl.trajectories import Dwell, Experiment, SCurve
from stagectl.units import Quantity, UnitError, parse, quantities_of

_JERK_TIME = 0.02  # s in which a move's acceleration rises, unless a jerk is asked for
STARTING = "starting: the real-time process is not ready yet; nothing moves, orders are refused"
RESTARTING = (
    "restarting: the real-time process died and a new one is starting; the drive stops on its own time-outs, "
    "orders are refused"
)
BLACKBOX = 14.0  # s that the ring holds at least
COLUMNS = (*rollout.COLUMNS, "state")


class AbsentError(ServiceError):
    """What is asked for is not there."""


class Gains(NamedTuple):
    """A design, and the section of the stage file that it comes from."""

    control: design.Settings
    controller: design.Controller

    @property
    def order(self) -> Order:
        """What brings them in, without a jump of the current."""
        return Order(LAW, tuple(flattened(portable(self.controller.law))))


class AxisController:
    """The service's side of one axis."""

    def __init__(self, name: str, setup: Setup) -> None:
        self.name, self.setup = name, setup
        self.control = setup.file.control
        self.controller = setup.controller
        self._file = FileInUse(split(setup.path)[0])
        self._silence = STARTING  # the words of its state until the real-time process reports one
        self.begin()

    def begin(self) -> None:
        """New shared memory, for a new real-time process."""
        capacity = 1 << max(15, int(BLACKBOX / self.setup.dt).bit_length())
        self.ring, self.board = Ring.create(len(COLUMNS), capacity), Board.create()
        self.motion: Motion | None = None
        self._put, self._granted = 0, 0.0  # rows of the motion that are on the board, and that may be
        self._left: Start | None = None  # what the last motion left of the friction
        self._next_left: Start | None = None
        self._cold = 0.0  # periods until it first got power: from then on it warms up

    def renew(self) -> None:
        """New shared memory after a process died; the old one stays as long as somebody reads it."""
        for shared in (self.ring, self.board):
            os.close(shared.descriptor)
        self._silence = RESTARTING
        self.begin()

    def orders(self) -> Orders:
        """The job of the real-time process."""
        friction = self.controller.feedforward.with_friction
        return orders(self.name, self.setup, self.controller.law, friction, self.ring, self.board)

    @property
    def effort(self) -> float:
        """Effort at the largest current, less sliding friction and load (N m | N)."""
        p = self.setup.stage
        return p.drive.current_limit * p.motor.force_constant - stage.sliding(p.friction) - self.setup.load

    def pace(self, speed: float | None, acceleration: float | None) -> tuple[float, float]:
        """Speed and acceleration of a move (axis units): as requested, else what the current gives with ease.

        Raises ServiceError where the current does not carry the speed.
        """
        limits, p = self.setup.file.limits, self.setup.stage.mechanics
        if speed is None:
            speed = min(0.5 * limits.speed, 0.5 * self.effort / p.viscous if p.viscous else math.inf)
        left = self.effort - p.viscous * speed
        if left <= 0.0 and acceleration is None:
            scale, unit = self.setup.file.axis.travel_per_unit, self.setup.file.axis.travel_unit
            raise ServiceError(
                f"{self.name}: drive.current_limit carries the axis at no more than "
                f"{self.effort / p.viscous * scale:.3g} {unit}/s: take a lower speed"
            )
        return speed, min(limits.acceleration, CALM * left / p.inertia) if acceleration is None else acceleration

    @property
    def status(self) -> Status:
        """The axis now."""
        return self.board.status()

    @property
    def state(self) -> State:
        """Its state now."""
        return State(int(self.status.state))

    def refusal(self, event: Event) -> str:
        """Why the real-time process has just refused an order, by the state and the fault that it saw."""
        state, words = self.state, self.board.words
        if event is Event.MOVE and state is State.STANDING:
            return words
        why = why_not(event, state)
        return f"{why}. {words}" if words and state in (State.FAULT, State.OFFLINE) else why

    @property
    def shown(self) -> Shown:
        """What must be known to show its status."""
        axis = self.setup.file.axis
        return Shown(self.name, axis.travel_per_unit, axis.travel_unit, self._silence, self._file.changed())

    # motions

    def move(self, distance: float, speed: float | None, acceleration: float | None) -> Task:
        """The task to lay out a move by `distance` (m | rad of travel).  Raises ServiceError for one of 0."""
        scale = self.setup.file.axis.travel_per_unit
        if distance == 0.0:
            raise ServiceError(f"{self.name}: a move of 0; the distance must not be 0")
        pace = self.pace(
            None if speed is None else speed / scale, None if acceleration is None else acceleration / scale
        )
        velocity, slope = (value * scale for value in pace)
        curve = SCurve(distance, velocity, slope, slope / _JERK_TIME, 0.0, 1, True)
        check_time(self.name, self.setup, curve, (speed is not None, acceleration is not None))
        return self.task("move", curve)

    def task(self, name: str, trajectory: Experiment | Upload) -> Task:
        """The task to lay out a motion from where the axis stands; see `planning`."""
        feedforward = self.controller.feedforward
        start = Start(stops=relaxed(feedforward.friction)) if self._left is None else self._left
        clock = self.setup.dt * (self.status.cycles - self._cold)  # nobody knows for how long it moved before that
        start = self._standing(start)._replace(clock=clock)
        return Task(name, self._from_here(), feedforward, start, trajectory)

    def _standing(self, start: Start) -> Start:
        """`start` at the reference, and at what the encoder is held at."""
        now = self.status
        if not math.isfinite(now.reference):
            return start._replace(position=0.0, reading=None)
        return start._replace(position=now.reference, reading=now.target)

    def effects(self) -> dict[str, bool]:
        """The model's effects by dotted place: whether a current answers each; empty without the layer `effects`."""
        if not self.controller.feedforward.with_effects:
            return {}
        known = self.setup.stage
        answered = model_effects.places(model_effects.without(known, self.setup.file.control.unanswered))
        return {place: place in answered for place in model_effects.places(known)}

    def known(self, places: Sequence[str]) -> tuple[str, ...]:
        """The same `places`.  Raises ServiceError where one is not of an effect."""
        effects = self.effects()
        for place in places:
            if place not in effects:
                there = ", ".join(effects) or "none"
                raise ServiceError(f"{self.name}: no effect {place} that a current answers; there are: {there}")
        return tuple(places)

    def leave(self, places: Sequence[str]) -> None:
        """Leave these effects to the feedback from the next motion on.  Raises ServiceError."""
        self.setup = leaving(self.setup, self.known(places))

    def rehearsal(self) -> Task:
        """A task that takes what each motion of this axis takes, and goes nowhere."""
        return self.task("rehearsal", Dwell(_JERK_TIME))

    def _from_here(self) -> Setup:
        """The set-up with the travel that is left to both sides: a motion is laid out from where the axis stands.

        With the text of a file of one axis as it was read: refusals quote it, whatever has become of the file.
        """
        here, limits = self.status.reference, self.setup.file.limits
        several = split(self.setup.path)[1]  # a text is that of one axis
        setup = self.setup if several else self.setup._replace(text=self.setup.text or self._file.text)
        if not math.isfinite(here):
            return setup
        left = limits._replace(travel=(limits.travel[0] - here, limits.travel[1] - here))
        return setup.having(limits=left)

    def start(self, motion: Motion, together: int) -> Order:
        """Put the first rows on the board; the order that begins it, at once with those of `together` axes in all."""
        self.motion, self._put = motion, 0
        self._left, self._next_left = None, motion.left  # until the motion has come to its end
        first = self.board.filled
        self.fill(renewed=True)
        return Order(Event.MOVE, Move(float(first), float(motion.length), *motion.span, float(together)))

    def fill(self, renewed: bool = False) -> None:
        """Put further rows on the board: as far as there is room, and the motion was `renewed` for its dead man's time.

        The loop brakes where they run out.
        """
        motion = self.motion
        if motion is None or self._put >= motion.length:
            return
        done = min(int(self.status.row), self._put) if self.state is State.MOVING else 0
        if renewed:
            self._granted = done + motion.dead_man / self.setup.dt
        size = len(motion.rows) // motion.length
        end = max(int(min(done + AHEAD - 2, motion.length, self._granted)), self._put)  # a stopped one leaves its rows
        self.board.fill(motion.rows[self._put * size : end * size])
        self._put = end

    def powered(self) -> None:
        """The axis has got power."""
        self._cold = self._cold or self.status.cycles

    def finished(self, whole: bool) -> None:
        """The motion is over; after a whole one the friction state is that at the end of its plan."""
        self._left = self._next_left if whole else None
        self.motion = None

    # parameters

    def parameters(self) -> dict[str, float]:
        """The numbers of `control` that can be changed while it runs (SI)."""
        return {name: getattr(self.control, name) for name in self._changeable()}

    def written_parameters(self) -> dict[str, str]:
        """The same numbers with their units, angles in degrees, as a person writes them, and `changed` takes them."""
        lengths, values = Lengths(self.setup.file.axis.kind), self.parameters()
        return {
            name: worded(values[name], Annotated[float, q], lengths, "1 deg") for name, q in self._changeable().items()
        }

    def _changeable(self) -> dict[str, Quantity]:
        now, quantities = self.control, quantities_of(type(self.control))
        return {name: q for name, q in quantities.items() if name != "period" and isinstance(getattr(now, name), float)}

    def changed(self, values: dict[str, str]) -> Gains:
        """Other gains, designed but not yet in force.

        Raises ServiceError for a value that cannot be, DesignError where the loop would not have its margin.
        """
        control: Any = self.control
        known = self._changeable()
        for name, text in values.items():
            if name not in known:
                hint = meant(name, list(known), "these can:")
                raise ServiceError(f"control.{name} cannot be changed while the service runs: {hint}")
            quantity = known[name]
            unit = quantity.unit_for(self.setup.file.axis.kind)
            try:
                value = parse(text, unit)
            except UnitError as error:
                raise ServiceError(f"control.{name} = {text}: {error}; must be in {unit or 'no unit'}") from error
            if not quantity.admits(value):
                raise ServiceError(f"control.{name} = {text}; must lie in {quantity.interval} {unit}")
            control = control._replace(**{name: value})
        return Gains(control, design.design(self.setup.stage, control))

    def lenient(self) -> str:
        """A note where the margin that gains must keep is below the stage file's; empty otherwise."""
        now, asked = self.control.margin, self.setup.file.control.margin
        if now >= asked:
            return ""
        words = f"margin {math.degrees(now):.3g} deg; the stage file asks for {math.degrees(asked):.3g} deg"
        return f"{words}: gains with less than that are accepted now"

    def adopt(self, gains: Gains) -> None:
        """Make `gains` the present ones: the real-time process has taken them."""
        self.control, self.controller = gains
