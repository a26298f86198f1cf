"""A CiA 402 drive in cyclic synchronous torque mode over CAN: our side of the wire.

The `canopen` library knows EDS and SDO; the cyclic path is three frames and two precompiled structs::

    sample()  SYNC ------------------>   latch; the last command acts
              <------------------ TPDO   statusword, position, current
    apply()   RPDO ------------------>   controlword, current command

There is no thread: whatever else arrives is taken up while `sample` waits for its TPDO.
"""

from __future__ import annotations

import contextlib
import math
import struct
import time

from stagectl.drives import cia402
from stagectl.drives.bus import Bus, frame
from stagectl.drives.canopen_pdo import CommandPdo, FeedbackPdo
from stagectl.drives.canopen_setup import MASTER, Setup
from stagectl.drives.canopen_words import CAUSES, WHAT, emergency_words, hint, state_words
from stagectl.drives.cia402 import State
from stagectl.drives.drive import Canopen, DriveError, Fault, Feedback
from stagectl.drives.wire import Network, Partner, load_eds

_SYNC = frame(0x080)
_HEARTBEAT = frame(0x700 + MASTER, bytes([cia402.OPERATIONAL]))
_EMERGENCY = struct.Struct("<8xHB5s")
_ENABLED_MASK, _ENABLED = State.OPERATION_ENABLED.value
_ENABLE_TIME = 5.0  # s in which Operation enabled must be reached
_STOP_TIME = 10.0  # s after which a quick stop is given up
_LOST_TIME = 1.0  # s of the same, once the drive answers no more
_STANDS = 100  # cycles without motion that count as standing still
_STANDING = 1e-4  # s of the ramp's deceleration: speed below which an axis counts as standing
_RESET_CYCLES = 8  # cycles between the edges of the fault reset, for drives that look slowly
_STOPPED = (State.SWITCH_ON_DISABLED, State.READY, State.SWITCHED_ON, State.FAULT, State.NOT_READY)


class _Standstill:
    """Whether the position stays within `tolerance` (rad | m) for so many cycles, noise or not."""

    def __init__(self, tolerance: float) -> None:
        self._tolerance, self._anchor, self._cycles = tolerance, math.nan, 0

    def stands(self, position: float) -> bool:
        if abs(position - self._anchor) <= self._tolerance:
            self._cycles += 1
        else:
            self._anchor, self._cycles = position, 0
        return self._cycles >= _STANDS


