"""A foreign drive: plant, state machine, process data and monitors put together, one frame and one tick at a time."""

from __future__ import annotations

import math
from collections.abc import Callable

from tests.zoo import display
from tests.zoo.diary import SAMPLE
from tests.zoo.display import CST, OPERATIONAL, PERMILLE, PRE_OPERATIONAL
from tests.zoo.events import happen
from tests.zoo.homing import HM, Homing
from tests.zoo.memory import Memory
from tests.zoo.monitors import EMERGENCIES, Monitors
from tests.zoo.pdos import Answers, Pdo
from tests.zoo.plant import FORCE_CONSTANT, METRES_PER_RAD, PEAK_CURRENT, Plant, ramp_torque
from tests.zoo.power import POWERED, RAMPS, Power, State
from tests.zoo.variants import Variant

_PROFILE_POSITION, _LEFT_OVER = 1, 300.0  # mode and torque (per mille) of a drive that somebody left enabled
_AMPERES = {0x607100: PERMILLE, 0x234000: 0.001}  # of one count of a command
_AT_REST = 0.05  # rad/s: the ramp is over
_INHIBIT = 1e-4  # s, unit of the inhibit time
_EVENT = 0.02  # s between TPDOs that are sent by event


class Drive:
    """All of it but the bus: `send` takes a COB-ID and data."""

    def __init__(self, variant: Variant, memory: Memory, send: Callable[[int, bytes], None], note: Callable[..., None]):
        """Booted, in Pre-operational."""
        self.variant, self.memory, self.send, self.note = variant, memory, send, note
        self.plant = Plant(variant.gravity)
        self.monitors = Monitors(memory.number)
        number = memory.number
        self.rpdos = [Pdo(number, 0x1400, 0x1600), Pdo(number, 0x1401, 0x1601)]
        self.tpdos = [Pdo(number, 0x1800, 0x1A00), Pdo(number, 0x1801, 0x1A01)]
        memory.written = self._written
        self.now = self._sampled = 0.0
        self._moved_from: float | None = None
        self._active_before = True
        self.event_over = False
        self.nmt = PRE_OPERATIONAL
        self.forget()
        if variant.fault_at_start:
            self.trip(variant.fault_at_start, reaction=0)
        self.power.cause = variant.fault_stays
        if variant.starts_enabled:
            self.mode, self.target, self.power.state = _PROFILE_POSITION, _LEFT_OVER, State.OPERATION_ENABLED

    def boot(self) -> None:
        """Begin anew, without power; the mechanics coast on."""
        if self.power.state in POWERED:
            self.power.to(State.SWITCH_ON_DISABLED, "boot")
        self.memory.forget()
        self.forget()

    def nmt_state(self, state: int) -> None:
        """An NMT command; leaving Operational under power is a lost connection (CiA 402, 0x6007)."""
        left = self.nmt == OPERATIONAL and state != OPERATIONAL
        self.nmt = state
        if left and self.power.state in POWERED:
            self.lose("NMT")

    def forget(self) -> None:
        """What a boot leaves: no power, no orders."""
        self.power = Power(self.note, self.variant.reset_hold, self.variant.transition_time)
        self.mode, self.target = 0, 0.0
        self.nmt = OPERATIONAL if self.variant.starts_operational else PRE_OPERATIONAL
        self.mode_since = self._sent = 0.0  # times: of the last mode, of the last TPDO
        self.storms = False
        self.pending: list[dict[int, bytes]] = []  # commands that wait for SYNC
        self.answers = Answers(self.variant.tpdo_age)
        self.wants_boot = self.deaf = False  # an event wants a boot; commands have no effect
        self.missing_bits = self.variant.missing_bits  # of the statusword; an event takes more
        self._toggle = 0
        self.homing, self._starts = Homing(self.variant.homing, self.memory.number), False
        self.monitors.forget()
        self._configure()

    def _configure(self) -> None:
        for pdo in (*self.rpdos, *self.tpdos):
            pdo.configure()

    def _written(self, key: int, data: bytes) -> None:
        """An object has been written by SDO, or came in an RPDO."""
        if 0x1400 <= key >> 8 <= 0x1AFF:
            self._configure()
        elif key == 0x604000:
            self.power.may_enable = not self.variant.needs_interpolation or self.memory.number(0x60C201) != 0
            self.power.order(int.from_bytes(data, "little"), self.now)
            self._order_homing(bool(data[0] & 0x10))
        elif key == 0x606000 and not (self.enabled and self.homing.kind == "stubborn"):
            self.mode, self.mode_since = int.from_bytes(data, "little", signed=True), self.now
        elif key in _AMPERES:
            self.target = int.from_bytes(data, "little", signed=True) * _AMPERES[key] / PERMILLE

    @property
    def enabled(self) -> bool:
        """Whether commands have power."""
        return self.power.state is State.OPERATION_ENABLED

    def _order_homing(self, start: bool) -> None:
        if start is not self._starts and self.mode == HM and self.enabled:
            self.homing.order(start)
        self._starts = start

    # ------------------------------------------------------------------ the bus

    def sync(self) -> None:
        """SYNC: sample and send, then act on what has come since the last one."""
        if self.nmt != OPERATIONAL:
            return
        self.show()
        first, second = (pdo.due() for pdo in self.tpdos)
        if first and self.now - self._sent >= self.memory.number(0x180003) * _INHIBIT:
            self._sent = self.now
            self._answer()
        if second or (self.variant.extra_pdos and self.tpdos[1].valid):
            self.send(self.tpdos[1].cob_id, self.tpdos[1].packed(self.memory.raw))
        for values in self.pending:
            self._take(values)
        self.pending = []

    def _answer(self) -> None:
        if (data := self.answers.next(self.tpdos[0].packed(self.memory.raw))) is not None:
            self.send(self.tpdos[0].cob_id, data)

    def _send_by_event(self) -> None:
        """TPDO 1 before it is given to SYNC."""
        tpdo = self.tpdos[0]
        due = self.variant.starts_operational and tpdo.valid and not tpdo.synchronous and self.now - self._sent > _EVENT
        if due and self.nmt == OPERATIONAL:
            self._sent = self.now
            self.show()
            self._answer()

    def process_data(self, cob_id: int, data: bytes) -> None:
        """An RPDO, if it is one of ours."""
        for place, pdo in enumerate(self.rpdos):
            if self.nmt != OPERATIONAL or not pdo.valid or pdo.cob_id != cob_id:
                continue
            if len(data) < pdo.length:
                self.emergency(0x8210)
                return
            if place == 0:
                self.monitors.command(self.now)
            values = pdo.unpacked(data)
            if pdo.synchronous:
                self.pending = [*self.pending[-3:], values]
            else:
                self._take(values)

    def _take(self, values: dict[int, bytes]) -> None:
        for key, data in sorted(values.items(), reverse=True):  # the torque before the controlword that may enable it
            self._written(key, data)

    def emergency(self, code: int) -> None:
        """An EMCY frame."""
        self.memory.live |= {0x603F00: code, 0x100100: 1 if code else 0}
        self.note("emergency", code=f"0x{code:04X}")
        self.send(0x80 + self.memory.number_of_node, code.to_bytes(2, "little") + bytes([1 if code else 0]) + bytes(5))

    # ------------------------------------------------------------------ time

    def tick(self, now: float) -> None:
        """Move the plant on to `now`, look at the monitors, and note a sample."""
        if self.power.state in RAMPS:
            self.plant.advance(now, 0.0, ramp_torque(self.memory.number(0x608500)))
        else:
            self.plant.advance(now, self.current() * FORCE_CONSTANT * self.variant.motor_sign)
        self.now = now
        self.power.hold(now)
        if lost := self.monitors.lost(now):
            self.lose(lost)
        if self.power.state in RAMPS and abs(self.plant.speed) < _AT_REST:
            self.power.ramp_over(self.memory.number(0x605A00))
        self.plant.brake(self.variant.gravity != 0.0 and self.power.state not in POWERED, self.variant.brake_time)
        self._watch_motion()
        self._send_by_event()
        if self.storms:
            self.emergency(0x8110)
        self._sample()

    def current(self) -> float:
        """Current that flows (A): the command within the drive's limits, or that of its own ramp."""
        if self.power.state in RAMPS:
            speed, braking = self.plant.speed, ramp_torque(self.memory.number(0x608500))
            return -self.variant.motor_sign * math.copysign(braking, speed) / FORCE_CONSTANT if speed else 0.0
        if not self.enabled or self.mode not in (CST, HM) or self.deaf or self.deaf_still:
            return 0.0
        homes = self.mode == HM
        wanted = self.homing.current(self.plant.angle, self.plant.speed) if homes else self.target * PERMILLE
        return min(max(wanted, -self._limit(0x60E100)), self._limit(0x60E000))

    @property
    def deaf_still(self) -> bool:
        """Whether it was enabled too short a time ago to take commands."""
        return self.now - self.power.since < self.variant.deaf_for

    def _limit(self, side: int) -> float:
        """Largest current (A) to the side that this object limits."""
        counts = [self.memory.number(key) for key in (0x607200, 0x607300)]
        counts += [self.memory.number(side)] if self.variant.more and side in self.memory else []
        return min(min(counts) * PERMILLE, PEAK_CURRENT, self.variant.clamp or math.inf)

    def lose(self, monitor: str) -> None:
        """The connection is lost: CiA 402, 0x6007."""
        option = self.memory.number(0x600700)
        code = EMERGENCIES.get(monitor.split()[0], 0x8130)
        self.note("lost", monitor=monitor, option=option)
        if option == 1:
            self.trip(code, self.memory.number(0x605E00))
            return
        self.emergency(code)
        if self.power.state is State.OPERATION_ENABLED and option == 2:
            self.power.to(State.SWITCH_ON_DISABLED, monitor)
        elif self.power.state is State.OPERATION_ENABLED and option == 3:
            self.power.to(State.QUICK_STOP_ACTIVE, monitor)

    def trip(self, code: int, reaction: int | None = None) -> None:
        """A fault of the drive itself."""
        reaction = self.memory.number(0x605E00) if reaction is None else reaction
        self.power.trip(reaction, f"fault 0x{code:04X}")
        self.emergency(code)

    def _watch_motion(self) -> None:
        """Let the variant's event happen once the axis has moved under power."""
        if self.power.state is not State.OPERATION_ENABLED:
            self._moved_from = None
            return
        if self._moved_from is None:
            self._moved_from = self.plant.table
        if self.variant.in_motion and not self.event_over and abs(self.plant.table - self._moved_from) > 2e-4:
            self.event_over = True
            self.note("event", event=self.variant.in_motion)
            happen(self, self.variant.in_motion)

    def show(self) -> None:
        """The moving objects, as a reader finds them now."""
        self.memory.live |= {
            0x604100: self._statusword(),
            0x606100: display.mode(self),
            **display.measured(self),
        }

    def _statusword(self) -> int:
        self._toggle ^= self.variant.toggled_bits
        return display.statusword(self) ^ self._toggle

    def _sample(self) -> None:
        powered = self.power.state in POWERED
        active = powered or not self.plant.rests
        if self.now - self._sampled < SAMPLE or not (active or self._active_before):
            return
        self._sampled, self._active_before = self.now, active  # the first sample at rest is written, too
        stops = self.memory.number(0x600700) in (1, 2, 3)
        self.note(
            "sample", x=self.plant.table, v=self.plant.speed * METRES_PER_RAD, current=self.current(),
            command=self.target * PERMILLE, powered=powered, enabled=self.power.state is State.OPERATION_ENABLED,
            monitors=self.monitors.armed() if stops else [], rests=self.plant.rests,
        )  # fmt: skip
