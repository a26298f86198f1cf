"""The doctor: its findings on a machine that a test makes up, and that every finding in red says how to fix it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from stagectl.config.stage_blocks import Retention
from stagectl.config.stage_file import Setup
from stagectl.service import doctor
from stagectl.service.doctor import Check, examine
from tests.conftest import CONFIG, Command
from tests.drives.workbench import Workbench


def found(setup: Setup, folder: Path, served: bool = True) -> dict[str, Check]:
    return {check.name: check for check in examine(setup, folder, served)}


def test_the_machine_by_its_files(ball_screw: Setup, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for cpu, governor in ((0, "performance"), (1, "powersave")):
        place = tmp_path / f"cpu{cpu}" / "cpufreq"
        place.mkdir(parents=True)
        (place / "scaling_governor").write_text(governor + "\n")
    (tmp_path / "isolated").write_text("2-3,7\n")
    monkeypatch.setattr(doctor, "_SYS", tmp_path)
    cases: list[tuple[int | None, bool]] = [(3, True), (7, True), (1, False), (None, False)]
    for pinned, good in cases:
        realtime = ball_screw.file.realtime._replace(cpu=pinned)
        checks = found(ball_screw.having(realtime=realtime), tmp_path)
        assert checks["CPU"].good is good
    assert not checks["governor"].good
    assert checks["governor"].words == "performance, powersave"
    assert checks["governor"].fix == "cpupower frequency-set -g performance"
    (tmp_path / "cpu1" / "cpufreq" / "scaling_governor").write_text("performance\n")
    assert found(ball_screw, tmp_path)["governor"].good


def test_the_real_time_class_is_tried_and_not_believed(
    ball_screw: Setup, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    check = found(ball_screw, tmp_path)["real-time class"]
    assert not check.good
    assert "SCHED_FIFO 80 is not permitted" in check.words
    assert "LimitRTPRIO" in check.fix
    monkeypatch.setattr(os, "sched_setscheduler", lambda *_: None)
    assert "µs late" in found(ball_screw, tmp_path)["real-time class"].words


def test_an_interface_that_is_not_there_is_red_with_its_command(ball_screw: Setup, tmp_path: Path) -> None:
    check = found(ball_screw.with_wire(interface="socketcan", channel="nocan7"), tmp_path)["bus"]
    assert not check.good
    assert "ip link set nocan7 up type can bitrate 1000000" in check.fix


def test_the_drives_stops_in_words(ball_screw: Setup, bench: Workbench, tmp_path: Path) -> None:
    node = bench.running("sync")
    setup = ball_screw.with_wire(channel=bench.channel)
    checks = found(setup, tmp_path, served=False)
    assert checks["quick stop option (0x605A)"].words == "slow down on the quick stop ramp, then Switch on disabled"
    assert checks["abort connection option (0x6007)"].good
    node.objects.node.set_data(0x6007, 0, b"\0\0")
    worst = found(setup, tmp_path, served=False)["abort connection option (0x6007)"]
    assert not worst.good
    assert "NO ACTION" in worst.words
    assert "0x6007" in worst.fix


def test_a_drive_that_a_motion_starts_is_no_fault(ball_screw: Setup, bench: Workbench, tmp_path: Path) -> None:
    check = found(ball_screw.with_wire(channel=bench.channel), tmp_path, served=False)["drive"]
    assert check.good and not check.fix


def test_everything_red_says_what_fixes_it(command: Command, tmp_path: Path) -> None:
    code, out, _ = command("doctor", CONFIG / "ball-screw.yaml", "--state", tmp_path, "--json", "-")
    result = json.loads(out)
    assert code == (0 if result["fit"] else 1)
    assert len(result["checks"]) >= 10
    assert all(check["mend"] for check in result["checks"] if not check["good"])


def test_the_recordings_and_how_long_they_stay(ball_screw: Setup, tmp_path: Path) -> None:
    (tmp_path / "blackbox" / "axis").mkdir(parents=True)
    (tmp_path / "blackbox" / "axis" / "a.h5").write_bytes(bytes(1 << 27))
    for limit, good, words in (
        (Retention(), True, "1 file, 0.1 GiB, the oldest 0 days old; none is ever removed"),
        (Retention(90.0, 0.01), True, "removed after 90 days or beyond 0.01 GiB"),
        (Retention(keep_gib=1e6), False, "removed beyond 1e+06 GiB"),
    ):
        check = found(ball_screw.having(recordings=limit), tmp_path)["recordings"]
        assert check.good is good
        assert words in check.words