class CanopenDrive:
    """The drive protocol over a bus; see `stagectl.drives.drive.Drive`."""

    def __init__(self, settings: Canopen, bus: Bus, encoder_step: float, dt: float) -> None:
        """Find the drive and configure it; one count is `encoder_step` (rad | m), one period `dt` (s).

        Raises DriveError with what the drive refused and the next step.
        """
        self._settings, self._bus, self._step, self._dt = settings, bus, encoder_step, dt
        od = load_eds(settings.eds, settings.node)
        self._command, self._answer = CommandPdo(settings, od), FeedbackPdo(settings, od)
        self._network = Network(bus)
        self._node = Partner(settings.node, od)
        self._network[settings.node] = self._node
        self._controlword = 0
        self._heartbeat_cycles = max(1, round(settings.heartbeat / dt))
        self._cycle = 0  # cycles until our next heartbeat
        self._last = Feedback(math.nan, math.nan, 0, Fault.NONE)
        self._reason: Feedback | None = None  # the first fault since Operation was enabled
        self._serving = False  # enabled, and not asked to stop
        self._emergency: tuple[int, int, bytes] | None = None  # code, error register, vendor's bytes
        self._heard = math.nan  # s, monotonic, when the drive's heartbeat was last heard
        self._problem = ""  # ours, in words
        self._closed = False
        self._overdue = False  # an answer is missing and may still come
        setup = Setup(settings, self._node, encoder_step)
        setup.run()
        self._told = setup.told

    def enable(self) -> Feedback:
        """Walk the state machine to Operation enabled at zero current, from whatever state.

        The cycle must go on at once afterwards: the drive's time-outs run.  Raises DriveError.
        """
        self._problem, self._emergency, self._reason = "", None, None
        due = time.monotonic()
        deadline, cycle = due + _ENABLE_TIME, 0
        still = self._standstill()
        while time.monotonic() < deadline:
            now = self.sample()
            state = cia402.state(now.statusword)
            stands = still.stands(now.position)
            if now.fault is not Fault.FEEDBACK_LOST:
                self._controlword = _towards_enabled(state, cycle, stands)
            if now.fault is Fault.NONE:
                self._serving = True
                return now
            if state is State.OPERATION_ENABLED:
                self._emergency = None  # an old one: the drive runs, and would not with an error present
            self.apply(0.0)
            cycle += 1
            due = self._rest(due)
        raise DriveError(self._hangs())

    def sample(self) -> Feedback:
        """SYNC, and the drive's answer to it; never raises."""
        try:
            if self._overdue:
                self._drain()
            self._bus.send(_SYNC)
            raw = self._await_answer(self._settings.feedback_timeout)
        except OSError as error:
            return self._failed(Fault.BUS, f"the bus failed: {error}")
        if raw is None:
            self._overdue = True
            return self._failed(Fault.FEEDBACK_LOST, "")
        statusword, counts, current = self._answer.decode(raw)
        fault = Fault.NONE
        if self._emergency is not None:
            fault = Fault.EMERGENCY
        elif statusword & _ENABLED_MASK != _ENABLED or self._problem:
            fault = Fault.DRIVE_FAULT
        return self._noted(Feedback(counts * self._step, current, statusword, fault))

    def apply(self, current: float) -> None:
        """Send the command (A); never raises: what went wrong is in the next `sample`."""
        try:
            self._bus.send(self._command.encode(self._controlword, current))
            if self._cycle <= 0:
                self._cycle = self._heartbeat_cycles
                self._bus.send(_HEARTBEAT)
        except ValueError as error:
            self._problem = f"{error}; zero was sent instead"
            self.apply(0.0)
        except OSError as error:
            self._problem = f"the bus failed: {error}"
        self._cycle -= 1

    def quick_stop(self) -> Feedback:
        """Quick stop by the drive's own ramp, until it stands, its power is off, or ten seconds are over."""
        self._controlword, self._serving = cia402.Command.QUICK_STOP.controlword, False
        due = time.monotonic()
        deadline, still = due + _STOP_TIME, self._standstill()
        while time.monotonic() < deadline:
            self.apply(0.0)
            now = self.sample()
            state = cia402.state(now.statusword)
            if now.fault is Fault.BUS or state in _STOPPED:
                break  # nothing can be sent: the drive's own time-outs stop it; or its power is off
            if now.fault is Fault.FEEDBACK_LOST:
                deadline = min(deadline, time.monotonic() + _LOST_TIME)
            elif still.stands(now.position) and state is State.QUICK_STOP_ACTIVE:
                break
            due = self._rest(due)
        return self._last

    def describe(self) -> dict[str, str]:
        """Identity, time-outs, option codes in words and scales, as read back from the drive."""
        s = self._settings
        return {"drive": f"CANopen node {s.node} on {s.interface} {s.channel}", **self._told}

    def explain(self) -> str:
        """The last fault in words, with the probable causes and the next command."""
        last = self._reason or self._last._replace(fault=Fault.NONE)
        said = [f"node {self._settings.node}: {WHAT[last.fault]}"]
        if self._problem:
            said.append(self._problem)
        said.append(f"state {state_words(last.statusword)}")
        if self._emergency is not None:
            said.append(emergency_words(self._emergency))
        if not math.isnan(self._heard):
            said.append(f"last heartbeat of the drive {time.monotonic() - self._heard:.2f} s ago")
        return "; ".join(said) + f". {CAUSES[last.fault]}"

    def close(self) -> None:
        """Disable the voltage, take the node out of operation, leave the bus; safe twice, never raises."""
        if self._closed:
            return
        self._closed = True
        self._controlword = cia402.Command.DISABLE_VOLTAGE.controlword
        with contextlib.suppress(OSError):  # on a dead bus nothing is left to be said
            self.apply(0.0)
            self._bus.send(_SYNC)  # the RPDO acts with it
            self._bus.send(frame(0, bytes([cia402.NMT_PRE_OPERATIONAL, self._settings.node])))
        with contextlib.suppress(OSError):
            self._bus.close()

    def _await_answer(self, timeout: float) -> bytes | None:
        """The TPDO, taking up whatever comes before it; None after `timeout` seconds."""
        receive, head = self._bus.receive, self._answer.head
        raw = receive(timeout)
        if raw is None or raw[:5] == head:
            return raw
        deadline = time.monotonic() + timeout
        while raw is None or raw[:5] != head:
            if raw is not None:
                self._take(raw)
            left = deadline - time.monotonic()
            if left <= 0.0:
                return None
            raw = receive(left)
        return raw

    def _take(self, raw: bytes) -> None:
        """A frame that is not our TPDO."""
        identifier = int.from_bytes(raw[:4], "little")
        if identifier == 0x080 + self._settings.node:
            code, register, vendor = _EMERGENCY.unpack(raw)
            self._emergency = (code, register, vendor) if code & 0xFF00 else None
        elif identifier == 0x700 + self._settings.node:
            self._heard = time.monotonic()
        elif identifier == self._answer.identifier and raw[:5] != self._answer.head:
            wanted = self._answer.head[4]
            self._problem = f"its TPDO has {raw[4]} bytes, must have {wanted}; did another master map it?"

    def _drain(self) -> None:
        """Late answers must not be taken for the next one."""
        while (raw := self._bus.receive(0.0)) is not None:
            self._take(raw)
        self._overdue = False

    def _failed(self, fault: Fault, problem: str) -> Feedback:
        self._problem = problem or self._problem
        return self._noted(self._last._replace(current=math.nan, fault=fault))

    def _noted(self, now: Feedback) -> Feedback:
        self._last = now
        if now.fault and self._serving:  # what comes after it, and after a stop, is only its consequence
            self._reason, self._serving = now, False
        return now

    def _standstill(self) -> _Standstill:
        travel = self._settings.quick_stop_deceleration * _STANDING * _STANDS * self._dt
        return _Standstill(max(2.0 * self._step, travel))

    def _rest(self, due: float) -> float:
        """Sleep to the end of the period that began at `due`; start of the next one."""
        due = max(due + self._dt, time.monotonic() - self._dt)
        time.sleep(max(due - time.monotonic(), 0.0))
        return due

    def _hangs(self) -> str:
        last, seen = self._last, self._emergency
        told = emergency_words(seen) if seen else "no emergency was sent"
        problem = f"{self._problem}; " if self._problem else ""
        return (
            f"node {self._settings.node} does not reach Operation enabled within {_ENABLE_TIME:.0f}"
            " s: it hangs in"
            f" {state_words(last.statusword)}; {problem}{told}. {hint(last)}"
        )


def _towards_enabled(state: State, cycle: int, stands: bool) -> int:
    """Controlword of the next step; a fault is reset by edges, a quick stop left when the axis stands."""
    if state is State.FAULT and cycle // _RESET_CYCLES % 2 == 0:
        return 0
    if state is State.QUICK_STOP_ACTIVE and stands:
        return cia402.Command.DISABLE_VOLTAGE.controlword
    return cia402.TOWARDS_ENABLED[state].controlword
