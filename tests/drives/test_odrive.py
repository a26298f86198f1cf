"""An ODrive over a pty: the protocol's lines, a motion, its watchdog, and what the configuration refuses."""

from __future__ import annotations

import math
import os
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from stagectl.config.source import ConfigError
from stagectl.config.stage_file import load_stage
from stagectl.drives import cycle_time
from stagectl.drives.bus.virtual_time import Timeline
from stagectl.drives.drive import DriveError, Fault, Odrive, Simulation
from stagectl.drives.odrive import OdriveDrive, open_odrive
from stagectl.drives.simulated import Plant
from stagectl.drives.virtual.odrive import Pty, VirtualOdrive
from tests.conftest import CONFIG
from tests.drives.workbench import enabled, linear_stage, stopped
from tests.problems import refused

DT = 0.005
TURN = 2.0 * math.pi


def settings(port: str = "unused", **changes: Any) -> Odrive:
    return Odrive(port, 0.5, feedback_timeout=0.2, watchdog=0.3)._replace(**changes)


def plant() -> Plant:
    return Plant(linear_stage(), Simulation(substeps=2), DT)


class Wired:
    """A line without a wire: what is said is answered at once, on a clock that the test moves."""

    def __init__(self, virtual: VirtualOdrive, clock: Timeline) -> None:
        self.virtual, self.clock, self.out, self.deaf = virtual, clock, list[str](), False

    def send(self, text: str) -> None:
        self.clock.sleep(1e-4)
        answer = "" if self.deaf else self.virtual.obey(text)
        if answer:
            self.out.append(answer)

    def receive(self, timeout: float) -> str | None:
        if self.out:
            return self.out.pop(0)
        self.clock.sleep(timeout)
        return None

    def close(self) -> None:
        """Nothing is open."""


@pytest.fixture
def wired() -> Wired:
    clock = Timeline()
    return Wired(VirtualOdrive(settings(), plant(), clock), clock)


def drive_on(wired: Wired) -> OdriveDrive:
    return OdriveDrive(settings(), wired, DT, wired.clock)  # type: ignore[arg-type]


def test_it_moves_and_coasts_to_a_stand(wired: Wired) -> None:
    virtual, drive = wired.virtual, drive_on(wired)
    assert virtual.values["controller.config.control_mode"] == 1 and not virtual.enabled
    assert enabled(drive, wired.clock).fault is Fault.NONE
    seen = []
    for _ in range(30):
        now = drive.sample()
        assert now.fault is Fault.NONE
        seen.append(now.position)
        drive.apply(1.0)
        wired.clock.sleep(DT)
    assert seen == sorted(seen) and seen[-1] > 1e-2
    assert virtual.plant.state.velocity == pytest.approx(4.5 * 30 * (DT + 2e-4), rel=0.1)
    assert stopped(drive, wired.clock).fault is Fault.DRIVE_FAULT  # no power any more
    assert not virtual.enabled
    assert drive.describe()["stop"].startswith("category 0")
    drive.close()
    drive.close()


def test_its_watchdog_takes_the_power_and_we_notice(wired: Wired) -> None:
    drive = drive_on(wired)
    enabled(drive, wired.clock)
    wired.clock.sleep(0.4)  # silent for longer than the watchdog
    faults = [drive.sample().fault for _ in range(10)]
    assert faults[-1] is Fault.DRIVE_FAULT and not wired.virtual.enabled
    assert "active errors 0x1000000" in drive.explain()
    drive.reset_fault()
    assert enabled(drive, wired.clock).fault is Fault.NONE
    wired.deaf = True
    before = wired.clock.now()
    assert drive.sample().fault is Fault.FEEDBACK_LOST
    assert 0.2 <= wired.clock.now() - before < 0.5  # feedback_timeout, and that of the state at most
    drive.apply(math.nan)  # never raises


def test_noise_on_the_line_is_no_answer(wired: Wired) -> None:
    drive = drive_on(wired)
    enabled(drive, wired.clock)
    obey = wired.virtual.obey
    wired.virtual.obey = lambda line: "nan \xff 1e999" if line[0] == "f" else obey(line)  # type: ignore[method-assign]
    assert drive.sample().fault is Fault.FEEDBACK_LOST


def test_both_ends_of_a_pty(tmp_path: Path) -> None:
    wire = settings(str(tmp_path / "odrive"), baud=921600.0, feedback_timeout=20.0, watchdog=0.0)
    virtual, over = VirtualOdrive(wire, plant()), threading.Event()
    pty = Pty(virtual, wire.port, wire.baud)
    thread = threading.Thread(target=pty.run, args=(over.is_set,))
    thread.start()
    try:
        drive = open_odrive(wire, DT)
        assert enabled(drive).fault is Fault.NONE
        for _ in range(5):
            drive.apply(1.0)
            now = drive.sample()
        assert now.fault is Fault.NONE and now.position > 0.0 and virtual.enabled
        drive.close()
        while virtual.enabled:
            time.sleep(0.001)
    finally:
        over.set()
        thread.join()
        pty.close()
    assert not os.path.lexists(wire.port)


