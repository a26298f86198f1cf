"""An ODrive in torque mode over its ASCII protocol: our side of a serial line.

::

    sample()  "f 0"        ------->
              <-------  "turns turns/s"      now and then also "r axis0.current_state"
    apply()   "c 0 torque" ------->          acts as it arrives, and feeds the drive's watchdog

The answer has no room for a state, so that is asked for each `_STATE_EVERY` cycles.  In torque mode the drive has no
ramp of its own: a stop is category 0, power off, and friction stops the axis.  Its watchdog does the same where we fall
silent.

Source: ODrive Robotics, ASCII Protocol and ODrive API reference, firmware 0.5 and 0.6.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
from typing import Any

from stagectl.drives.canopen.cia402 import State
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import DriveError, Fault, Feedback, Odrive, Power

IDLE, CLOSED_LOOP, TORQUE_CONTROL, PASSTHROUGH = 1, 8, 1, 1  # of the ODrive's own enumerations
_STATE_EVERY = 8  # cycles
_ENABLE_TIME = 5.0  # s
_MOST = 9999.0  # N m that fit the command
_TURN = 2.0 * math.pi


def open_odrive(settings: Odrive, dt: float, clock: Clock = WALL) -> OdriveDrive:
    """The drive on its port.  Raises DriveError."""
    line = Line(settings.port, settings.baud, clock)
    try:
        return OdriveDrive(settings, line, dt, clock)
    except DriveError:
        line.close()
        raise


class Line:
    """Lines of text over a serial port."""

    def __init__(self, port: str, baud: float, clock: Clock) -> None:
        """Open it.  Raises DriveError."""
        import serial

        try:
            self._port: Any = serial.Serial(port, round(baud), timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            raise DriveError(
                f"drive.wire.port = {port}: {error}; is the drive connected, and may you read and write the port"
                " (group dialout)?"
            ) from error
        self._port.reset_input_buffer()
        self._descriptor, self._clock, self._text = self._port.fileno(), clock, b""

    def say(self, text: str) -> None:
        """Send one line.  Raises OSError."""
        os.write(self._descriptor, text.encode() + b"\n")

    def hear(self, timeout: float) -> str | None:
        """Next line, or None after `timeout` (s).  Raises OSError."""
        deadline = self._clock.now() + timeout
        while b"\n" not in self._text:
            left = deadline - self._clock.now()
            if not select.select([self._descriptor], [], [], max(left, 0.0))[0]:
                return None
            self._text += os.read(self._descriptor, 4096)
            if len(self._text) > 65536:  # noise without any end of line
                self._text = b""
        line, self._text = self._text.split(b"\n", 1)
        return line.decode("ascii", "replace").strip()

    def close(self) -> None:
        """Leave the port."""
        self._port.close()


class OdriveDrive:
    """The drive protocol over a serial line; see `stagectl.drives.drive.Drive`."""

    def __init__(self, settings: Odrive, line: Line, dt: float, clock: Clock = WALL) -> None:
        """Find the drive and put it into torque mode, without power.  Raises DriveError."""
        self._settings, self._line, self._dt, self._clock = settings, line, dt, clock
        self._axis = f"axis{settings.axis}"
        self._last = Feedback(0.0, math.nan, 0, Fault.NONE)
        self._state, self._cycles, self._errors, self._closed = IDLE, 0, 0, False
        try:
            self._reported = self._configure()
        except OSError as error:
            raise DriveError(f"drive.wire.port = {settings.port} failed: {error}; connect it again") from error

    def enable(self) -> Feedback:
        """Closed loop in torque mode at zero torque.  Raises DriveError."""
        self.ask(Power.ON)
        deadline = self._clock.now() + _ENABLE_TIME
        while self._clock.now() < deadline:
            self._cycles = 0  # the state, each time
            now = self.sample()
            if now.fault is Fault.NONE:
                return now
            self.apply(0.0)
            self._clock.sleep(self._dt)
        raise DriveError(f"the ODrive does not reach closed loop control within {_ENABLE_TIME:g} s. {self.explain()}")

    def ask(self, power: Power) -> None:
        """Ask for closed loop control, or for no power: it has no ramp of its own in torque mode."""
        with contextlib.suppress(OSError):  # told by the next `sample`
            if power is Power.ON:
                self._line.say("sc")
                self.apply(0.0)  # feeds the watchdog, which would trip at once
            self._line.say(f"w {self._axis}.requested_state {CLOSED_LOOP if power is Power.ON else IDLE}")
        self._cycles = 0

    def sample(self) -> Feedback:
        """Position from the drive's answer; never raises."""
        try:
            while self._line.hear(0.0) is not None:
                pass  # late answers must not be taken for this one
            if self._cycles <= 0:
                self._cycles = _STATE_EVERY
                self._line.say(f"r {self._axis}.current_state")
                self._state = int(self._number("state"))
            self._cycles -= 1
            self._line.say(f"f {self._settings.axis}")
            turns = self._number("feedback")
        except OSError:
            return self._noted(self._last._replace(fault=Fault.BUS))
        if math.isnan(turns):
            return self._noted(self._last._replace(fault=Fault.FEEDBACK_LOST))
        enabled = self._state == CLOSED_LOOP
        word = (State.OPERATION_ENABLED if enabled else State.SWITCH_ON_DISABLED).value[1]
        return self._noted(Feedback(turns * _TURN, math.nan, word, Fault.NONE if enabled else Fault.DRIVE_FAULT))

    def apply(self, current: float) -> None:
        """Send the torque of `current` (A); never raises."""
        torque = current * self._settings.torque_constant
        if not -_MOST < torque < _MOST:  # NaN, too
            torque = 0.0
        with contextlib.suppress(OSError):
            self._line.say(f"c {self._settings.axis} {torque:.6f}")

    def quick_stop(self) -> Feedback:
        """Take the power; friction stops the axis."""
        self.ask(Power.OFF)
        return self.sample()

    def describe(self) -> dict[str, str]:
        """What it is and does, as read back."""
        return self._reported

    def explain(self) -> str:
        """Its error, and the next step."""
        error = self._read("active_errors")
        said = "it does not answer" if math.isnan(error) else f"active errors 0x{int(error):X}, state {self._state}"
        return f"ODrive {self._axis}: {said}. See `odrivetool` dump_errors, remove the cause, then start the run again"

    def close(self) -> None:
        """Take the power and leave the line; safe twice, never raises."""
        if self._closed:
            return
        self._closed = True
        with contextlib.suppress(OSError):
            self._line.say(f"c {self._settings.axis} 0")
            self._line.say(f"w {self._axis}.requested_state {IDLE}")
        with contextlib.suppress(OSError):
            self._line.close()

    def _configure(self) -> dict[str, str]:
        """Torque mode and watchdog, both read back; what it is, in words."""
        s, told = (
            self._settings,
            {"drive": f"ODrive {self._axis} on {self._settings.port} at {self._settings.baud:g} baud"},
        )
        wanted = {
            "requested_state": IDLE,
            "controller.config.control_mode": TORQUE_CONTROL,
            "controller.config.input_mode": PASSTHROUGH,
            "config.watchdog_timeout": s.watchdog,
            "config.enable_watchdog": int(s.watchdog > 0.0),
        }
        for name, value in wanted.items():
            self._line.say(f"w {self._axis}.{name} {value:g}")
        for name in list(wanted)[1:]:
            found = self._read(name)
            if not math.isclose(found, wanted[name], rel_tol=1e-3, abs_tol=1e-6):
                raise DriveError(
                    f"{self._axis}.{name} of the ODrive on {s.port} reads {found:g} after {wanted[name]:g} was written:"
                    " is it powered, is the baud rate that of the drive, and its firmware 0.5 or newer?"
                )
            told[name] = f"{found:g}"
        told["stop"] = "category 0: no ramp of its own in torque mode, the axis coasts"
        return told

    def _read(self, name: str) -> float:
        try:
            self._line.say(f"r {self._axis}.{name}")
            return self._number("")
        except OSError:
            return math.nan

    def _number(self, what: str) -> float:
        """First number of the next line that begins with one; NaN, or the old state, after the time-out."""
        deadline = self._clock.now() + self._settings.feedback_timeout
        while (line := self._line.hear(max(deadline - self._clock.now(), 0.0))) is not None:
            words = line.split()
            with contextlib.suppress(ValueError):
                if len(words) == 1 + (what == "feedback") and all(map(math.isfinite, map(float, words))):
                    return float(words[0])
        return float(self._state) if what == "state" else math.nan

    def _noted(self, now: Feedback) -> Feedback:
        self._last = now
        return now
