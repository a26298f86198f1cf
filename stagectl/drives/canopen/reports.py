"""One drive's frames beside the cyclic command: what is heard of it and of other controllers, and what it is told.

`Reports` is what was heard: heartbeat, emergencies, its mode.  `take` has each frame that is no answer to SYNC; `fault`
is asked in each period, with the answer's statusword.  `DriveLine` waits for that answer, and sends requests that wait
for none.
"""

import contextlib
import math
import struct
from collections.abc import Callable

from stagectl.drives.bus.frames import EMERGENCY, HEARTBEAT, NMT, RPDO, SDO_ANSWER, SDO_REQUEST, SYNC, Bus, frame
from stagectl.drives.canopen import cia402, fault_texts
from stagectl.drives.canopen.brake_output import BrakeOutput
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.fault_texts import Deviation, DriveSigns, Emergency
from stagectl.drives.canopen.operation_watch import MODE_REQUEST, OperationWatch
from stagectl.drives.canopen.pdo import FeedbackPdo
from stagectl.drives.drive import Canopen, Fault
from stagectl.drives.limits import BACKLOG, MODE_PERIOD, YOUNG_HEARTBEAT

_REQUEST = struct.Struct("<BHBI")  # SDO: upload, or expedited download
_SIZES = {cia402.MODE: 0x2F, cia402.CONTROLWORD: 0x2B}  # SDO: one byte, two bytes
_LONG, _READ = 0x23, 0x40  # four bytes; upload
_EMERGENCY = struct.Struct("<8xHB5s")
# A member of an enumeration takes Python 90 ns to look up by its name: what each cycle needs is looked up here.
_NONE, _DRIVE_FAULT = Fault.NONE, Fault.DRIVE_FAULT
_ENABLED_MASK, _ENABLED = DriveState.OPERATION_ENABLED.value


class Reports:
    """What one drive, and others on its bus, have said."""

    brake: BrakeOutput  # what hears of the brake that we work

    def __init__(self, settings: Canopen, dt: float, answer: FeedbackPdo, now: Callable[[], float]) -> None:
        """In periods of `dt` (s); `answer` is the TPDO that is no business of this room, `now` the clock (s)."""
        self._node, self._timeout, self._answer, self.now = settings.node, settings.heartbeat_timeout, answer, now
        self.watch = OperationWatch(dt, settings.watched_bits)
        self.problem: Deviation | None = None  # what we saw for ourselves
        self.emergency: Emergency | None = None
        self.rebooted = False  # since it was configured
        self._answered = math.nan  # s, monotonic, of its last answer to SYNC since it was configured
        self.walking = False  # on the way to power
        self.serving = False  # enabled, and not asked to stop
        self.proving = False  # enabled, but it has not shown its mode yet
        self._heard = math.nan  # s, monotonic, when its heartbeat was last heard
        self._nmt: int | None = None  # NMT state in it

    def begin(self) -> None:
        """Power is being switched on: what was said before is over."""
        self.problem = self.emergency = None
        self.watch.begin()

    @property
    def signs(self) -> DriveSigns:
        """What is known, for the words of a fault."""
        age, answered = self.now() - self._heard, self._answered == self._answered
        after = not answered or self._heard > self._answered
        unshown = fault_texts.UNSHOWN_MODE.filled(self.watch.last_mode) if self.proving else None
        return DriveSigns(
            self.problem or unshown or self.brake.problem,
            self.emergency,
            answered,
            age,
            self._nmt,
            after and age < YOUNG_HEARTBEAT,
        )

    def fault(self, statusword: int) -> Fault:
        """What the drive, its heartbeat and this answer say."""
        self._answered = now = self.now()
        if self.rebooted:
            return Fault.REBOOTED
        if self.emergency is not None and (self.serving or self.emergency.code not in cia402.CONTROLLER_MISSED):
            return Fault.EMERGENCY  # without power nobody is missed: another drive's set-up may keep us for seconds
        silence = now - self._heard  # NaN: never heard
        if self.serving and silence > self._timeout:
            self.problem = fault_texts.MUTE.filled(silence)
            return Fault.FEEDBACK_LOST
        watch = self.watch
        if statusword & watch.mask != watch.expected:
            if statusword & _ENABLED_MASK != _ENABLED:
                return _DRIVE_FAULT
            self.problem = watch.look(statusword) or self.problem
        return _NONE if self.problem is None else _DRIVE_FAULT

    def show_mode(self, mode: int) -> None:
        """The mode of operation (0x6061) in an answer to SYNC."""
        if self.serving or self.proving:
            self.problem = self.watch.shown_mode(mode) or self.problem

    def take(self, raw: bytes) -> None:
        """A frame that is not our TPDO."""
        identifier, node = int.from_bytes(raw[:4], "little"), self._node
        if identifier == EMERGENCY + node:
            emergency = Emergency(*_EMERGENCY.unpack(raw))
            self.emergency = emergency if emergency.code & 0xFF00 else None
        elif identifier == HEARTBEAT + node:
            self._hear(raw[8])
        elif identifier == SDO_ANSWER + node:
            self.brake.hear(raw[8:16])
            if self.serving or self.proving:
                self.problem = self.watch.mode(raw[8:16]) or self.problem
        elif identifier == self._answer.identifier and raw[:5] != self._answer.head:
            self.problem = fault_texts.OTHER_MAPPING.filled(raw[4], self._answer.head[4])
        elif self.serving or self.walking:
            self._notice_other_controller(identifier, raw)

    def _hear(self, state: int) -> None:
        """The drive's heartbeat or boot-up message, with its state of network management."""
        self._heard, self._nmt = self.now(), state & 0x7F
        self.rebooted = self.rebooted or state == cia402.INITIALISING
        if self.serving and self._nmt not in (cia402.OPERATIONAL, cia402.INITIALISING):
            self.problem = fault_texts.LEFT_OPERATIONAL.filled(fault_texts.nmt_words(self._nmt))

    def _notice_other_controller(self, identifier: int, raw: bytes) -> None:
        """A frame that only a controller sends: it is not ours, as nobody hears what he sends himself."""
        if identifier == NMT and raw[4] and raw[9] in (0, self._node):
            said = f"its NMT command 0x{raw[8]:02X} for node {raw[9]} was seen"
            self.problem = fault_texts.OTHER_CONTROLLER.filled(said)
        elif identifier == RPDO + self._node:
            self.problem = fault_texts.OTHER_CONTROLLER.filled("its command (RPDO) to this drive was seen")
        elif identifier == SYNC:  # the drive answers each: at twice the rate, and half of it for another one's time
            self.problem = fault_texts.OTHER_CONTROLLER.filled("its SYNC was seen")


