"""A bus whose frames are lost, doubled, reordered, corrupted or delayed by rules; without rules it changes nothing."""

import heapq
import itertools
import random
from collections.abc import Callable, Iterator
from typing import Any, Literal, NamedTuple, TypeVar

from stagectl.drives.bus.frames import EMERGENCY, HEARTBEAT, SDO_ANSWER, SDO_REQUEST, SYNC, TPDO, Bus, frame, parse
from stagectl.drives.limits import BABBLE_FRAMES

Undo = Callable[[], None]
_T = TypeVar("_T")
Timed = tuple[float, bytes]  # when it goes on (s), the frame
Act = Callable[[float, bytes], list[Timed]]
Way = Literal["in", "out", "both"]
_ABORT = bytes.fromhex("00000008")  # 0x0800_0000, general error


def added(entries: list[_T], entry: _T) -> Undo:
    """Append `entry`; the function that takes it out again."""
    entries.append(entry)

    def undo() -> None:
        entries[:] = [other for other in entries if other is not entry]

    return undo


def kind(identifier: int) -> str:
    """What a frame is for, by CiA 301's predefined connection set."""
    if identifier == SYNC:
        return "sync"
    if identifier < TPDO:
        return "emcy" if identifier > EMERGENCY else "nmt"
    if identifier < SDO_ANSWER:
        return "tpdo" if identifier & 0x080 else "rpdo"
    names = {SDO_ANSWER: "sdo answer", SDO_REQUEST: "sdo request", HEARTBEAT: "heartbeat"}
    return names.get(identifier & 0x780, "other")


class Rule(NamedTuple):
    """What happens to which frames."""

    way: Way
    kinds: frozenset[str]  # empty: all
    act: Act


class FaultyBus:
    """A bus behind rules; `in` is what is received through it."""

    def __init__(self, bus: Bus, now: Callable[[], float], seed: int) -> None:
        """`now` (s) is the time in which frames are held up; `seed` that of all chance."""
        self._bus, self._now = bus, now
        self.random = random.Random(seed)
        self._rules: list[Rule] = []
        self._held: dict[str, list[tuple[float, int, bytes]]] = {"in": [], "out": []}
        self._serial = itertools.count()

    def add(self, rule: Rule) -> Undo:
        """Act by `rule` until the returned function is called; later rules see what earlier ones let through."""
        return added(self._rules, rule)

    def send(self, frame: bytes) -> None:
        """Send what the rules let through."""
        if not self._rules and not self._held["out"]:
            self._bus.send(frame)
            return
        self._hold("out", frame)
        self._release()

    def receive(self, timeout: float) -> bytes | None:
        """Next frame that the rules let through, or None."""
        if not self._rules and not self._held["in"] and not self._held["out"]:
            return self._bus.receive(timeout)
        deadline = self._now() + timeout
        while True:
            self._release()
            if (raw := self._due("in")) is not None:
                return raw
            taken = self._bus.receive(max(self._next(deadline) - self._now(), 0.0))
            if taken is not None:
                self._hold("in", taken)
            elif self._now() >= deadline or timeout <= 0.0:
                return self._due("in")
            elif self._next(deadline) > self._now():
                return None  # a bus of another clock waits no longer than this

    def close(self) -> None:
        """Close the underlying bus."""
        self._bus.close()

    def answer(self, raw: bytes) -> None:
        """Send a frame past all rules."""
        self._bus.send(raw)

    def _hold(self, way: str, raw: bytes) -> None:
        now = self._now()
        purpose, frames = kind(int.from_bytes(raw[:4], "little") & 0x7FF), [(now, raw)]
        for rule in self._rules:
            if rule.way in (way, "both") and (not rule.kinds or purpose in rule.kinds):
                frames = [passed for timed in frames for passed in rule.act(*timed)]
        for at, passed_raw in frames:
            heapq.heappush(self._held[way], (at, next(self._serial), passed_raw))

    def _due(self, way: str) -> bytes | None:
        held = self._held[way]
        return heapq.heappop(held)[2] if held and held[0][0] <= self._now() else None

    def _release(self) -> None:
        while (raw := self._due("out")) is not None:
            self._bus.send(raw)

    def _next(self, deadline: float) -> float:
        return min([deadline, *(held[0][0] for held in self._held.values() if held)])


FrameAct = Callable[[Any, FaultyBus], Act]  # (parameters of the fault, bus)


def lose(share: float, chance: random.Random) -> Act:
    """Lose a `share` of the frames."""
    return lambda at, raw: [] if chance.random() < share else [(at, raw)]


