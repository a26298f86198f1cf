"""Wires that cannot carry a cycle every control period, with the figures that say so."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from stagectl.config.source import ConfigError
from stagectl.config.stage_file import load_stage
from stagectl.config.wire_checks import slow_odrive, slow_slcan, unusable
from stagectl.drives.drive import Canopen, Odrive
from stagectl.problem import ProblemKind
from tests.conftest import CONFIG, half_second, movable
from tests.problems import refused


def adapter(channel: str, interface: str = "slcan") -> Canopen:
    return Canopen("a.eds", 5, 10.0, 0.01, 0.01, 1.0, interface, channel)


@pytest.mark.parametrize(
    ("channel", "period", "kind", "figures"),
    [
        ("/dev/ttyACM0@3000000", 0.001, None, ""),
        ("/dev/ttyUSB0", 0.01, None, ""),
        ("/dev/ttyUSB0", 0.002, ProblemKind.CONFLICT, "54 characters, take 5.01 ms of a period of 2 ms"),
        ("/dev/ttyUSB0@115200", 0.005, ProblemKind.CONFLICT, "6.27 ms"),
        ("/dev/ttyUSB0@fast", 0.01, ProblemKind.RANGE, "[9600, 12000000]"),
    ],
)
def test_a_serial_adapter(channel: str, period: float, kind: ProblemKind | None, figures: str) -> None:
    problems = list(slow_slcan(adapter(channel), period))
    assert [problem.kind for problem in problems] == ([kind] if kind else [])
    assert all(problem.key == "drive.wire.channel" and figures in str(problem) for problem in problems)
    assert list(slow_slcan(adapter(channel, "socketcan"), period)) == []


@pytest.mark.parametrize(
    ("interface", "channel", "key", "kind"),
    [
        ("embedded", "stage", "", None),
        ("socketcan", "can0", "", None),
        ("pcan", "PCAN_USBBUS1", "", None),  # whether its driver is there, the doctor says
        ("socketcand", "can0@bench.local:29536", "", None),
        ("socketcand", "can0", "channel", ProblemKind.VALUE),
        ("socketcand", "can0@bench:0", "channel", ProblemKind.VALUE),
        ("virtual", "stage", "interface", ProblemKind.CONFLICT),
        ("udp_multicast", "239.74.163.2", "interface", ProblemKind.CONFLICT),
        ("socketkan", "can0", "interface", ProblemKind.VALUE),
    ],
)
def test_an_interface_reaches_another_process(interface: str, channel: str, key: str, kind: ProblemKind | None) -> None:
    problems = [(problem.key, problem.kind) for problem in unusable(adapter(channel, interface))]
    assert problems == ([(f"drive.wire.{key}", kind)] if kind else [])


@pytest.mark.parametrize("name", ["command", "current"])
def test_a_count_of_the_torque_is_a_thousandth_of_the_rated_current(tmp_path: Path, name: str) -> None:
    text = movable((CONFIG / "ball-screw.yaml").read_text())
    place = tmp_path / "stage.yaml"
    place.write_text(text.replace(f"{name}_scale: 4 mA", f"{name}_scale: 1 mA"))
    with refused(ConfigError, kind=ProblemKind.CONFLICT, key=f"drive.wire.{name}_scale", value="1 mA"):
        load_stage(place)


def test_the_line_to_an_odrive() -> None:
    wire = Odrive("/dev/ttyACM0", 0.72)
    assert list(slow_odrive(wire, 0.01)) == []
    (problem,) = slow_odrive(wire, 0.002)
    assert (problem.kind, problem.key, problem.value) == (ProblemKind.CONFLICT, "drive.wire.baud", "115200 bit/s")
    assert "take 6.86 ms of a period of 2 ms" in problem.reason and "at least 8.57 ms" in problem.remedy


@pytest.mark.parametrize(
    ("old", "new", "kind", "key"),
    [
        ("command_object: 0x6071_00", "command_object: 0x6071_00\n    rpdo: [5]", ProblemKind.RANGE, "rpdo"),
        ("command_object: 0x6071_00", "command_object: 6071", ProblemKind.RANGE, "command_object"),
        ("heartbeat_timeout: 500 ms", "heartbeat_timeout: 50 ms", ProblemKind.CONFLICT, "heartbeat_timeout"),
        ("rpdo_timeout: 500 ms", "rpdo_timeout: 0.4 ms", ProblemKind.CONFLICT, "rpdo_timeout"),
    ],
)
def test_what_the_cycle_of_a_canopen_drive_needs(
    tmp_path: Path, old: str, new: str, kind: ProblemKind, key: str
) -> None:
    text = half_second(movable((CONFIG / "ball-screw.yaml").read_text()))
    assert text.count(old) == 1
    (tmp_path / "stage.yaml").write_text(text.replace(old, new))
    with refused(ConfigError, kind=kind, key=f"drive.wire.{key}"):
        load_stage(tmp_path / "stage.yaml")


def test_the_limit_of_the_bus_is_met_on_both_sides(tmp_path: Path) -> None:
    text = movable((CONFIG / "ball-screw.yaml").read_text())
    needed = 325 * 2000 / 0.8 / 1e3  # kbit/s: 55 + 2 x 135 bits 2000 times a second in 80 % of the bus
    for rate, accepted in ((math.ceil(needed), True), (math.floor(needed) - 1, False)):
        (tmp_path / "stage.yaml").write_text(text.replace("bitrate: 1 Mbit/s", f"bitrate: {rate} kbit/s"))
        if accepted:
            load_stage(tmp_path / "stage.yaml")
        else:
            with refused(ConfigError, key="drive.wire.bitrate", unit="bit/s"):
                load_stage(tmp_path / "stage.yaml")
