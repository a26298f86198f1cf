"""A CiA 402 drive in cyclic synchronous torque mode over CAN: our side of the wire.

The `canopen` library knows EDS and SDO; the cyclic path is three frames and two precompiled structs::

    sample()  SYNC ------------------>   latch; the last command acts
              <------------------ TPDO   statusword, position, current
    apply()   RPDO ------------------>   controlword, current command

There is no thread: every other frame is read while `sample` waits for its TPDO.
"""

import contextlib
import math

from stagectl.drives.brake import NO_BRAKE, Brake
from stagectl.drives.bus.frames import SYNC, Bus, frame
from stagectl.drives.canopen import cia402, fault_texts
from stagectl.drives.canopen.boot_up import set_brake
from stagectl.drives.canopen.brake_output import BrakeOutput
from stagectl.drives.canopen.braking_monitor import (
    FAILURE_TEXTS,
    BrakingFailure,
    BrakingMonitor,
    ConsecutiveCycles,
    SpeedEstimate,
)
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.configuration import DriveConfiguration
from stagectl.drives.canopen.drive_homing import DriveHoming, ModeSwitch
from stagectl.drives.canopen.fault_texts import Deviation, FoundState
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.canopen.operation_watch import mode_place
from stagectl.drives.canopen.power_states import BrakeSequence, PowerTransition, Standstill, fault_reset, keeps_power
from stagectl.drives.canopen.protection import check_output_brake
from stagectl.drives.canopen.reports import DriveLine, Reports
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.cycle_time import has_room_for_sdo
from stagectl.drives.drive import Fault, Feedback, Power
from stagectl.drives.limits import OLD_ANSWERS, REPEAT_COMMAND_CYCLES, RESET_TIME, STANDING

_SYNC = frame(SYNC)
# A member of an enumeration takes Python 90 ns to look up by its name: what each cycle needs is looked up here.
_ON, _QUICK_STOP = Power.ON, Power.QUICK_STOP
_FAULT_BIT = 0x08  # of Fault and Fault reaction active


