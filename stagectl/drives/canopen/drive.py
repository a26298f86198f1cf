"""A CiA 402 drive in cyclic synchronous torque mode over CAN: our side of the wire.

The `canopen` library knows EDS and SDO; the cyclic path is three frames and two precompiled structs::

    sample()  SYNC ------------------>   latch; the last command acts
              <------------------ TPDO   statusword, position, current
    apply()   RPDO ------------------>   controlword, current command

There is no thread: every other frame is read while `sample` waits for its TPDO.
"""

from __future__ import annotations

import contextlib
import math
import struct
import time

from stagectl.drives.bus.frames import Bus, frame
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.braking_monitor import (
    FAILURE_TEXTS,
    BrakingFailure,
    BrakingMonitor,
    ConsecutiveCycles,
    SpeedEstimate,
)
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.configuration import configured
from stagectl.drives.canopen.fault_texts import MUTE, Emergency, explained, not_enabled
from stagectl.drives.canopen.power_states import PowerTransition, Standstill
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, Fault, Feedback, Power
from stagectl.drives.limits import BACKLOG, ENABLE_TIME, LOST_STOP_TIME, REPEAT_COMMAND_CYCLES, STOP_TIME
from stagectl.drives.run_on import UNKNOWN_AXIS, AxisLimits

_SYNC = frame(0x080)
_EMERGENCY = struct.Struct("<8xHB5s")
_WRITE_WORD = struct.Struct("<BHBI")  # SDO: expedited download
# A member of an enumeration takes Python 90 ns to look up by its name: what each cycle needs is looked up here.
_NONE, _ON, _QUICK_STOP, _OPERATION_ENABLED = Fault.NONE, Power.ON, Power.QUICK_STOP, DriveState.OPERATION_ENABLED
_ENABLED_MASK, _ENABLED = DriveState.OPERATION_ENABLED.value
_RUNNING = (DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE)


