"""Ctrl-C, SIGTERM or SIGHUP during a command of the service: what it began is stopped, or it is said to go on."""

from __future__ import annotations

import functools
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import open_recording
from stagectl.service import shutdown_signals
from stagectl.units import StageError
from stagectl.web import client
from stagectl.web.client import RefusedError
from tests.problems import refused
from tests.service.serving import Served, served, within

FAR = 0.4e-3  # m, twice the limits.following_error of the stage
SLOW = "{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 100}"


def started(machine: Served, *words: str) -> subprocess.Popen[str]:
    """A command that hears SIGHUP, also where the tests themselves run under `nohup`."""
    command = [sys.executable, "-m", "stagectl", *words, "--socket", str(machine.socket)]
    hears = functools.partial(signal.signal, signal.SIGHUP, signal.SIG_DFL)
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=hears)


def ended(process: subprocess.Popen[str]) -> str:
    """What it wrote on standard error; one that does not end is killed, and the test fails."""
    try:
        return process.communicate(timeout=60)[1]
    except subprocess.TimeoutExpired:
        process.kill()
        raise


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("interrupted")) as service:
        service.ask("POST", "enable")
        yield service


@pytest.mark.parametrize(
    ("verb", "number"),
    [
        ("move", signal.SIGINT),
        ("follow", signal.SIGINT),
        ("move", signal.SIGTERM),
        ("follow", signal.SIGTERM),
        ("move", signal.SIGHUP),
    ],
)
def test_the_end_of_the_command_stops_the_axis(
    machine: Served, tmp_path: Path, verb: str, number: signal.Signals
) -> None:
    (tmp_path / "slow.yaml").write_text(SLOW)
    words = {"move": ["--by", "20 mm", "--speed", "0.2 mm/s"], "follow": [str(tmp_path / "slow.yaml")]}[verb]
    with started(machine, verb, *words) as process:
        machine.until(lambda axis: axis["state"] == "moving")
        process.send_signal(number)
        err = ended(process)
    assert (process.returncode, machine.axis()["state"]) == (130, "standing"), err
    assert "stopped" in err and "nothing else has changed" not in err


def test_a_stop_in_a_current_experiment_brakes_and_holds(machine: Served, tmp_path: Path) -> None:
    """No feedback acts then: the reference still lies where the experiment began, and the axis is elsewhere."""
    (tmp_path / "current.yaml").write_text("{type: current_sine, amplitude: 3 A, frequency: 1.6 Hz, periods: 100}")
    before, faults = machine.heard(), machine.faults()
    with started(machine, "follow", str(tmp_path / "current.yaml")) as process:
        machine.until(lambda axis: axis["position"] is not None and abs(axis["position"] - before["position"]) > FAR)
        process.send_signal(signal.SIGINT)
        err = ended(process)
    now = machine.axis()
    assert (process.returncode, now["state"], now["fault"]) == (130, "standing", ""), err
    assert now["homed"] is True and machine.faults() == faults


def going_on(machine: Served) -> bool:
    return any(file["going_on"] for file in machine.ask("GET", "recordings"))


def begun(machine: Served, path: Path) -> subprocess.Popen[str]:
    process = started(machine, "record", "-o", str(path), "--name", f"{path.parent.name}-{path.stem}")
    assert within(120.0, lambda: going_on(machine))  # the command may not have heard of it yet
    return process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_end_of_the_command_ends_its_recording(machine: Served, tmp_path: Path, number: signal.Signals) -> None:
    with begun(machine, tmp_path / "r.h5") as process:
        process.send_signal(number)
        err = ended(process)
    assert process.returncode == 0, err
    assert not going_on(machine)
    assert open_recording(tmp_path / "r.h5").complete


def test_another_command_ends_a_recording(machine: Served, tmp_path: Path) -> None:
    first = begun(machine, tmp_path / "r.h5")
    with refused(RefusedError) as caught:
        machine.ask("POST", "recordings", axis="", name="", before=0.0, seconds=1.0)
    assert "stagectl record --end --axis axis" in str(caught.value)
    with started(machine, "record", "--end", "-o", str(tmp_path / "ended.h5")) as other:
        ended(other)
    ended(first)
    assert (first.returncode, other.returncode, going_on(machine)) == (0, 0, False)
    assert len(open_recording(tmp_path / "ended.h5").samples) == len(open_recording(tmp_path / "r.h5").samples)


@pytest.fixture
def unhandled() -> Iterator[None]:
    """No handler of another test's command, nor of the program that runs the tests."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in (signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_only_the_first_signal_interrupts(unhandled: None) -> None:
    """`timeout` sends it twice: the second must not cut off the stop that the first has caused."""
    seen = []
    with shutdown_signals.interrupting():
        for number in (signal.SIGTERM, signal.SIGTERM, signal.SIGHUP):
            try:
                signal.raise_signal(number)
            except KeyboardInterrupt:
                seen.append(number)
    assert seen == [signal.SIGTERM]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_signal_that_is_ignored_stays_so() -> None:
    """As under `nohup`: whoever wants a motion to outlive the terminal says so."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with shutdown_signals.interrupting():
            signal.raise_signal(signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


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
