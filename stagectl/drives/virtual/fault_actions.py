"""Faults of the virtual drive: how each is caused and undone, which are waiting and which are active."""

import collections
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

from stagectl.drives.bus import faulty_bus
from stagectl.drives.bus.faulty_bus import FRAME_FAULTS, FaultyBus, Rule, Undo, added, frame_rule
from stagectl.drives.canopen import cia402
from stagectl.drives.clock import SkewedClock
from stagectl.drives.limits import JUMP_PERIOD, STORM_PERIOD
from stagectl.drives.virtual import sensor
from stagectl.drives.virtual.object_dictionary import Objects
from stagectl.drives.virtual.power_stage import PowerStage
from stagectl.drives.virtual.sensor import Distortion

_ENCODER, _RECOVERED = 0x7305, 0x8140  # emergency error codes


def _nothing() -> None:
    """Undo of a fault that ends by itself."""


@dataclass
class _Periodic:
    action: Callable[[], None]
    period: float  # s
    due: float  # s


def _in_turn(*steps: Undo) -> Undo:
    """Undo in several steps."""

    def undo() -> None:
        for step in steps:
            step()

    return undo


class PeriodicActions:
    """What a fault does periodically."""

    def __init__(self) -> None:
        self._entries: list[_Periodic] = []

    def every(self, period: float, now: float, action: Callable[[], None]) -> Undo:
        """Do it now, and again each `period` (s) unless that is 0."""
        action()
        return added(self._entries, _Periodic(action, period, now + period)) if period > 0.0 else _nothing

    def look(self, now: float) -> None:
        """Do what is due at `now` (s)."""
        for entry in tuple(self._entries):
            if entry.due <= now:
                entry.due = now + entry.period
                entry.action()


class DriveParts(NamedTuple):
    """The parts of a virtual drive that can fail."""

    bus: FaultyBus
    axis: PowerStage
    objects: Objects
    clock: SkewedClock
    trip: Callable[[int], None]  # an error inside the drive, by its code
    boot: Callable[[], None]  # as after power-on, the machine staying where it is
    repeats: PeriodicActions


_Action = Callable[[DriveParts, Any, float], Undo]


def _cut_off(m: DriveParts) -> Undo:
    return m.bus.add(Rule("both", frozenset(), faulty_bus.lose(1.0, m.bus.random)))


def _bus_off(m: DriveParts, p: Any, now: float) -> Undo:
    return _in_turn(_cut_off(m), lambda: m.objects.error(_RECOVERED, cia402.COMMUNICATION_ERROR))


def _power_off(m: DriveParts, p: Any, now: float) -> Undo:
    undo = _cut_off(m)
    m.axis.power_cycled()
    return _in_turn(undo, m.boot)


def _reboot(m: DriveParts, p: Any, now: float) -> Undo:
    m.axis.power_cycled()
    m.boot()
    return _nothing


def _encoder(make: Callable[[DriveParts, Any], Distortion]) -> _Action:
    return lambda m, p, now: m.axis.sensor.distort(make(m, p))


def _encoder_off(m: DriveParts, p: Any, now: float) -> Undo:
    undo = m.axis.sensor.distort(_stuck(m, p))
    m.trip(_ENCODER)
    return undo


def _stuck(m: DriveParts, p: Any) -> Distortion:
    counts = m.axis.sensor.counts
    return Distortion(lambda _: counts, lambda _: 0.0)


def _jumping(m: DriveParts, p: Any, now: float) -> Undo:
    sign = [0]

    def flip() -> None:
        sign[0] = 1 - sign[0]

    stop = m.repeats.every(p.every or JUMP_PERIOD, now, flip)
    undo = m.axis.sensor.distort(Distortion(lambda counts: counts + sign[0] * p.counts, lambda v: v))
    return _in_turn(stop, undo)


def _noise(m: DriveParts, p: Any) -> Distortion:
    chance, step, dt = m.bus.random, m.axis.plant.p.encoder.step, m.axis.plant.dt
    return Distortion(
        lambda _: chance.randrange(-(2**31), 2**31), lambda _: chance.uniform(-1.0, 1.0) * 2**31 * step / dt
    )


def _scaled(m: DriveParts, p: Any) -> Distortion:
    origin = m.axis.sensor.counts
    return Distortion(lambda counts: origin + round(p.factor * (counts - origin)), lambda v: p.factor * v)


def _late_encoder(m: DriveParts, p: Any) -> Distortion:
    clock, line = m.clock, collections.deque[tuple[float, int]]()

    def counts(now: int) -> int:
        line.append((clock.now(), now))
        while len(line) > 1 and line[1][0] <= clock.now() - p.delay:
            line.popleft()
        return line[0][1]

    return Distortion(counts, lambda velocity: velocity)


def _current(make: Callable[[DriveParts, Any], Callable[[float], float]]) -> _Action:
    return lambda m, p, now: m.axis.distort(make(m, p))