class CanopenDrive:
    """The drive protocol over a bus; see `stagectl.drives.drive.Drive`."""

    def __init__(
        self,
        settings: Canopen,
        bus: Bus,
        encoder_step: float,
        dt: float,
        *,
        clock: Clock = WALL,
        limits: AxisLimits = UNKNOWN_AXIS,
    ) -> None:
        """Find the drive and configure it; one count is `encoder_step` (rad | m), one period `dt` (s).

        With `limits` the drive's own limits are made to agree with those of the axis.  Raises DriveError with the
        object that the drive refused and the next step.
        """
        self._settings, self._bus, self._step, self._dt = settings, bus, encoder_step, dt
        self._clock, self._pace = clock, SpeedEstimate(dt)
        self._now = time.monotonic if clock is WALL else clock.now  # without a call of ours in between
        self._walk = PowerTransition(Power.OFF, self._standstill())
        self._beat = -math.inf  # s, monotonic, when our next heartbeat is due: by time, as cycles may be late
        self._last = Feedback(math.nan, math.nan, 0, Fault.NONE)
        self._reason: Feedback | None = None  # the first fault since Operation was enabled
        self._serving = False  # enabled, and not asked to stop
        self._walking = False  # on the way to it
        self._emergency: Emergency | None = None
        self._heard = math.nan  # s, monotonic, when the drive's heartbeat was last heard
        self._problem = ""  # ours, in words
        self._closed = False
        self._rebooted = False  # since it was configured
        self._silent = False  # no answer to the last SYNC
        self._braking = BrakingMonitor(self._pace, settings.quick_stop_deceleration)
        self._unheard = ConsecutiveCycles(REPEAT_COMMAND_CYCLES)
        setup = configured(settings, bus, encoder_step, dt, clock, limits)
        self._description, self._protection = setup.description, setup.protection
        self._command, self._answer = setup.pdos  # as the drive has them, not as they were wished
        self._alive, self._alive_period = setup.protection.alive, setup.protection.period

    def enable(self) -> Feedback:
        """Walk the state machine to Operation enabled at zero current, from whatever state.

        The cycle must go on at once afterwards: the drive's time-outs run.  Raises DriveError.
        """
        self.ask(Power.ON)
        due = self._now()
        deadline = due + ENABLE_TIME
        while self._now() < deadline:
            now = self.sample()
            if now.fault is Fault.NONE:
                return now
            self.apply(0.0)
            due = self._rest(due)
        raise not_enabled(self._settings.node, self._last, self._problem, self._emergency)

    def ask(self, power: Power) -> None:
        """Bring the drive to `power` with the periods that follow."""
        self._walk = PowerTransition(power, self._standstill())
        self._braking = BrakingMonitor(self._pace, self._settings.quick_stop_deceleration)
        self._serving, self._walking = False, power is Power.ON
        if power is Power.ON:
            self._problem, self._emergency, self._reason = "", None, None
            self._unheard = ConsecutiveCycles(REPEAT_COMMAND_CYCLES)

    def sample(self) -> Feedback:
        """SYNC, and the drive's answer to it; never raises."""
        try:
            self._drain()
            self._bus.send(_SYNC)
            raw = self._await_answer(self._settings.feedback_timeout)
        except OSError as error:
            return self._failed(Fault.BUS, f"the bus failed: {error}")
        self._silent = raw is None
        power = self._walk.power
        if power is _QUICK_STOP:
            self._supervise()
        if raw is None:
            return self._failed(Fault.REBOOTED if self._rebooted else Fault.FEEDBACK_LOST, "")
        statusword, counts, current = self._answer.decode(raw)
        self._pace.add(counts * self._step)
        if power is not _ON:
            self._insist(cia402.state(statusword))
        now = Feedback(counts * self._step, current, statusword, self._fault(statusword))
        return self._noted(self._walked(now) if self._walking else now)

    def _fault(self, statusword: int) -> Fault:
        """What the drive, its heartbeat and this answer say."""
        if self._rebooted:
            return Fault.REBOOTED
        if self._emergency is not None:
            return Fault.EMERGENCY
        silence = self._now() - self._heard  # NaN: never heard
        if self._serving and silence > self._settings.heartbeat_timeout:
            self._problem = f"{MUTE} for {silence:.2f} s while its answers went on"
            return Fault.FEEDBACK_LOST
        return Fault.DRIVE_FAULT if statusword & _ENABLED_MASK != _ENABLED or self._problem else _NONE

    def _supervise(self) -> None:
        """During a quick stop: cut the power of an axis that is not braked; release a drive that is silent."""
        failure = self._braking.step(self._silent)
        if failure is BrakingFailure.SILENT and self._protection.reacts:
            self._manage(cia402.NMT_PRE_OPERATIONAL)
        if failure in FAILURE_TEXTS:
            self._problem = FAILURE_TEXTS[failure]
            self._walk = PowerTransition(Power.OFF, self._standstill())

    def _insist(self, state: DriveState) -> None:
        """Send the controlword again by SDO to a drive that stays in operation although it must stop."""
        if self._unheard.certain(state is _OPERATION_ENABLED):
            self._unheard = ConsecutiveCycles(REPEAT_COMMAND_CYCLES)
            word = _WRITE_WORD.pack(0x2B, cia402.CONTROLWORD, 0, self._walk.controlword)
            with contextlib.suppress(OSError):
                self._bus.send(frame(0x600 + self._settings.node, word))

    def apply(self, current: float) -> None:
        """Send the command (A); never raises: what went wrong is in the next `sample`."""
        try:
            self._bus.send(self._command.encode(self._walk.controlword, current))
            now = self._now()
            if now >= self._beat:
                self._beat = now + self._alive_period
                self._bus.send(self._alive)
        except ValueError as error:
            self._problem = f"{error}; zero was sent instead"
            self.apply(0.0)
        except OSError as error:
            self._problem = f"the bus failed: {error}"

    def quick_stop(self) -> Feedback:
        """Quick stop by the drive's own ramp, until the axis stands, the power is off, or STOP_TIME is over."""
        self.ask(Power.QUICK_STOP)
        due = self._now()
        deadline, still, off = due + STOP_TIME, self._standstill(), ConsecutiveCycles()
        while self._now() < deadline:
            self.apply(0.0)
            now = self.sample()
            state = cia402.state(now.statusword)
            if now.fault is Fault.BUS:
                break  # nothing can be sent: the drive's own time-outs stop it
            over = off.certain(state not in _RUNNING and not self._silent) or state is DriveState.QUICK_STOP_ACTIVE
            if self._silent:
                deadline = min(deadline, self._now() + LOST_STOP_TIME)
            elif still.stands(now.position) and over:  # not by the statusword alone: to return cuts the power
                break
            due = self._rest(due)
        return self._last

    def describe(self) -> dict[str, str]:
        """Identity, time-outs, option codes in words and scales, as read back from the drive."""
        s = self._settings
        return {"drive": f"CANopen node {s.node} on {s.interface} {s.channel}", **self._description}

    def explain(self) -> str:
        """The last fault in words, probable causes, next command; on the way to power, where the drive hangs."""
        node, last = self._settings.node, self._reason or self._last._replace(fault=Fault.NONE)
        if self._walking and self._last.fault is not Fault.BUS:
            return str(not_enabled(node, self._last, self._problem, self._emergency))
        return explained(node, last, self._problem, self._emergency, self._now() - self._heard)

    def close(self) -> None:
        """Disable voltage, take the node out of operation, close the bus; safe to call twice, never raises."""
        if self._closed:
            return
        self._closed = True
        self.ask(Power.OFF)
        with contextlib.suppress(OSError):  # a dead bus carries nothing
            self.apply(0.0)
            self._bus.send(_SYNC)  # the RPDO acts with it
            self._manage(cia402.NMT_PRE_OPERATIONAL)
        with contextlib.suppress(OSError):
            self._bus.close()

    def _manage(self, command: int) -> None:
        """Send an NMT command to the drive (CiA 301)."""
        with contextlib.suppress(OSError):
            self._bus.send(frame(0, bytes([command, self._settings.node])))

    def _await_answer(self, timeout: float) -> bytes | None:
        """The TPDO, reading all other frames before it; None after `timeout` seconds."""
        receive, head = self._bus.receive, self._answer.head
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

    def _take(self, raw: bytes) -> None:
        """A frame that is not our TPDO."""
        identifier = int.from_bytes(raw[:4], "little")
        if identifier == 0x080 + self._settings.node:
            emergency = Emergency(*_EMERGENCY.unpack(raw))
            self._emergency = emergency if emergency.code & 0xFF00 else None
        elif identifier == 0x700 + self._settings.node:
            self._heard = self._now()
            self._rebooted = self._rebooted or raw[8] == cia402.INITIALISING
            if self._serving and raw[8] & 0x7F == cia402.PRE_OPERATIONAL:
                self._problem = "it left the NMT state operational"
        elif identifier == self._answer.identifier and raw[:5] != self._answer.head:
            wanted = self._answer.head[4]
            self._problem = f"its TPDO has {raw[4]} bytes, must have {wanted}; probable cause: another master mapped it"

    def _drain(self) -> None:
        """Clear the receive queue: a late or doubled answer must not be taken for the next one."""
        for _ in range(BACKLOG):
            raw = self._bus.receive(0.0)
            if raw is None:
                break
            self._take(raw)

    def _failed(self, fault: Fault, problem: str) -> Feedback:
        self._problem = problem or self._problem
        return self._noted(self._last._replace(current=math.nan, fault=fault))

    def _noted(self, now: Feedback) -> Feedback:
        self._last = now
        if now.fault and self._serving:  # what comes after it, and after a stop, is only its consequence
            self._reason, self._serving = now, False
        return now

    def _walked(self, now: Feedback) -> Feedback:
        """A step towards Operation enabled; once there, no fault later leads there again by itself."""
        state = self._walk.step(now)
        self._serving = now.fault is Fault.NONE
        self._walking = not self._serving
        if state is DriveState.OPERATION_ENABLED:
            self._emergency = None  # an old one: the drive runs, and would not with an error present
        return now

    def _standstill(self) -> Standstill:
        return Standstill.of_ramp(self._settings.quick_stop_deceleration, self._step, self._dt)

    def _rest(self, due: float) -> float:
        """Sleep to the end of the period that began at `due`; start of the next one."""
        due = max(due + self._dt, self._now() - self._dt)
        self._clock.sleep(max(due - self._now(), 0.0))
        return due
