"""An ODrive in torque mode over its ASCII protocol: our side of a serial line.

::

    sample()  "f 0"        ------->
              <-------  "turns turns/s"      now and then also "r axis0.current_state"
    apply()   "c 0 torque" ------->          acts as it arrives, and feeds the drive's watchdog

The answer has no room for a state, so that is asked for each `STATE_CYCLES` cycles.  In torque mode the drive has no
ramp of its own: a stop is category 0, power off, and friction stops the axis.  Its watchdog does the same where we fall
silent.

Source: ODrive Robotics, ASCII Protocol and ODrive API reference, firmware 0.5 and 0.6.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import select
from pathlib import Path
from typing import Any

from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import DriveError, Fault, Feedback, Odrive, Power
from stagectl.drives.limits import LARGEST_TORQUE, LONGEST_NOISE, STATE_CYCLES

IDLE, CLOSED_LOOP, TORQUE_CONTROL, PASSTHROUGH = 1, 8, 1, 1  # of the ODrive's own enumerations
WATCHDOG_EXPIRED = 0x0100_0000  # of its active errors: nobody has fed the watchdog
TURN = 2.0 * math.pi


def open_odrive(settings: Odrive, dt: float, clock: Clock = WALL) -> OdriveDrive:
    """The drive on its port.  Raises DriveError."""
    line = Line(settings.port, settings.baud, clock)
    try:
        return OdriveDrive(settings, line, dt, clock)
    except DriveError:
        line.close()
        raise


def _unopened(port: str, error: Exception) -> str:
    """Why a port does not open, and what to do; a name that is no path is that of a virtual drive's port."""
    if "/" not in port and not Path(port).exists():
        return "no virtual drive has made this port; start one in another terminal: stagectl virtual-drive STAGE.yaml"
    known = _PORT.get(getattr(error, "errno", None) or 0)
    return known or f"{error}; see `ls -l {port}`"


_PORT = {
    errno.ENOENT: "there is no such port: connect the drive and switch it on, then see `ls /dev/tty*`",
    errno.EACCES: "you may not use this port: join the group dialout and log in again",
    errno.EBUSY: "another program uses this port: end it",
}


