"""The stop path by itself: what it takes, what it answers, and what it makes of orders from before."""

from __future__ import annotations

import json
import os
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from stagectl.realtime.shared_memory import CUT, HOLD, INTERFACE, PENDING, REFUSED, STOP_PATH, Board, Order, Status
from stagectl.realtime.states import State
from stagectl.service.axis_status import Shown
from stagectl.service.child_process import start
from stagectl.service.limits import TAKEN
from stagectl.service.single_instance import serving
from stagectl.service.stop_link import StopLink
from stagectl.service.stop_path import StopPath, StopPost


class Bench:
    """A stop path with two axes and the loop's side of their boards."""

    def __init__(self, folder: Path, served: socket.socket) -> None:
        self.boards = {name: Board.create(16) for name in "xy"}
        self.loop = {name: Board(board.descriptor) for name, board in self.boards.items()}
        shown = tuple((Shown(name, 1.0, "m", "starting"), board.descriptor) for name, board in self.boards.items())
        self.path = StopPath(StopPost(os.dup(served.fileno()), -1, shown))
        self.link = StopLink(folder / "stop")
        self.live()

    def live(self, state: State = State.MOVING, age: float = 0.0) -> None:
        for board in self.loop.values():
            board.show(Status(state=state, tick=time.monotonic() - age, patience=1.0, position=2.0))

    def asked(self, what: str, axis: str = "", take: bool = True) -> Any:
        self.link.send(what, axis)
        self.path.look()
        if take:
            for board in self.loop.values():
                board.next_stops()
                board.heed()
            self.path.look()
        else:
            time.sleep(TAKEN)
            self.path.look()
        return json.loads(self.link._mine.recv(1 << 16))


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with serving(tmp_path / "stop", socket.SOCK_DGRAM) as served:
        bench = Bench(tmp_path, served)
        yield bench
        bench.link.close()
        bench.path._socket.close()


@pytest.mark.parametrize(("what", "kind"), [("stop", HOLD), ("quick-stop", CUT)])
def test_a_stop_reaches_the_loop(bench: Bench, what: str, kind: int) -> None:
    bench.link.send(what, "y")
    bench.path.look()
    assert not bench.loop["x"].called
    assert bench.loop["y"].called and bench.loop["y"].next_stops() == [kind]
    assert not bench.boards["y"].heeded(STOP_PATH)
    bench.loop["y"].heed()
    bench.path.look()
    assert bench.link.heard()


def test_both_kinds_within_a_period_and_by_both_writers(bench: Bench) -> None:
    board, loop = bench.boards["x"], bench.loop["x"]
    board.stop(INTERFACE, CUT)
    board.stop(STOP_PATH, HOLD)
    assert loop.next_stops() == [HOLD, CUT]  # the harder one has the last word
    assert loop.next_stops() == []
    for _ in range(1 << 16):  # the counts begin anew
        board.stop(STOP_PATH, CUT)
        assert loop.next_stops() == [CUT]
    loop.heed()
    assert board.heeded(STOP_PATH) and board.heeded(INTERFACE)


def test_an_order_from_before_a_stop_is_void(bench: Bench) -> None:
    board, loop = bench.boards["x"], bench.loop["x"]
    asked = board.stops
    early = board.order(Order(4))
    board.stop(STOP_PATH, HOLD)
    planned, fresh = board.order(Order(4, stops=asked)), board.order(Order(5))
    loop.next_stops()
    assert loop.next_order() == Order(5)
    assert [board.verdict(number) for number in (early, planned, fresh)] == [REFUSED, REFUSED, PENDING]


def test_a_stop_that_comes_between_is_looked_at_first(bench: Bench) -> None:
    board, loop = bench.boards["x"], bench.loop["x"]
    board.stop(STOP_PATH, HOLD)
    number = board.order(Order(5))
    assert loop.next_order() is None and board.verdict(number) == PENDING
    loop.next_stops()
    assert loop.next_order() == Order(5)