class CanopenDrive:
    """The drive protocol over a bus; see `stagectl.drives.drive.Drive`."""

    def __init__(self, wishes: Wishes, bus: Bus, brake: Brake = NO_BRAKE, clock: Clock = WALL) -> None:
        """Find the drive and configure it by these `wishes`.

        Raises DriveError with the object that the drive refused and the next step.
        """
        settings, dt = wishes.settings, wishes.dt
        self._settings, self._bus, self._step, self._dt = settings, bus, wishes.encoder_step, dt
        self._clock, self._now, self._pace = clock, clock.now, SpeedEstimate(dt)
        self._walk = PowerTransition(Power.OFF, self._standstill())
        self._beat = -math.inf  # s, monotonic, when our next heartbeat is due: by time, as cycles may be late
        self._last = Feedback(math.nan, math.nan, 0, Fault.NONE)
        self._reason: Feedback | None = None  # the first fault since Operation was enabled
        self._closed = self._silent = False  # no answer to the last SYNC
        self._braking = BrakingMonitor(self._pace, settings.quick_stop_deceleration)
        self._unheard = ConsecutiveCycles(REPEAT_COMMAND_CYCLES)
        setup = DriveConfiguration(wishes, bus, brake, clock)
        setup.run()
        self._description, self._protection = setup.description, setup.protection
        self._command, self._answer = setup.pdos  # as the drive has them, not as they were wished
        self._alive, self._alive_period = setup.protection.alive, setup.protection.period
        self._reports = Reports(settings, dt, self._answer, self._now)
        self._reports.watch.mode_shown = setup.mode_shown
        self._line = DriveLine(bus, settings.node, self._answer.head, self._reports)
        self._reports.brake = BrakeOutput(brake.control == "output", self._line.write, self._line.read)
        self._brake = BrakeSequence(brake, dt, self._reports.brake)
        self._mode = ModeSwitch(self._line, self._command, self._reports)
        self._homing: DriveHoming | None = None
        self._mode_at, self._has_room = mode_place(setup.tpdo), has_room_for_sdo(dt, settings.bitrate)
        self._slow = settings.quick_stop_deceleration * STANDING
        self._found = FoundState(*(setup.objects.known(index) for index in (cia402.STATUSWORD, cia402.ERROR_CODE)))
        self.position = lambda: setup.objects.position(self._step)
        if brake.control == "output":
            check_output_brake(setup.objects)
            set_brake(setup.objects)  # before any power

    def ask(self, power: Power) -> None:
        """Bring the drive to `power` with the periods that follow."""
        self._homing = DriveHoming(self._mode) if power is Power.HOME else None
        if self._homing:
            return
        self._walk = self._transition(power)
        self._braking = BrakingMonitor(self._pace, self._settings.quick_stop_deceleration)
        self._reports.serving = self._reports.proving = False
        self._reports.walking = power is Power.ON
        if power is Power.ON:
            self._reason = None
            self._unheard = ConsecutiveCycles(REPEAT_COMMAND_CYCLES)
            self._reports.begin()
            self._mode.back()

    def _transition(self, power: Power) -> PowerTransition:
        """The way to `power`; where an axis stands under power, its brake is set before that goes."""
        still, stopped = self._standstill(), self._walk.power is _QUICK_STOP
        if power not in (Power.OFF, Power.ENGAGE) or not self._brake.present:
            return PowerTransition(power, still)
        self._brake.engage()
        if power is Power.OFF and not stopped:
            return PowerTransition(Power.OFF, still)
        word = self._walk.controlword  # that of Operation enabled, or of the quick stop
        if not (stopped or self._brake.keeps_enabled):
            word = cia402.DeviceCommand.SWITCH_ON.controlword  # disable operation: the drive works its brake
        return PowerTransition(Power.OFF, still, word)

    def sample(self) -> Feedback:
        """SYNC, and the drive's answer to it; never raises."""
        try:
            self._line.drain()
            self._bus.send(_SYNC)
            raw = self._line.answer(self._settings.feedback_timeout)
        except OSError as error:
            self._silent = True
            return self._failed(Fault.BUS, Deviation(f"the bus failed: {error}"))
        self._silent = raw is None
        power = self._walk.power
        if power is _QUICK_STOP:
            self._supervise()
        if raw is None:
            return self._failed(Fault.REBOOTED if self._reports.rebooted else Fault.FEEDBACK_LOST)
        statusword, counts, current = self._answer.decode(raw)
        self._pace.add(counts * self._step)
        if power is not _ON:
            self._stopping(cia402.state(statusword))
        elif self._mode_at:
            self._reports.show_mode(raw[self._mode_at])
        now = Feedback(counts * self._step, current, statusword, self._reports.fault(statusword))
        return self._noted(self._walked(now) if self._reports.walking else self._homed(now))

    def _homed(self, now: Feedback) -> Feedback:
        """A step of the drive's homing; the controlword of enabled operation has its start bit."""
        if (homing := self._homing) is not None:
            now, self._walk.controlword = homing.step(now), homing.controlword
        return now

    def _supervise(self) -> None:
        """During a quick stop: cut the power of an axis that is not braked; release a drive that is silent."""
        failure = self._braking.step(self._silent)
        if failure is BrakingFailure.SILENT and self._protection.reacts:
            self._line.manage(cia402.NMT_PRE_OPERATIONAL)
        if failure in FAILURE_TEXTS:
            self._reports.problem = Deviation(FAILURE_TEXTS[failure])
            self._brake.engage()
            self._walk = PowerTransition(Power.OFF, self._standstill())

    def _stopping(self, state: DriveState) -> None:
        """One period without power, or on the way there; a drive that keeps its power is told again, by SDO."""
        if self._brake.holds() and self._walk.waits:
            self._walk.let_go()
        word = self._walk.controlword
        if self._unheard.certain(keeps_power(state, word)):
            self._unheard = ConsecutiveCycles(REPEAT_COMMAND_CYCLES)
            self._line.write(cia402.CONTROLWORD, 0, word)

    def apply(self, current: float) -> None:
        """Send the command (A); never raises: what went wrong is in the next `sample`."""
        try:
            self._bus.send(self._command.encode(self._walk.controlword, current))
            now = self._now()
            if now >= self._beat:
                self._beat = now + self._alive_period
                self._bus.send(self._alive)
                if (self._reports.serving or self._reports.proving) and self._may_ask_for_mode():
                    self._line.ask_for_mode(now)
        except ValueError as error:
            self._reports.problem = Deviation(f"{error}; zero was sent instead")
            self.apply(0.0)
        except OSError as error:
            self._reports.problem = Deviation(f"the bus failed: {error}")

    def _may_ask_for_mode(self) -> bool:
        """Not where it is mapped; and where the period has no room, which delays SYNC, not while the axis moves."""
        return not self._mode_at and (self._has_room or self._pace.speed <= self._slow)

    def pending_fault(self) -> str:
        """The fault in which the drive was found, or is on the way to power, in words; empty where there is none."""
        now = self._last.statusword or self._found.statusword
        return fault_texts.standing_fault(self._settings.node, now, self._found, self._reports.signs)

    def reset_fault(self) -> None:
        """Hold bit 7 until the drive's fault is gone, without power.  Raises DriveError where it stays."""
        begun = due = self._now()
        gone = ConsecutiveCycles(OLD_ANSWERS)
        while (elapsed := self._now() - begun) < RESET_TIME:
            self.sample()
            if gone.certain(not self._silent and self._last.statusword & _FAULT_BIT == 0):
                break
            self._walk.controlword = fault_reset(elapsed)
            self.apply(0.0)
            due = self._rest(due)
        else:
            raise fault_texts.not_reset(self._settings.node, self._last.statusword, self._found, self._reports.signs)
        self.ask(Power.OFF)
        self.apply(0.0)
        self._found, self._reports.emergency, self._reports.problem = FoundState(), None, None

    def describe(self) -> dict[str, str]:
        """Identity, time-outs, option codes in words and scales, as read back from the drive."""
        s = self._settings
        unwatched = ", ".join(map(str, self._reports.watch.unshown)) or "none"
        watched = {"statusword bits never shown, and not watched": unwatched} if self._reports.signs.answered else {}
        return {"drive": f"CANopen node {s.node} on {s.interface} {s.channel}", **self._description, **watched}

    def explain(self) -> str:
        """The last fault in words, probable causes, next command; on the way to power, where the drive hangs."""
        node, last = self._settings.node, self._reason or self._last
        if self._reason is None and (pending := self.pending_fault()):
            return pending
        if last is not self._reason and last.fault is Fault.DRIVE_FAULT:
            last = last._replace(fault=Fault.NONE)  # it has no power because nobody asked for it
        if self._reports.walking and self._last.fault is not Fault.BUS:
            return fault_texts.not_enabled(node, self._last, self._reports.signs)
        return fault_texts.explained(node, last, self._reports.signs)

    def close(self) -> None:
        """Disable voltage, take the node out of operation, close the bus; safe to call twice, never raises.

        Where a brake is not known to hold, the drive is left as by a controller that dies: it holds the axis by itself.
        """
        if self._closed:
            return
        self._closed = True
        if self._walk.power is not Power.OFF:
            self.ask(Power.ENGAGE)
        self._hold_until_engaged()
        with contextlib.suppress(OSError):  # a dead bus carries nothing
            if not self._walk.waits:
                self._cut()
            self._line.manage(cia402.NMT_PRE_OPERATIONAL)
        with contextlib.suppress(OSError):
            self._bus.close()

    def _cut(self) -> None:
        """No voltage, by the cyclic command and by SDO: either may be lost.  Raises OSError."""
        self.ask(Power.OFF)
        self.apply(0.0)
        self._bus.send(_SYNC)  # the RPDO acts with it
        self._line.write(cia402.CONTROLWORD, 0, self._walk.controlword)

    def _hold_until_engaged(self) -> None:
        """Go on until the brake that was set holds, or the drive is gone: to leave earlier lets the axis drop."""
        due, gone = self._now(), ConsecutiveCycles(REPEAT_COMMAND_CYCLES)
        while self._walk.waits and not gone.certain(self._silent):
            self.sample()
            self.apply(self._command.current)  # what carried the axis last
            due = self._rest(due)

    def _failed(self, fault: Fault, problem: Deviation | None = None) -> Feedback:
        self._reports.problem = problem or self._reports.problem
        return self._noted(self._last._replace(current=math.nan, fault=fault))

    def _noted(self, now: Feedback) -> Feedback:
        self._last = now
        if now.fault and self._reports.serving:  # what comes after it, and after a stop, is only its consequence
            self._reason, self._reports.serving = now, False
        return now

    def _walked(self, now: Feedback) -> Feedback:
        """A step towards Operation enabled; once there, no fault later leads there again by itself."""
        state = self._walk.step(now)
        self._brake.watch(state is DriveState.OPERATION_ENABLED)
        self._mode.shown()
        self._reports.proving = now.fault is Fault.NONE and not self._reports.watch.mode_shown
        proven = self._walk.certain and self._reports.watch.mode_shown and self._reports.watch.learned
        if now.fault is Fault.NONE and not (proven and self._brake.released()):
            return now._replace(fault=Fault.DRIVE_FAULT)  # not yet: mode before release, release before motion
        self._reports.serving = now.fault is Fault.NONE
        self._reports.walking = not self._reports.serving
        if state is DriveState.OPERATION_ENABLED:
            self._reports.emergency = None  # an old one: the drive runs, and would not with an error present
        return now

    def _standstill(self) -> Standstill:
        return Standstill.of_ramp(self._settings.quick_stop_deceleration, self._step, self._dt)

    def _rest(self, due: float) -> float:
        """Sleep to the end of the period that began at `due`; start of the next one."""
        due = max(due + self._dt, self._now() - self._dt)
        self._clock.sleep(max(due - self._now(), 0.0))
        return due