def double(share: float, chance: random.Random) -> Act:
    """Let a `share` of the frames pass twice."""
    return lambda at, raw: [(at, raw)] * (1 + (chance.random() < share))


def delay(seconds: float) -> Act:
    """Hold all frames up."""
    return lambda at, raw: [(at + seconds, raw)]


def swap(share: float, chance: random.Random) -> Act:
    """Let a `share` of the frames wait for the next one to overtake."""
    waiting: list[bytes] = []

    def act(at: float, raw: bytes) -> list[Timed]:
        if waiting:
            return [(at, raw), (at, waiting.pop())]
        if chance.random() < share:
            waiting.append(raw)
            return []
        return [(at, raw)]

    return act


def flip(share: float, chance: random.Random) -> Act:
    """Flip one to four bits of the data of a `share` of the frames."""

    def act(at: float, raw: bytes) -> list[Timed]:
        length = min(raw[4], 8)
        if not length or chance.random() >= share:
            return [(at, raw)]
        corrupted = bytearray(raw)
        for _ in range(chance.randint(1, 4)):
            corrupted[8 + chance.randrange(length)] ^= 1 << chance.randrange(8)
        return [(at, bytes(corrupted))]

    return act


def freeze() -> Act:
    """Repeat the first frame of each identifier."""
    first: dict[bytes, bytes] = {}
    return lambda at, raw: [(at, first.setdefault(raw[:4], raw))]


def shorten(share: float, chance: random.Random) -> Act:
    """Cut the last byte off a `share` of the frames."""

    def act(at: float, raw: bytes) -> list[Timed]:
        identifier, data = parse(raw)
        return [(at, frame(identifier, data[:-1]) if chance.random() < share else raw)]

    return act


def babble(share: float, chance: random.Random) -> Act:
    """Put frames of a strange node before a `share` of the frames."""

    def strange() -> Iterator[bytes]:
        for _ in range(BABBLE_FRAMES):
            yield frame(chance.randrange(0x780, 0x7E0), chance.randbytes(chance.randint(0, 8)))

    return lambda at, raw: [*((at, other) for other in strange() if chance.random() < share), (at, raw)]


def refuse(bus: FaultyBus) -> Act:
    """Answer each SDO request with an abort."""

    def act(at: float, raw: bytes) -> list[Timed]:
        identifier, data = parse(raw)
        if len(data) == 8 and data[0] & 0xE0 != 0x80:  # an abort is not answered
            bus.answer(frame(identifier - 0x80, b"\x80" + data[1:4] + _ABORT))
        return []

    return act


def _share(act: Callable[[float, random.Random], Act]) -> FrameAct:
    return lambda p, bus: act(p.share, bus.random)


# Faults of frames: their way as the drive sees it, their kinds (empty: all), and what befalls them.
FRAME_FAULTS: dict[str, tuple[Way, tuple[str, ...], FrameAct]] = {
    "cable-out": ("both", (), _share(lose)),
    "frames-lost": ("both", (), _share(lose)),
    "sync-lost": ("in", ("sync",), _share(lose)),
    "command-lost": ("in", ("rpdo",), _share(lose)),
    "feedback-lost": ("out", ("tpdo",), _share(lose)),
    "controller-heartbeat-lost": ("in", ("heartbeat",), _share(lose)),
    "drive-heartbeat-lost": ("out", ("heartbeat",), _share(lose)),
    "frames-duplicated": ("both", (), _share(double)),
    "frames-reordered": ("both", (), _share(swap)),
    "command-corrupted": ("in", ("rpdo",), _share(flip)),
    "feedback-corrupted": ("out", ("tpdo",), _share(flip)),
    "frames-delayed": ("both", (), lambda p, bus: delay(p.delay)),
    "bus-flooded": ("out", (), _share(babble)),
    "feedback-short": ("out", ("tpdo",), _share(shorten)),
    "node-stuck": ("out", ("tpdo",), lambda p, bus: freeze()),
    "sdo-abort": ("in", ("sdo request",), lambda p, bus: refuse(bus)),
    "sdo-silent": ("in", ("sdo request",), lambda p, bus: lose(1.0, bus.random)),
}


def frame_rule(block: Any, bus: FaultyBus, way: Way | None = None) -> Rule:
    """The rule of a fault of FRAME_FAULTS on `bus`; `way`: another than the drive's."""
    ours, kinds, act = FRAME_FAULTS[block.fault]
    return Rule(way or ours, frozenset(kinds), act(block, bus))
