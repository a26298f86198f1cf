"""Homing by the drive (CiA 402, mode of operation 6), under power and in the running cycle.

::

    mode 6 ordered --shown--> bit 4 set --bits 12 and 10--> mode 10 ordered --shown--> over
                                  `--bit 13--> Fault.HOMING

In mode 6 the drive moves the axis itself, and our current has no effect.  At its home it sets its position anew: the
origin jumps.  Nothing is believed of bits 12 and 13 before they were seen cleared: they may be those of the mode or
homing before, and a TPDO may be a period old.
"""

import math

from stagectl.drives.canopen import cia402, fault_texts
from stagectl.drives.canopen.pdo import CommandPdo
from stagectl.drives.canopen.reports import DriveLine, Reports
from stagectl.drives.drive import Fault, Feedback
from stagectl.drives.limits import MODE_REPEAT, MODE_TIME, STALE_TIME

_ENABLED = cia402.DeviceCommand.ENABLE_OPERATION.controlword
_FOUND = cia402.HOMING_ATTAINED | cia402.TARGET_REACHED
_ENDED = cia402.HOMING_ATTAINED | cia402.HOMING_ERROR


class ModeSwitch:
    """The mode of operation of a drive whose cycle goes on: ordered, and again until the drive shows it."""

    def __init__(self, line: DriveLine, command: CommandPdo, reports: Reports) -> None:
        self._line, self._command, self.reports = line, command, reports
        self._begun = self._due = math.nan

    def to(self, mode: int) -> None:
        """Order a mode; `shown` says when the drive has it."""
        self.reports.watch.want(mode)
        self._command.order_mode(mode)
        self._begun = self._due = self.reports.now()

    def back(self) -> None:
        """Cyclic synchronous torque again, if another mode was ordered."""
        if self.reports.watch.wanted != cia402.CYCLIC_SYNCHRONOUS_TORQUE:
            self.to(cia402.CYCLIC_SYNCHRONOUS_TORQUE)

    def shown(self) -> bool:
        """Whether the drive shows the ordered mode; until then it is ordered again from time to time."""
        watch, now = self.reports.watch, self.reports.now()
        if not watch.mode_shown and now >= self._due:  # NaN: no other mode was ever ordered
            self._due = now + MODE_REPEAT
            self._line.write(cia402.MODE, 0, watch.wanted)
        return watch.mode_shown

    @property
    def refused(self) -> bool:
        """Whether the drive has had its time."""
        return not self.reports.watch.mode_shown and self.reports.now() - self._begun > MODE_TIME


class DriveHoming:
    """One homing; `step` has the feedback of each period, `controlword` goes out with its command."""

    def __init__(self, mode: ModeSwitch) -> None:
        self._mode, self._now = mode, mode.reports.now
        self.controlword = _ENABLED
        self._started, self._cleared, self._found = math.inf, False, False
        mode.to(cia402.HOMING)

    def step(self, now: Feedback) -> Feedback:
        """Feedback of the period, `busy` until the drive is back in its cyclic mode; Fault.HOMING where it fails."""
        if now.fault is not Fault.NONE:
            return now
        if not self._mode.shown():
            return self._failed(now, self._untaken()) if self._mode.refused else now._replace(busy=True)
        return now if self._found else self._searched(now)

    def _searched(self, now: Feedback) -> Feedback:
        self._started = min(self._started, self._now())
        self.controlword = _ENABLED | cia402.HOMING_START
        bits = now.statusword
        self._cleared = self._cleared or not bits & _ENDED
        if self._cleared or self._now() - self._started > STALE_TIME:
            if bits & cia402.HOMING_ERROR:
                return self._failed(now, fault_texts.HOMING_FAILED)
            if bits & _FOUND == _FOUND:
                self._found, self.controlword = True, _ENABLED
                self._mode.back()
        return now._replace(busy=True)

    def _untaken(self) -> fault_texts.Deviation:
        watch = self._mode.reports.watch
        return fault_texts.UNTAKEN_MODE.filled(watch.wanted, watch.last_mode)

    def _failed(self, now: Feedback, problem: fault_texts.Deviation) -> Feedback:
        self._mode.reports.problem = problem
        return now._replace(fault=Fault.HOMING)
