"""The self-test of a drive that is known by its bus alone: a real one, at a low current and over a short way.

::

    loop --> CanopenDrive --> FaultyBus: the rules of the fault --> Listening --> bus --> drive
                                                                     hears the position beneath all rules, and asks
                                                                     for it with SYNC where the loop does no more

Only what can be provoked from our end of the bus is tried; nothing that makes the drive do what nobody asked for.
"""

import collections
import math
from collections.abc import Callable
from typing import Any, NamedTuple

from stagectl.config.fault_words import check_fault
from stagectl.config.stage_file import Setup
from stagectl.drives import faults
from stagectl.drives.bus import faulty_bus
from stagectl.drives.bus.faulty_bus import FaultyBus, Way
from stagectl.drives.bus.frames import SYNC, Bus, frame
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.network import load_eds
from stagectl.drives.canopen.pdo import FeedbackPdo
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen
from stagectl.drives.limits import STANDING
from stagectl.kernels import stage
from stagectl.realtime.states import State
from stagectl.selftest.limits import LONGEST
from stagectl.selftest.matrix import UNSEEN, Bench, virtual
from stagectl.selftest.rig import AxisSample, BaseRig, Pace, RigLoop, Service, laid_out
from stagectl.service.virtual_timeouts import unhurried
from stagectl.units import StageError

STATES = (State.CONNECTING, State.ENABLING, State.STANDING, State.MOVING, State.QUICK_STOPPING)
_SYNC = frame(SYNC)
_SPAN = 0.01  # s over which a speed is taken; longer where the encoder's step is coarse
_QUEUE = 1000  # frames that wait for the loop
_SEES = 0.2  # s in which the end of a case is looked at
# Of what the current leaves: for viscous friction, to accelerate; and for friction.
_SPEED, _FORCE, _FRICTION = 0.3, 0.5, 0.7
# Seen from our end of the bus what the drive receives goes out; what is late is late on its way to us.
_WAYS: dict[Way, Way] = {"in": "out", "out": "in", "both": "both"}
_DANGEROUS = ("frames-reordered", "command-corrupted", "feedback-corrupted", "bus-flooded", "sdo-abort")
PROVOCABLE = (
    *(name for name in faulty_bus.FRAME_FAULTS if name not in _DANGEROUS),
    "node-reboot",
    "loop-stalled",
    "controller-dead",
    "interface-down",
)
_UNASKED = ("cable-out", "interface-down", "controller-dead")  # nobody else sends SYNC then


class Gentle(NamedTuple):
    """What a real axis is moved with."""

    current: float  # A, the most that the law may ask for
    travel: float  # rad | m, of one move


class Listening:
    """The bus beneath all rules."""

    def __init__(self, bus: Bus, now: Callable[[], float], setup: Setup, wire: Canopen) -> None:
        self._bus, self._now, self._dt, self._step = bus, now, setup.dt, setup.stage.encoder.step
        self._answer = FeedbackPdo(wire, load_eds(wire.eds, wire.node))
        slow = wire.quick_stop_deceleration * STANDING
        self._span, self._synced = max(_SPAN, 4.0 * self._step / slow), -math.inf
        self._window: collections.deque[tuple[float, float]] = collections.deque()
        self.inbox: collections.deque[bytes] = collections.deque(maxlen=_QUEUE)
        self.trace: list[AxisSample] = []
        self.down = self.asking = False

    def send(self, raw: bytes) -> None:
        """Send a frame of the loop's.  Raises OSError where its interface is down."""
        if self.down:
            raise OSError(100, "Network is down")
        self.put(raw)

    def put(self, raw: bytes) -> None:
        """Send a frame."""
        if raw[:4] == _SYNC[:4]:
            self._synced = self._now()
        self._bus.send(raw)

    def receive(self, timeout: float) -> bytes | None:
        """The loop's next frame, or None.  Raises OSError where its interface is down."""
        if self.down:
            raise OSError(100, "Network is down")
        deadline = self._now() + timeout
        while not self.inbox:
            left = deadline - self._now()
            self.hear(max(left, 0.0))
            if left <= 0.0:
                break
        return self.inbox.popleft() if self.inbox else None

    def hear(self, timeout: float) -> None:
        """Let one frame come in, and note what it says of the axis."""
        now = self._now()
        if self.asking and now - self._synced >= 2.0 * self._dt:
            self.put(_SYNC)
        raw = self._bus.receive(min(timeout, self._dt))
        if raw is not None:
            self.inbox.append(raw)
            if raw[:5] == self._answer.head:
                self._see(raw)

    def close(self) -> None:
        """It stays open for the next case."""

    def _see(self, raw: bytes) -> None:
        statusword, counts, _ = self._answer.decode(raw)
        now, position, window = self._now(), counts * self._step, self._window
        if window and now - window[-1][0] > UNSEEN:  # what it did meanwhile says nothing of its speed now
            window.clear()
        window.append((now, position))
        while len(window) > 2 and now - window[1][0] >= self._span:
            window.popleft()
        before, start = window[0]
        speed = (position - start) / (now - before) if now > before else 0.0
        self.trace.append(AxisSample(now, position, speed, cia402.state(statusword) in cia402.POWERED))


class Attentive:
    """A clock whose waits hear the bus."""

    def __init__(self, clock: Clock, listening: Listening) -> None:
        self.now, self._listening = clock.now, listening

    def sleep(self, seconds: float) -> None:
        """Let so much time go by."""
        end = self.now() + seconds
        while (left := end - self.now()) > 0.0:
            self._listening.hear(left)