class Line:
    """Lines of text over a serial port."""

    def __init__(self, port: str, baud: float, clock: Clock) -> None:
        """Open it.  Raises DriveError."""
        import serial

        try:
            self._port: Any = serial.Serial(port, round(baud), timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            raise DriveError(f"drive.wire.port = {port}: {_unopened(port, error)}", place=port) from error
        self._port.reset_input_buffer()
        self._descriptor, self._clock, self._text = self._port.fileno(), clock, b""

    def send(self, text: str) -> None:
        """Send one line.  Raises OSError."""
        os.write(self._descriptor, text.encode() + b"\n")

    def receive(self, timeout: float) -> str | None:
        """Next line, or None after `timeout` (s).  Raises OSError."""
        deadline = self._clock.now() + timeout
        while b"\n" not in self._text:
            left = deadline - self._clock.now()
            if not select.select([self._descriptor], [], [], max(left, 0.0))[0]:
                return None
            self._text += os.read(self._descriptor, 4096)
            if len(self._text) > LONGEST_NOISE:  # noise without any end of line
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
        self._state, self._cycles, self._closed = IDLE, 0, False
        try:
            self._description = self._configure()
        except OSError as error:
            raise DriveError(
                f"drive.wire.port = {settings.port} failed: {error}; connect it again", place=settings.port
            ) from error

    def ask(self, power: Power) -> None:
        """Ask for closed loop control, or for no power: it has no ramp of its own in torque mode."""
        with contextlib.suppress(OSError):  # the next `sample` reports it
            if power is Power.ON:
                if self._read("active_errors") == WATCHDOG_EXPIRED:  # we were silent, and the axis had no power
                    self._line.send("sc")
                self.apply(0.0)  # feeds the watchdog, which would trip at once
            self._line.send(f"w {self._axis}.requested_state {CLOSED_LOOP if power is Power.ON else IDLE}")
        self._cycles = 0

    def sample(self) -> Feedback:
        """Position from the drive's answer; never raises."""
        try:
            while self._line.receive(0.0) is not None:
                pass  # late answers must not be taken for this one
            if self._cycles <= 0:
                self._cycles = STATE_CYCLES
                self._line.send(f"r {self._axis}.current_state")
                self._state = int(self._number("state"))
            self._cycles -= 1
            self._line.send(f"f {self._settings.axis}")
            turns = self._number("feedback")
        except OSError:
            return self._noted(self._last._replace(fault=Fault.BUS))
        if math.isnan(turns):
            return self._noted(self._last._replace(fault=Fault.FEEDBACK_LOST))
        enabled = self._state == CLOSED_LOOP
        word = (DriveState.OPERATION_ENABLED if enabled else DriveState.SWITCH_ON_DISABLED).value[1]
        return self._noted(Feedback(turns * TURN, math.nan, word, Fault.NONE if enabled else Fault.DRIVE_FAULT))

    def apply(self, current: float) -> None:
        """Send the torque of `current` (A); never raises."""
        torque = current * self._settings.torque_constant
        if not -LARGEST_TORQUE < torque < LARGEST_TORQUE:  # NaN, too
            torque = 0.0
        with contextlib.suppress(OSError):
            self._line.send(f"c {self._settings.axis} {torque:.6f}")

    def position(self) -> float:
        """Where the axis stands (rad | m); NaN where the drive does not say."""
        seen = self.sample()
        return math.nan if seen.fault in (Fault.BUS, Fault.FEEDBACK_LOST) else seen.position

    def pending_fault(self) -> str:
        """The drive's errors, which keep it from getting power."""
        error = self._read("active_errors")
        return "" if error in (0.0, WATCHDOG_EXPIRED) or math.isnan(error) else self.explain()

    def reset_fault(self) -> None:
        """Clear the drive's errors.  Raises DriveError where one stays."""
        with contextlib.suppress(OSError):  # reading them reports it
            self._line.send("sc")
        if words := self.pending_fault():
            raise DriveError(f"the fault reset had no effect: the cause is still there. {words}")

    def describe(self) -> dict[str, str]:
        """Identity and settings, as read back."""
        return self._description

    def explain(self) -> str:
        """The drive's error and the next step."""
        error = self._read("active_errors")
        answer = "it does not answer" if math.isnan(error) else f"active errors 0x{int(error):X}, state {self._state}"
        return (
            f"ODrive {self._axis}: {answer}. See `odrivetool` dump_errors, remove the cause,"
            " then reset: `stagectl fault reset`, or `stagectl run ... --reset-fault`"
        )

    def close(self) -> None:
        """Remove the power and close the line; safe to call twice, never raises."""
        if self._closed:
            return
        self._closed = True
        with contextlib.suppress(OSError):
            self._line.send(f"c {self._settings.axis} 0")
            self._line.send(f"w {self._axis}.requested_state {IDLE}")
        with contextlib.suppress(OSError):
            self._line.close()

    def _configure(self) -> dict[str, str]:
        """Set torque mode and watchdog and read both back; the description.  Raises DriveError."""
        s = self._settings
        description = {"drive": f"ODrive {self._axis} on {s.port} at {s.baud:g} baud"}
        wanted = {
            "requested_state": IDLE,
            "controller.config.control_mode": TORQUE_CONTROL,
            "controller.config.input_mode": PASSTHROUGH,
            "config.watchdog_timeout": s.watchdog,
            "config.enable_watchdog": int(s.watchdog > 0.0),
        }
        for name, value in wanted.items():
            self._line.send(f"w {self._axis}.{name} {value:g}")
        for name in list(wanted)[1:]:
            read_back = self._read(name)
            if not math.isclose(read_back, wanted[name], rel_tol=1e-3, abs_tol=1e-6):
                raise DriveError(
                    f"{self._axis}.{name} of the ODrive on {s.port} reads {read_back:g}, must be {wanted[name]:g}."
                    " Probable causes: no power, another baud rate than the drive's, or firmware older than 0.5",
                    place=name,
                    value=read_back,
                )
            description[name] = f"{read_back:g}"
        description["stop"] = "category 0: no ramp of its own in torque mode, the axis coasts"
        return description

    def _read(self, name: str) -> float:
        try:
            self._line.send(f"r {self._axis}.{name}")
            return self._number("")
        except OSError:
            return math.nan

    def _number(self, kind: str) -> float:
        """First number of the next line that begins with one; NaN, or the old state, after the time-out."""
        deadline = self._clock.now() + self._settings.feedback_timeout
        while (line := self._line.receive(max(deadline - self._clock.now(), 0.0))) is not None:
            words = line.split()
            with contextlib.suppress(ValueError):
                if len(words) == 1 + (kind == "feedback") and all(map(math.isfinite, map(float, words))):
                    return float(words[0])
        return float(self._state) if kind == "state" else math.nan

    def _noted(self, now: Feedback) -> Feedback:
        self._last = now
        return now
