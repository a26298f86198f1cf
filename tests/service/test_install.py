"""Units: what is written, that systemd takes it, how it rates it, and that nothing is left when it is removed."""

from __future__ import annotations

import json
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from stagectl.config.stage_file import Setup
from stagectl.service import install as installer
from stagectl.service.install import PLACES, Installation, contents, install, remove
from stagectl.service.single_instance import notify
from tests.conftest import CONFIG, Command

STAGE = CONFIG / "ball-screw.yaml"
MOST_EXPOSED = 1.5  # what `systemd-analyze security` may say


@pytest.fixture
def on_can(ball_screw: Setup) -> Setup:
    return ball_screw.with_wire(interface="socketcan", channel="can0", bitrate=500e3)


def wanted(*setups: Setup, tcp: tuple[str, int] | None = None) -> Installation:
    named = tuple((name, STAGE, setup) for name, setup in zip("xyz", setups, strict=False))
    return Installation(named, Path("/opt/stagectl/bin/python"), tcp)


def test_the_unit_says_what_the_stage_file_says(on_can: Setup, ball_screw: Setup) -> None:
    files = contents(wanted(on_can))
    assert set(files) == {place for place in PLACES.values() if "socket" not in place}
    assert not [text for text in files.values() if re.search(r"@[A-Z]+@", text)]
    unit = files["etc/systemd/system/stagectl.service"]
    assert f'ExecStart=/opt/stagectl/bin/python -P -m stagectl serve "{STAGE}"\n' in unit
    assert "RestrictAddressFamilies=AF_UNIX AF_NETLINK AF_CAN\n" in unit
    assert "BindsTo=sys-subsystem-net-devices-can0.device" in unit
    network = files["etc/systemd/network/80-stagectl-can.network"]
    assert "Name=can0" in network
    assert "BitRate=500000" in network
    for line in ("MemoryMax=", "LimitNOFILE=", "TasksMax=", "OOMScoreAdjust=-", "WatchdogSec="):
        assert f"\n{line}" in unit
    embedded = contents(wanted(ball_screw, ball_screw, tcp=("127.0.0.1", 8402)))
    assert set(embedded) == {place for place in PLACES.values() if "network" not in place}
    unit = embedded["etc/systemd/system/stagectl.service"]
    assert f'serve "x={STAGE}" "y={STAGE}" --tcp 127.0.0.1:8402\n' in unit
    assert "AF_CAN" not in unit and "AF_INET" not in unit
    assert "Requires=stagectl.socket\n" in unit
    assert "IPAddressAllow=localhost\n" in unit  # where it listens, and no further
    assert "ListenStream=127.0.0.1:8402\n" in embedded["etc/systemd/system/stagectl.socket"]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
@pytest.mark.parametrize("tcp", [None, ("127.0.0.1", 8402), ("0.0.0.0", 8402)])
def test_systemd_rates_the_unit_as_hardened(on_can: Setup, tmp_path: Path, tcp: tuple[str, int] | None) -> None:
    install(wanted(on_can, tcp=tcp), tmp_path, True)
    command = ["systemd-analyze", "security", "--offline=true", f"--root={tmp_path}", "stagectl.service"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    match = re.search(r"Overall exposure level for stagectl.service: ([\d.]+)", said)
    assert match is not None, said
    assert 0.5 < float(match[1]) <= MOST_EXPOSED


def test_what_was_installed_is_removed_and_nothing_else(on_can: Setup, tmp_path: Path) -> None:
    own = tmp_path / "etc/systemd/network/10-eth0.network"
    own.parent.mkdir(parents=True)
    own.write_text("[Match]\n")
    files = install(wanted(on_can, tcp=("127.0.0.1", 8402)), tmp_path, True)
    assert any("systemctl enable --now stagectl.service" in step.words for step in files)  # said, not run: another root
    assert all((tmp_path / place).is_file() for place in PLACES.values())
    remove(tmp_path)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [own]
    assert remove(tmp_path)  # twice is no error


def test_the_verbs(tmp_path: Path, command: Command) -> None:
    assert command("service", "install", STAGE, "--root", tmp_path)[0] == 0
    unit = (tmp_path / PLACES["stagectl.service"]).read_text()
    assert f'ExecStart={sys.executable} -P -m stagectl serve "{STAGE}"' in unit
    for wrong in ("8402", "my-machine:8402"):  # systemd resolves no names
        code, _, err = command("service", "install", STAGE, "--root", tmp_path, "--tcp", wrong)
        assert code == 2 and wrong in err
    assert command("service", "remove", "--root", tmp_path)[0] == 0
    assert not (tmp_path / PLACES["stagectl.service"]).exists()


@pytest.mark.parametrize("verb", ["install", "remove"])
@pytest.mark.parametrize(("code", "ends"), [(0, 0), (1, 1), (None, 1)])
def test_a_step_that_fails_is_the_end(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch, verb: str, code: int | None, ends: int
) -> None:
    """On the root of this machine; here that is a folder of the test, and no command of it is run."""
    tried: list[str] = []

    def run(words: list[str], **_: object) -> SimpleNamespace:
        tried.append(words[0])
        return SimpleNamespace(returncode=code, stderr="refused")

    files = {name: f"{tmp_path}/{place}" for name, place in PLACES.items()}  # absolute: the root in front is dropped
    monkeypatch.setattr(installer, "PLACES", files)
    monkeypatch.setattr(shutil, "which", lambda _: None if code is None else "/bin/true")
    monkeypatch.setattr(subprocess, "run", run)
    stage = [STAGE, "--no-start"] if verb == "install" else []
    done, out, _ = command("service", verb, *stage, "--json", "-")
    assert done == ends
    assert bool(json.loads(out)["failed"]) is (ends == 1)
    assert bool(tried) is (code is not None)


def test_systemd_is_told_on_its_socket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not notify("READY=1")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        assert notify("READY=1", "STATUS=axis without power")
        assert listening.recv(100) == b"READY=1\nSTATUS=axis without power"
    assert not notify("WATCHDOG=1")  # nobody listens any more