class DriveLine:
    """The frames of one drive; `reports` gets each that is no answer to SYNC."""

    def __init__(self, bus: Bus, node: int, head: bytes, reports: Reports) -> None:
        """`head` is how its answer to SYNC begins."""
        self._bus, self._node, self._head, self._now, self._take = bus, node, head, reports.now, reports.take
        self._mode_due = 0.0  # s, when the mode is asked for again

    def answer(self, timeout: float) -> bytes | None:
        """The answer to SYNC, reading all other frames before it; None after `timeout` seconds."""
        receive, head = self._bus.receive, self._head
        deadline = self._now() + timeout  # before the first frame: what comes in between must not prolong the wait
        raw = receive(timeout)
        if raw is None or raw[:5] == head:
            return raw
        while raw is None or raw[:5] != head:
            if raw is not None:
                self._take(raw)
            left = deadline - self._now()
            if left <= 0.0:
                return None
            raw = receive(left)
        return raw

    def drain(self) -> None:
        """Clear the receive queue: a late or doubled answer must not be taken for the next one."""
        for _ in range(BACKLOG):
            raw = self._bus.receive(0.0)
            if raw is None:
                break
            self._take(raw)

    def manage(self, command: int) -> None:
        """Send an NMT command to the drive (CiA 301)."""
        with contextlib.suppress(OSError):
            self._bus.send(frame(NMT, bytes([command, self._node])))

    def write(self, index: int, subindex: int, value: int) -> None:
        """Write an object by SDO without waiting for the answer."""
        self._request(_SIZES.get(index, _LONG), index, subindex, value)

    def read(self, index: int, subindex: int) -> None:
        """Ask for an object by SDO without waiting for the answer."""
        self._request(_READ, index, subindex, 0)

    def _request(self, *fields: int) -> None:
        with contextlib.suppress(OSError):
            self._bus.send(frame(SDO_REQUEST + self._node, _REQUEST.pack(*fields)))

    def ask_for_mode(self, now: float) -> None:
        """Ask for 0x6061 by SDO each MODE_PERIOD.  Raises OSError."""
        if now >= self._mode_due:
            self._mode_due = now + MODE_PERIOD
            self._bus.send(frame(SDO_REQUEST + self._node, MODE_REQUEST))