def _tripped(m: DriveParts, p: Any, now: float) -> Undo:
    m.trip(p.code)
    return _nothing


def _emergency(least: float) -> _Action:
    def done(m: DriveParts, p: Any, now: float) -> Undo:
        error = m.objects.error
        return m.repeats.every(p.every or least, now, lambda: error(p.code, cia402.GENERIC_ERROR))

    return done


def _statusword(m: DriveParts, p: Any, now: float) -> Undo:
    getters, key = m.objects.getters, cia402.STATUSWORD << 8
    true, getters[key] = getters[key], lambda: m.bus.random.getrandbits(16)
    m.objects.changed = True  # the cyclic path is compiled from them

    def undo() -> None:
        getters[key] = true
        m.objects.changed = True

    return undo


def _skewed(m: DriveParts, p: Any, now: float) -> Undo:
    m.clock.run_at(p.rate)
    return lambda: m.clock.run_at(1.0)


ACTIONS: dict[str, _Action] = dict.fromkeys(FRAME_FAULTS, lambda m, p, now: m.bus.add(frame_rule(p, m.bus))) | {
    "bus-off": _bus_off,
    "encoder-off": _encoder_off,
    "encoder-stuck": _encoder(_stuck),
    "encoder-jump": _encoder(lambda m, p: Distortion(lambda counts: counts + p.counts, lambda velocity: velocity)),
    "encoder-jumping": _jumping,
    "encoder-garbage": _encoder(_noise),
    "encoder-reversed": _encoder(_scaled),
    "encoder-late": _encoder(_late_encoder),
    "drive-fault": _tripped,
    "emergency": _emergency(0.0),
    "emergency-storm": _emergency(STORM_PERIOD),
    "drive-disabled": lambda m, p, now: m.axis.open_sto(),
    "power-off": _power_off,
    "current-off": _current(lambda m, p: lambda _: 0.0),
    "current-stuck": _current(lambda m, p: sensor.held()),
    "current-reversed": _current(lambda m, p: lambda current: p.factor * current),
    "current-weak": _current(lambda m, p: lambda current: p.factor * current),
    "current-late": _current(lambda m, p: sensor.late(max(1, round(p.delay / m.axis.plant.dt)))),
    "node-reboot": _reboot,
    "statusword-garbage": _statusword,
    "clock-skewed": _skewed,
}


class _Acting(NamedTuple):
    block: Any
    until: float  # s; 0: for good
    undo: Undo


class FaultSchedule:
    """The faults of one virtual drive."""

    def __init__(self, machine: DriveParts, report: Callable[[str], None]) -> None:
        """`report` takes one line for each fault that begins or ends."""
        self._machine, self._report = machine, report
        self._standing: tuple[Any, ...] = ()
        self._waiting: list[tuple[float, Any]] = []
        self._acting: list[_Acting] = []
        self._enabled = False

    def standing(self, blocks: Iterable[Any]) -> None:
        """Faults that begin so long after each time that Operation enabled is reached from a reset."""
        self._standing = tuple(blocks)
        self._enabled = False

    def add(self, block: Any, now: float) -> None:
        """A fault that begins so long after `now` (s)."""
        self._waiting.append((now + block.after, block))
        self.look(now)

    def begin(self, block: Any, now: float) -> None:
        """A fault that begins now, whatever its `after`."""
        self._report(f"fault begins: {block.fault}")
        undo = ACTIONS[block.fault](self._machine, block, now)
        self._acting.append(_Acting(block, now + block.duration if block.duration else 0.0, undo))

    def clear(self) -> None:
        """Undo all that acts, forget all that waits."""
        self._waiting.clear()
        self._end(lambda _: True)

    def renew(self) -> None:
        """As after power-on: the standing faults wait for Operation enabled again; others stay as they are."""
        self._enabled = False
        self._waiting = [(at, block) for at, block in self._waiting if block not in self._standing]
        self._end(lambda acting: acting.block in self._standing)

    @property
    def active(self) -> list[str]:
        """Names of the faults that act."""
        return [acting.block.fault for acting in self._acting]

    def look(self, now: float) -> None:
        """Begin and end what is due at `now` (s)."""
        if self._standing and not self._enabled and self._machine.axis.state is cia402.DriveState.OPERATION_ENABLED:
            self._enabled = True
            self._waiting += [(now + block.after, block) for block in self._standing]
        if not (self._waiting or self._acting):
            return
        self._end(lambda acting: 0.0 < acting.until <= now)
        due = [block for at, block in self._waiting if at <= now]
        self._waiting = [(at, block) for at, block in self._waiting if at > now]
        for block in due:
            self.begin(block, now)
        self._machine.repeats.look(now)

    def _end(self, over: Callable[[_Acting], bool]) -> None:
        """Undo the faults that are `over`, the oldest first."""
        ending = [acting for acting in self._acting if over(acting)]
        self._acting = [acting for acting in self._acting if acting not in ending]
        for acting in ending:
            acting.undo()
            self._report(f"fault is over: {acting.block.fault}")
