"""What a viewer is sent, what it is refused, and what that costs the service."""

from __future__ import annotations

import asyncio
import json
import time
from pathlib import Path

import numpy as np
import pytest

from stagectl.service.axis_controller import COLUMNS, STARTING, AxisController
from stagectl.service.machine import machine
from stagectl.service.service import Service, ServicePaths
from stagectl.web.capture_client import ReceivedCapture, trigger, unpacked
from stagectl.web.limits import RATE
from stagectl.web.status_feed import StatusFeed
from stagectl.web.viewer import Viewer
from tests.conftest import CONFIG
from tests.web.conftest import Write

SIXTEEN = ["reference", "target", "feedforward", "friction", "velocity", "learned", "error", "proportional", "integral"]
SIXTEEN += ["derivative", "command", "current", "measured", "measured_current", "lateness", "late"]
MOST = 0.05  # of one core, for the messages of a page that draws 2 kHz sixty times a second


class Heard:
    """A viewer and all that it was sent."""

    def __init__(self, service: Service) -> None:
        self.said: list[str | bytes] = []
        self.viewer = Viewer(service, StatusFeed(service).status, self._say)

    async def _say(self, what: str | bytes) -> None:
        self.said.append(what)

    def ask(self, **message: object) -> None:
        asyncio.run(self.viewer.hear(json.dumps(message)))

    def frame(self, now: float = 0.0) -> list[str | bytes]:
        self.said.clear()
        asyncio.run(self.viewer.frame(now))
        return list(self.said)

    def captures(self) -> list[ReceivedCapture]:
        return [unpacked(message) for message in self.frame() if isinstance(message, bytes)]


def test_the_status_says_how_the_machine_is(service: Service, write: Write) -> None:
    write(100)
    heard = Heard(service)
    (news,) = heard.frame(1.0)
    (axis,) = json.loads(news)["status"]["axes"]
    assert axis["state_words"] == STARTING
    assert axis["lateness"]["rows"] == 100
    assert axis["recording"] is None
    assert heard.frame(1.05) == []
    assert len(heard.frame(1.11)) == 1


def test_a_capture_reaches_the_terminal(service: Service, axis: AxisController, write: Write) -> None:
    heard = Heard(service)
    condition = trigger("error > 1 um")
    heard.ask(
        scope={"channels": ["error", "current"], "span": 0.1, "before": 0.5, "trigger": condition, "mode": "single"}
    )
    write(1000, error=lambda k: 1e-2 * (k == 700))  # 19 um
    (seen,) = heard.captures()
    assert seen.triggered
    assert (len(seen.time), seen.step) == (200, 5e-4)
    assert float(seen.time[np.argmax(seen.high[0])]) == pytest.approx(0.0, abs=1e-12)
    assert seen.high[0].max() == pytest.approx(1e-2 * axis.setup.file.axis.travel_per_unit)
    write(1000, error=lambda k: 1e-2 * (k == 1700))
    assert heard.captures() == []  # a single one


def test_a_new_real_time_process_is_followed(service: Service, axis: AxisController, write: Write) -> None:
    heard = Heard(service)
    heard.ask(strip={"channels": ["error"], "span": 1.0, "points": 100, "number": 4})
    write(100)
    assert [frame for frame in heard.frame() if isinstance(frame, bytes)]
    axis.begin()  # as after its death
    write(100)
    (raw,) = [frame for frame in heard.frame() if isinstance(frame, bytes)]
    assert np.frombuffer(raw)[2] == 5  # all of the new ring


@pytest.fixture
def both(tmp_path: Path) -> Service:
    axes = machine([str(CONFIG / "xy.yaml")], None)
    return Service(axes, ServicePaths(tmp_path / "control.sock", tmp_path / "state"), True, lambda _: None)


def period(service: Service, names: str, number: float) -> None:
    """What the loop does in one period: the axes write one after the other."""
    for name in names:
        row = dict.fromkeys(COLUMNS, number)
        service.axes[name].ring.write(tuple(row.values()))


@pytest.mark.parametrize("late", ["x", "y"])
def test_two_axes_are_seen_row_by_row_of_the_same_period(both: Service, late: str) -> None:
    """One began a while after the other; the trigger may be of either."""
    for _ in range(37):
        period(both, {"x": "y", "y": "x"}[late], -1.0)
    for _ in range(3):
        period(both, "xy", -1.0)
    heard = Heard(both)
    condition = trigger(f"{late}.lateness > 500 s")
    asked = {"axis": "x", "channels": ["lateness", "y.lateness"], "span": 0.1, "before": 0.5, "trigger": condition}
    heard.ask(scope={**asked, "mode": "single"})
    assert heard.said == []
    for number in range(1000):
        period(both, "xy", number)
    (seen,) = heard.captures()
    assert seen.low[0].tolist() == seen.low[1].tolist() == [450.0 + k for k in range(100)]
    assert seen.time[50] == pytest.approx(0.0, abs=1e-12)