def test_a_stop_given_while_the_loop_starts_counts(bench: Bench) -> None:
    bench.boards["x"].stop(STOP_PATH, HOLD)
    assert Board(bench.boards["x"].descriptor).next_stops() == [HOLD]


def test_a_stop_from_before_its_start_is_given_before_it_is_ready(tmp_path: Path) -> None:
    """Else it ends a motion that is ordered afterwards, as one did after a restart."""
    board = Board.create(16)
    alive, loop = os.pipe()
    os.close(loop)  # it is gone at once, so the path does not look a second time
    with serving(tmp_path / "stop", socket.SOCK_DGRAM) as served:
        link = StopLink(tmp_path / "stop")
        link.send("stop", "")
        link.close()
        path = start("stagectl.service.stop_path", (served.fileno(), alive, board.descriptor), "interpreted")
        path.send(StopPost(served.fileno(), alive, ((Shown("x", 1.0, "m", "starting"), board.descriptor),)))
        assert path.line() == "ready"
        assert Board(board.descriptor).next_stops() == [HOLD]
        assert path.wait(60.0) == 0
    os.close(alive)


def test_a_loop_that_does_not_take_it_is_answered_for(bench: Bench) -> None:
    bench.live(age=0.5)
    answer = bench.asked("stop", take=False)
    assert answer["heeded"] is False and answer["alive"] is False
    (x, _) = answer["axes"]
    assert x["state"] == "no_answer" and x["position"] is None
    bench.live(State.STANDING)
    (x, _) = bench.asked("status")["axes"]
    assert x["state"] == "standing" and x["position"] == 2.0


NESTED = b"[" * 4000  # deeper than the parser goes


@pytest.mark.parametrize(
    "request_",
    [
        *(b"", b"[]", b"{", b'{"do": 1}', b'{"do": "move", "axis": ""}', b"\xff" * 5000),
        *(NESTED, b'{"do": [], "axis": ""}', b'{"do": {}, "axis": ""}'),
    ],
)
def test_what_is_no_request_is_refused(bench: Bench, request_: bytes) -> None:
    socket.send_fds(bench.link._socket, [request_], [bench.link._theirs.fileno()])
    bench.path.look()
    assert "error" in json.loads(bench.link._mine.recv(1 << 16))
    assert not any(board.called for board in bench.loop.values())


def test_an_axis_that_is_not_there(bench: Bench) -> None:
    bench.link.send("stop", "q")
    bench.path.look()
    assert "q" in json.loads(bench.link._mine.recv(1 << 16))["error"]


def test_a_client_that_does_not_listen_delays_nobody(bench: Bench, tmp_path: Path) -> None:
    deaf = StopLink(tmp_path / "stop")
    for _ in range(2000):
        deaf.send("status")
        bench.path.look()
    assert bench.asked("stop")["heeded"] is True
    deaf.close()


def test_what_a_client_brings_that_is_no_socket(bench: Bench, tmp_path: Path) -> None:
    """A file, several descriptors, none: the stop is given, nothing is written, nothing stays open."""
    held = len(os.listdir("/proc/self/fd"))
    request = json.dumps({"do": "stop", "axis": ""}).encode()
    with (tmp_path / "file").open("w") as file:
        for descriptors in ([], [file.fileno()], [file.fileno()] * 20):
            socket.send_fds(bench.link._socket, [request], descriptors)
            bench.path.look()
            assert bench.loop["x"].next_stops() == [HOLD]
    for board in bench.loop.values():
        board.next_stops()
        board.heed()
    bench.path.look()
    assert (tmp_path / "file").read_text() == ""
    assert len(os.listdir("/proc/self/fd")) == held


def test_a_stop_path_that_is_gone_holds_up_nobody_who_probes_it(bench: Bench) -> None:
    """Its queue fills while a new one starts; the service, which starts it, must go on meanwhile."""

    def probe() -> None:
        for _ in range(5000):
            bench.link.send("status")

    probing = threading.Thread(target=probe, daemon=True)
    probing.start()
    probing.join(30.0)
    assert not probing.is_alive()