class Remote(BaseRig):
    """One case on the drive at the other end of a bus."""

    def __init__(self, setup: Setup, bus: Bus, clock: Clock) -> None:
        wire = setup.canopen
        self._listening = Listening(bus, clock.now, setup, wire)
        super().__init__(setup, Attentive(clock, self._listening))
        self.bus = self._faulty = FaultyBus(self._listening, clock.now, setup.file.simulation.seed)
        self.trace = self._listening.trace
        self._look()
        if not self.trace:
            raise StageError(f"node {wire.node} answers no SYNC with its position: see `stagectl doctor`")
        del self.trace[:-1]

    def begin(self, block: Any) -> None:
        """The fault of this block, from our end."""
        name = block.fault
        self._listening.asking = name in _UNASKED
        if name == "node-reboot":
            self._listening.put(frame(0, bytes([cia402.NMT_RESETS["node"], self.settings.node])))
            return
        way: Way = "in" if name == "frames-delayed" else _WAYS[faulty_bus.FRAME_FAULTS[name][0]]
        self._faulty.add(faulty_bus.frame_rule(block, self._faulty, way))

    def cut_off(self) -> None:
        """The controller's own interface fails."""
        self._listening.down = self._listening.asking = True

    def left_alone(self) -> None:
        """The controller is dead; only we still look."""
        self._listening.asking = True

    def let_go(self, loop: RigLoop) -> None:
        """The end of a case: a real axis is stopped where it still moves, and its drive is left."""
        while not loop.abandon():
            loop.period()
        loop.leave()

    def settle(self) -> None:
        """Clear the fault, and look where the axis is now: it has no power any more."""
        self.bus = self._faulty = FaultyBus(self._listening, self.time.now, 0)
        self._listening.down, self._listening.asking = False, True
        self._listening.put(frame(0, bytes([cia402.NMT_START, self.settings.node])))
        self.time.sleep(_SEES)
        self._listening.put(frame(0, bytes([cia402.NMT_PRE_OPERATIONAL, self.settings.node])))

    @property
    def seen(self) -> AxisSample:
        """The axis when it was last heard."""
        last = self.trace[-1]
        return last._replace(time=max(last.time, self.time.now())) if not self._listening.asking else last

    def _look(self) -> None:
        """Where the axis stands before the case."""
        drive = self.connect()
        for _ in range(round(_SEES / self.setup.dt)):
            drive.sample()
            drive.apply(0.0)
            self.time.sleep(self.setup.dt)
        drive.close()


def bench(setup: Setup, only: list[str] | None, gentle: Gentle | None) -> Bench:
    """What is tried: all faults or `only` some, on the virtual drive, or on the real one at a low current.

    Raises StageError where there is no such fault, and where the drive must not or cannot be moved so.
    """
    for name in only or ():
        check_fault(name, "--only")
    chosen = frozenset(only or ())
    return virtual(setup, chosen) if gentle is None else real(setup, gentle, chosen)


def real(setup: Setup, gentle: Gentle, only: frozenset[str], bus: Bus | None = None, clock: Clock = WALL) -> Bench:
    """The bench of a real drive, on its own bus.  Raises StageError where it cannot be moved so."""
    strange = sorted(only - set(PROVOCABLE))
    if strange:
        raise StageError(
            f"--only {strange[0]}: a real drive is only tried with what comes from the controller's end of the bus: "
            + ", ".join(PROVOCABLE)
        )
    setup = weakened(unhurried(setup), gentle.current)
    wire, pace = setup.canopen, pace_of(setup, gentle)
    there, back = laid_out(setup, pace), laid_out(setup, pace._replace(distance=-pace.distance))
    bus, home = bus or open_bus(wire.interface, wire.channel, wire.bitrate), list[float]()

    def rig() -> tuple[BaseRig, Service]:
        """The drive, and the way back where it has been moved: so that the cases do not walk away."""
        found = Remote(setup, bus, clock)
        home[:] = home or [found.seen.position]
        return found, back if found.seen.position > home[0] else there

    rows = tuple(row for row in faults.TABLE if row.name in (only or PROVOCABLE))
    mode = f"drive {wire.node} on {wire.interface} {wire.channel}, at most {gentle.current:g} A"
    return Bench(rig, rows, STATES, pace.speed, mode)


def weakened(setup: Setup, current: float) -> Setup:
    """The stage with a law that asks for no more than this current (A)."""
    drive, model = setup.file.drive, setup.stage.drive
    if not 0.0 < current <= drive.current_limit:
        raise StageError(f"--current {current:g} A; must lie in (0, {drive.current_limit:g}] A, drive.current_limit")
    weak = setup._replace(stage=setup.stage._replace(drive=model._replace(current_limit=current)))
    return weak.having(drive=drive._replace(current_limit=current))


def pace_of(setup: Setup, gentle: Gentle) -> Pace:
    """A motion that the current carries with ease."""
    p, limits = setup.stage, setup.file.limits
    all_of_it, friction = gentle.current * p.motor.force_constant, stage.sliding(p.friction) + setup.load
    left = all_of_it - friction
    if friction > _FRICTION * all_of_it:
        least = friction / _FRICTION / p.motor.force_constant
        raise StageError(
            f"--current {gentle.current:g} A does not carry the friction of this stage; must be at least {least:.3g} A"
        )
    viscous = p.mechanics.viscous
    acceleration = min(_FORCE * left / p.mechanics.inertia, limits.acceleration)
    slow = abs(gentle.travel) / LONGEST  # a motion must last until the last fault is noticed
    speed = min(_SPEED * left / viscous if viscous else math.inf, 0.1 * limits.speed, slow)
    return Pace(gentle.travel, min(speed, math.sqrt(acceleration * abs(gentle.travel) / 2.0)), acceleration)
