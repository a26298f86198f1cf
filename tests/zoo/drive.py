"""A foreign drive: plant, state machine, process data and monitors put together, one frame and one tick at a time."""

from __future__ import annotations

import math
from collections.abc import Callable

from tests.zoo.diary import SAMPLE
from tests.zoo.events import happen
from tests.zoo.homing import HM, Homing
from tests.zoo.memory import Memory
from tests.zoo.monitors import EMERGENCIES, Monitors
from tests.zoo.pdos import Answers, Pdo
from tests.zoo.plant import COUNTS, FORCE_CONSTANT, METRES_PER_RAD, PEAK_CURRENT, RATED_CURRENT, Plant, ramp_torque
from tests.zoo.power import POWERED, RAMPS, Power, State
from tests.zoo.variants import Variant

CST = 10  # mode of operation: cyclic synchronous torque
_PERMILLE = RATED_CURRENT / 1000.0  # A
_COUNTS_PER_RAD = COUNTS / (2.0 * math.pi)
_AT_REST = 0.05  # rad/s: the ramp is over
_WORD, _REMOTE, _LIMIT, _FOLLOWS = 0xFFFF, 1 << 9, 1 << 11, 1 << 12
OPERATIONAL, PRE_OPERATIONAL = 5, 127


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
        self.now = self._sampled = self._brake_since = 0.0
        self._moved_from: float | None = None
        self._active_before = True
        self.event_over = False
        self.nmt = PRE_OPERATIONAL
        self.forget()
        if variant.fault_at_start:
            self.trip(variant.fault_at_start, reaction=0)
        self.power.cause = variant.fault_stays

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
        self.power = Power(self.note, self.variant.reset_hold)
        self.nmt, self.mode, self.target = PRE_OPERATIONAL, 0, 0
        self.pending: list[dict[int, bytes]] = []  # commands that wait for SYNC
        self.answers = Answers(self.variant.tpdo_age)
        self.wants_boot = self.deaf = False  # an event wants a boot; commands have no effect
        self.missing_bits = 0  # of the statusword, taken away by an event
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
        elif key == 0x606000 and not (self._enabled and self.homing.kind == "stubborn"):
            self.mode = int.from_bytes(data, "little", signed=True)
        elif key == 0x607100:
            self.target = int.from_bytes(data, "little", signed=True)

    @property
    def _enabled(self) -> bool:
        return self.power.state is State.OPERATION_ENABLED

    def _order_homing(self, start: bool) -> None:
        if start is not self._starts and self.mode == HM and self._enabled:
            self.homing.order(start)
        self._starts = start

    # ------------------------------------------------------------------ the bus

    def sync(self) -> None:
        """SYNC: sample and send, then act on what has come since the last one."""
        if self.nmt != OPERATIONAL:
            return
        self.show()
        first, second = (pdo.due() for pdo in self.tpdos)
        if first and (data := self.answers.next(self.tpdos[0].packed(self.memory.raw))) is not None:
            self.send(self.tpdos[0].cob_id, data)
        if second or (self.variant.extra_pdos and self.tpdos[1].valid):
            self.send(self.tpdos[1].cob_id, self.tpdos[1].packed(self.memory.raw))
        for values in self.pending:
            self._take(values)
        self.pending = []

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
        self._work_brake()
        self._watch_motion()
        self._sample()

    def _work_brake(self) -> None:
        """Open with power, closed without; it takes its time for both."""
        wanted = self.variant.gravity != 0.0 and self.power.state not in POWERED
        if wanted == self.plant.braked:
            self._brake_since = self.now
        elif self.now - self._brake_since >= self.variant.brake_time:
            self.plant.braked = wanted

    def current(self) -> float:
        """Current that flows (A): the command within the drive's limits, or that of its own ramp."""
        if self.power.state in RAMPS:
            speed, braking = self.plant.speed, ramp_torque(self.memory.number(0x608500))
            return -self.variant.motor_sign * math.copysign(braking, speed) / FORCE_CONSTANT if speed else 0.0
        if not self._enabled or self.mode not in (CST, HM) or self.deaf:
            return 0.0
        limit, homes = self._limit(), self.mode == HM
        wanted = self.homing.current(self.plant.angle, self.plant.speed) if homes else self.target * _PERMILLE
        return min(max(wanted, -limit), limit)

    def _limit(self) -> float:
        counted = min(self.memory.number(0x607200), self.memory.number(0x607300)) * _PERMILLE
        return min(counted, PEAK_CURRENT, self.variant.clamp or math.inf)

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
        sign = -1 if self.memory.number(0x607E00) & 0x80 else 1
        counts = self.variant.start_counts + round(self.plant.angle * _COUNTS_PER_RAD) - self.homing.origin
        self.memory.live |= {
            0x604100: self._statusword(),
            0x606100: self._mode_display(),
            0x606400: (sign * counts + 2**31) % 2**32 - 2**31,
            0x606C00: sign * round(self.plant.speed * _COUNTS_PER_RAD),
            0x607700: round(self.current() / _PERMILLE),
        }

    def _statusword(self) -> int:
        following = self.power.state is State.OPERATION_ENABLED and self.mode == CST
        bits = self.power.state.value | 0x10 | _REMOTE | (_FOLLOWS if following else 0)
        if self.mode == HM and self._enabled:
            bits |= self.homing.bits
        if self.variant.clamp_told and abs(self.target * _PERMILLE) > self._limit():
            bits |= _LIMIT
        return bits & _WORD & ~self.missing_bits

    def _mode_display(self) -> int:
        enabled = self.power.state is State.OPERATION_ENABLED
        shown = {"at once": True, "enabled": enabled, "never": False}[self.variant.mode_display]
        return self.mode if shown else 0

    def _sample(self) -> None:
        powered = self.power.state in POWERED
        active = powered or self.plant.speed != 0.0
        if self.now - self._sampled < SAMPLE or not (active or self._active_before):
            return
        self._sampled, self._active_before = self.now, active  # the first sample at rest is written, too
        stops = self.memory.number(0x600700) in (1, 2, 3)
        self.note(
            "sample", x=self.plant.table, v=self.plant.speed * METRES_PER_RAD, current=self.current(),
            command=self.target * _PERMILLE, powered=powered, enabled=self.power.state is State.OPERATION_ENABLED,
            monitors=self.monitors.armed() if stops else [],
        )  # fmt: skip