def test_the_lines_are_those_of_the_protocol() -> None:
    clock = Timeline()
    virtual = VirtualOdrive(settings(), plant(), clock)
    assert virtual.obey("f 0") == "0.000000 0.000000"
    assert virtual.obey("f 0 ; a comment") == "0.000000 0.000000"
    assert virtual.obey("r axis0.current_state") == "1"
    assert virtual.obey("r axis0.active_errors") == "0"
    assert virtual.obey("w axis0.current_state 8") == "invalid property"
    for line in ("f", "f x", "c 0", "w axis0.config", "w axis0.config.watchdog_timeout inf", "r axis0.nothing"):
        assert virtual.obey(line) == "invalid command format", line
    assert virtual.obey("zz 1") == "unknown command"
    assert virtual.obey("c 0 100") == "" and virtual.plant.state.velocity == 0.0
    for line in ("w axis0.controller.config.control_mode 1", "w axis0.requested_state 8", "c 0 0.5"):
        assert virtual.obey(line) == ""
    clock.sleep(0.1)
    turns, speed = map(float, virtual.obey("f 0").split())
    # 0.5 N m over 0.5 N m/A is 1 A, 50 N, less about 5 N of friction, on 10 kg for 0.1 s
    assert speed * TURN == pytest.approx(4.5 * 0.1, rel=0.05)
    assert turns * TURN == pytest.approx(0.5 * 4.5 * 0.1**2, rel=0.05)


def test_the_watchdog_is_fed_by_commands_only() -> None:
    clock = Timeline()
    virtual = VirtualOdrive(settings(), plant(), clock)
    for line in ("w axis0.config.watchdog_timeout 0.1", "w axis0.config.enable_watchdog 1", "c 0 0"):
        virtual.obey(line)
    virtual.obey("w axis0.requested_state 8")
    for _ in range(5):
        clock.sleep(0.08)
        virtual.obey("c 0 0")
    assert virtual.enabled
    clock.sleep(0.06)
    virtual.obey("f 0")
    clock.sleep(0.06)
    virtual.obey("f 0")
    assert (virtual.enabled, virtual.values["active_errors"]) == (False, 0x0100_0000)
    virtual.obey("w axis0.requested_state 8")
    assert not virtual.enabled  # the error must be cleared first


def test_the_time_of_a_cycle_is_that_of_its_characters() -> None:
    # "f 0", "c 0 -9999.000000", an answer of two numbers with thirteen digits, and the state both ways
    assert len("c 0 -9999.000000\n") == cycle_time.ODRIVE_COMMAND
    assert len("r axis0.current_state\n") + len("8\r\n") + 1 == cycle_time.ODRIVE_STATE
    assert cycle_time.odrive_cycle(115200.0) == pytest.approx(79 * 10 / 115200)


def test_a_stage_file_takes_an_odrive(tmp_path: Path) -> None:
    text = (CONFIG / "odrive.yaml").read_text()
    path = tmp_path / "stage.yaml"
    path.write_text(text)
    assert load_stage(path).file.drive.wire == Odrive("odrive", 0.72, 921600.0)
    for old, new, key in (
        ("baud: 921600 bit/s", "baud: 9600 bit/s", "drive.wire.baud"),
        ("delay_samples: 1", "delay_samples: 0", "drive.delay_samples"),
        ("port: odrive", "prt: odrive", "drive.wire.prt"),
        ("baud: 921600 bit/s", "watchdog: 0 s", "drive.wire.watchdog"),  # nothing else stops it without us
    ):
        assert old in text
        path.write_text(text.replace(old, new))
        with refused(ConfigError, key=key):
            load_stage(path)


def test_a_port_that_is_not_there_and_a_name_that_is_taken(tmp_path: Path) -> None:
    for port, advice in ((str(tmp_path / "nothing"), "connect the drive"), ("nothing", "stagectl virtual-drive")):
        with pytest.raises(DriveError, match=advice) as absent:
            open_odrive(settings(port), DT)
        assert absent.value.place == port and "Errno" not in str(absent.value)
    (tmp_path / "taken").write_text("")
    with pytest.raises(DriveError, match="port") as caught:
        Pty(VirtualOdrive(settings(), plant()), str(tmp_path / "taken"), 9600.0)
    assert caught.value.place == str(tmp_path / "taken")
