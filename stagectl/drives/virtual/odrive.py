"""A virtual ODrive on a pty: ASCII protocol, torque mode, the stage model inside, the line as slow as its baud rate."""

import contextlib
import math
import os
import select
import time
import tty
from collections.abc import Callable
from pathlib import Path

from stagectl.drives.clock import WALL, Clock
from stagectl.drives.cycle_time import CHARACTER_BITS
from stagectl.drives.drive import DriveError, Odrive
from stagectl.drives.limits import CLOCK_TICK, ODRIVE_LINE
from stagectl.drives.odrive import CLOSED_LOOP, IDLE, TORQUE_CONTROL, TURN, WATCHDOG_EXPIRED
from stagectl.drives.simulated import Plant


class VirtualOdrive:
    """The drive: lines in, lines out, and a plant that follows the clock."""

    def __init__(self, settings: Odrive, plant: Plant, clock: Clock = WALL) -> None:
        self.plant, self._settings, self._clock = plant, settings, clock
        self._time = self._fed = clock.now()
        self._axis = f"axis{settings.axis}."
        self.values: dict[str, float] = {
            "current_state": IDLE,
            "active_errors": 0,
            "controller.config.control_mode": 3,  # position, as it comes
            "controller.config.input_mode": 1,
            "config.watchdog_timeout": 0.0,
            "config.enable_watchdog": 0,
        }

    @property
    def enabled(self) -> bool:
        """Whether current may flow."""
        return self.values["current_state"] == CLOSED_LOOP

    def look(self) -> None:
        """Let plant and watchdog follow the clock."""
        now = self._clock.now()
        if now > self._time:
            self.plant.drift(min(now - self._time, 1.0))
            self._time = now
        limit = self.values["config.watchdog_timeout"]
        if self.enabled and self.values["config.enable_watchdog"] and now - self._fed > limit:
            self.values["active_errors"] = WATCHDOG_EXPIRED
            self._power(IDLE)

    def obey(self, line: str) -> str:
        """Answer to one line; empty where it has none."""
        self.look()
        words = line.split(";")[0].split("*")[0].split()
        if not words:
            return ""
        try:
            return self._command(words[0], words[1:])
        except (ValueError, IndexError, KeyError):
            return "invalid command format"

    def _command(self, verb: str, words: list[str]) -> str:
        if verb == "f" and int(words[0]) == self._settings.axis:
            self.plant.latch()
            return f"{self.plant.position / TURN:.6f} {self.plant.state.velocity / TURN:.6f}"
        if verb == "c" and int(words[0]) == self._settings.axis:
            return self._torque(float(words[1]))
        if verb == "r":
            value = self.values[words[0].removeprefix(self._axis)]
            return str(int(value)) if float(value).is_integer() else f"{value:.6f}"
        if verb == "w":
            return self._write(words[0].removeprefix(self._axis), float(words[1]))
        if verb == "sc":
            self.values["active_errors"] = 0
            return ""
        if verb == "u":
            self._fed = self._clock.now()
            return ""
        return "unknown command"

    def _torque(self, torque: float) -> str:
        self._fed = self._clock.now()
        torque_mode = self.values["controller.config.control_mode"] == TORQUE_CONTROL
        if math.isfinite(torque) and self.enabled and torque_mode:
            self.plant.command(torque / self._settings.torque_constant)
        return ""

    def _write(self, name: str, value: float) -> str:
        if not math.isfinite(value):
            raise ValueError(name)
        if name == "requested_state":
            self._power(int(value) if not self.values["active_errors"] else IDLE)
        elif name in self.values and name not in ("current_state", "active_errors"):
            self.values[name] = value
        else:
            return "invalid property"
        return ""

    def _power(self, state: int) -> None:
        self.values["current_state"] = CLOSED_LOOP if state == CLOSED_LOOP else IDLE
        self.plant.powered = self.enabled
        self.plant.command(0.0)


class Pty:
    """The drive's end of the line; each character takes its time, both ways."""

    def __init__(self, drive: VirtualOdrive, port: str, baud: float) -> None:
        """Make `port` a name for the line.  Raises DriveError where something else has that name."""
        self._drive, self._baud, self._port = drive, baud, Path(port)
        self._line, self._child = os.openpty()
        tty.setraw(self._child)
        os.set_blocking(self._line, False)
        self._text, self._free = b"", time.monotonic()
        if self._port.is_symlink() and not self._port.exists():
            self._port.unlink()  # left by one that was killed
        try:
            self._port.symlink_to(os.ttyname(self._child))
        except OSError as error:
            raise DriveError(
                f"drive.wire.port = {port}: {error.strerror}; a virtual ODrive needs a free name", place=port
            ) from error

    def run(self, until: Callable[[], bool]) -> None:
        """Serve the line until `until` returns True."""
        while not until():
            if select.select([self._line], [], [], CLOCK_TICK)[0]:
                self._take(os.read(self._line, 4096))
            self._drive.look()

    def close(self) -> None:
        """Take the name away and close the line."""
        self._port.unlink(missing_ok=True)
        os.close(self._line)
        os.close(self._child)

    def _take(self, text: bytes) -> None:
        *lines, self._text = (self._text + text).split(b"\n")
        self._text = self._text[-ODRIVE_LINE:]
        for line in lines:
            self._spend(len(line) + 1)
            answer = self._drive.obey(line[:ODRIVE_LINE].decode("ascii", "replace"))
            if answer:
                self._spend(len(answer) + 2)
                with contextlib.suppress(BlockingIOError):  # nobody reads
                    os.write(self._line, answer.encode() + b"\r\n")

    def _spend(self, characters: int) -> None:
        """Let the time go by that so many characters take on the line."""
        self._free = max(self._free, time.monotonic()) + characters * CHARACTER_BITS / self._baud
        time.sleep(max(self._free - time.monotonic(), 0.0))
