"""Ctrl-C during a motion on the service: the axis is stopped, or it is said that it may go on."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.problem import ProblemKind
from stagectl.units import StageError
from stagectl.web import client
from tests.problems import refused
from tests.service.serving import Served, served

SLOW = "{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 100}"


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("interrupted")) as service:
        service.ask("POST", "enable")
        yield service


@pytest.mark.parametrize("verb", ["move", "follow"])
def test_the_operator_stops_the_axis_with_the_command(machine: Served, tmp_path: Path, verb: str) -> None:
    (tmp_path / "slow.yaml").write_text(SLOW)
    words = {"move": ["--by", "20 mm", "--speed", "0.2 mm/s"], "follow": [str(tmp_path / "slow.yaml")]}[verb]
    command = [sys.executable, "-m", "stagectl", verb, *words, "--socket", str(machine.socket)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        machine.until(lambda axis: axis["state"] == "moving")
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, machine.axis()["state"]) == (130, "standing"), err
    assert "stopped" in err and "nothing else has changed" not in err


def test_a_stop_that_is_not_delivered_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    asked: list[str] = []

    def dead(path: Path, quick: bool, axis: str) -> None:
        asked.append(axis)
        raise client.ControlError("nobody is there")

    monkeypatch.setattr(client._UnixConnection, "connect", interrupted)
    monkeypatch.setattr(client, "stop", dead)
    body = {"to": {"x": "1 mm"}}
    with refused(StageError, kind=ProblemKind.LIMIT) as caught:
        client.ask(tmp_path / "s", "POST", "/v1/move", body)
    assert "`stagectl stop`" in str(caught.value) and "nobody is there" in str(caught.value)
    with refused(StageError, kind=ProblemKind.LIMIT):
        client.ask(tmp_path / "s", "POST", "/v1/home?axis=y")
    with refused(StageError, kind=ProblemKind.LIMIT):
        client.ask(tmp_path / "s", "POST", "/v1/move", {"by": {"x": "1 mm", "y": "1 mm"}})
    assert asked == ["x", "y", ""]
    with pytest.raises(KeyboardInterrupt):
        client.ask(tmp_path / "s", "GET", "/v1/status")