def test_an_axis_that_begins_anew_is_lined_up_anew(both: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stagectl.recording.joined_rings.REJOIN", 0.0)
    heard = Heard(both)
    heard.ask(scope={"channels": ["x.lateness", "y.lateness"], "span": 0.01, "mode": "auto"})
    for number in range(100):
        period(both, "x", number)  # y has lost its drive
    assert heard.captures() == []
    for number in range(100, 200):
        period(both, "xy", number)
    seen = heard.captures()[-1]
    assert seen.low[0].tolist() == seen.low[1].tolist()


def test_the_machine_tells_of_the_channels_of_other_axes(both: Service) -> None:
    known = StatusFeed(both).machine()["x"]["channels"]
    assert known["y.error"] == known["error"]
    assert "x.error" not in known


@pytest.mark.parametrize(("name", "words"), [("q.error", "axis q;"), ("y.nothing", "channel y.nothing;")])
def test_what_another_axis_has_not(both: Service, name: str, words: str) -> None:
    heard = Heard(both)
    heard.ask(scope={"channels": [name]})
    (said,) = heard.said
    assert words in json.loads(said)["error"]


def test_what_is_held_stays(service: Service, write: Write) -> None:
    heard = Heard(service)
    heard.ask(scope={"channels": ["error"], "span": 0.05, "mode": "auto"})
    write(500)
    assert len(heard.captures()) == 1
    heard.ask(hold={"held": True})
    write(5000)
    assert heard.captures() == []
    heard.said.clear()
    heard.ask(closer={"start": -1.0, "end": 1.0, "points": 1000})
    (raw,) = heard.said
    assert isinstance(raw, bytes)
    assert np.frombuffer(raw)[2] == 100


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ({"scope": {"channels": ["nothing"]}}, "no channel nothing"),
        ({"scope": {"channels": ["error"], "span": 30.0}}, "span 30 s; a capture of axis has 9.83 s at most"),
        ({"scope": {"channels": [], "span": 1.0}}, "0 channels"),
        ({"scope": {"channels": ["error"], "axis": "q"}}, "axis q;"),
        ({"scope": {"channels": ["error"], "trigger": {"channel": "error", "level": "1 A"}}}, "trigger level 1 A"),
        ({"scope": {"channels": ["error"], "color": 1}}, "color: is not known here"),
        ({"strip": {"channels": ["error"], "points": 1}}, "points = 1: must be at least"),
        ({"scope": {"channels": ["error"], "span": "1 s"}}, "span: must be a number, without quotes or unit"),
        ({"scope": {"channels": ["error"], "trigger": {"channel": "error", "level": "1"}}}, "the unit is missing"),
        ({"scope": {"channels": ["eror"]}}, "did you mean error?"),
        ({"move": {}}, "with one key of strip, scope, closer, hold"),
        ([1], "a message is a JSON object with one key of strip"),
        ({"strip": 1}, "strip: must be a JSON object"),
        ({"strip": {"channels": "error"}}, "strip.channels: must be a list"),
    ],
)
def test_what_cannot_be_is_said(service: Service, message: object, words: str) -> None:
    heard = Heard(service)
    asyncio.run(heard.viewer.hear(json.dumps(message)))
    (said,) = heard.said
    assert words in json.loads(said)["error"]


def test_it_costs_less_than_a_twentieth_of_a_core(service: Service, write: Write) -> None:
    """Strips of ten seconds, and a scope of 16 channels that triggers all the time."""
    heard = Heard(service)
    write(30_000)
    heard.ask(strip={"channels": ["target", "measured", "error", "current"], "span": 10.0, "points": 600})
    condition = {"channel": "current", "level": "0.5 A"}
    heard.ask(scope={"channels": SIXTEEN, "span": 0.5, "trigger": condition, "mode": "normal"})
    heard.frame(0.0)
    spent, messages, seconds = 0.0, 0, 4

    async def shown(k: int) -> None:
        nonlocal spent
        began = time.process_time()
        await heard.viewer.frame(k / RATE)
        spent += time.process_time() - began

    for k in range(int(RATE) * seconds):
        write(2000 * (k + 1) // int(RATE) - 2000 * k // int(RATE))
        heard.said.clear()
        asyncio.run(shown(k))
        messages += len(heard.said)
    assert messages > RATE * seconds
    assert spent / seconds < MOST
