"""Faults that are handed to a running virtual drive, and what is refused on the way."""

from __future__ import annotations

import json
import socket
import threading
from pathlib import Path
from typing import Any

import pytest

from stagectl.config.fault_words import read_fault
from stagectl.config.stage_file import load_stage
from stagectl.drives.faults import BLOCKS, TABLE, OnOffFault, PositionJump
from stagectl.drives.virtual.inject import InjectError, InjectionSocket, ask, obey, socket_path
from stagectl.report.selftest import HEAD, faults
from stagectl.runtime_folder import short_name
from stagectl.units import StageError
from tests.conftest import CONFIG, ROOT, Command
from tests.drives.workbench import Script, Workbench

DEEP = "x" * 100  # a folder whose sockets' paths are longer than an AF_UNIX address


@pytest.fixture
def drive(bench: Workbench, script: Script, tmp_path: Path) -> Any:
    """A virtual drive that listens at a path until the test is over."""
    node, over = bench.node(script), threading.Event()
    path = tmp_path / DEEP / "node-5.inject"
    path.parent.mkdir()
    door = InjectionSocket(path)

    def serve() -> None:
        while not over.wait(0.002):
            door.look(lambda request: obey(node.faults, 7.0, request))

    thread = threading.Thread(target=serve)
    thread.start()
    yield path
    over.set()
    thread.join()
    door.close()
    assert not path.exists()


def test_a_fault_is_added_and_cleared(drive: Path) -> None:
    stuck = OnOffFault("encoder-stuck", duration=1.0)._asdict()
    assert ask(drive, {"do": "add", "fault": stuck}) == {"active": ["encoder-stuck"]}
    assert ask(drive, {"do": "add", "fault": {"fault": "sdo-abort", "after": 5.0}}) == {"active": ["encoder-stuck"]}
    assert ask(drive, {"do": "clear"}) == {"active": []}


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"fault": "nothing"}, "nothing"),
        ({"fault": "encoder-stuck", "duration": -1.0}, r"\[0, 1e6\] s"),
        ({"fault": "encoder-stuck", "duration": "x"}, "duration = x"),
        ({"fault": "encoder-stuck", "depth": 1.0}, "depth"),
    ],
)
def test_what_is_no_fault_is_refused_by_the_drive(drive: Path, fault: dict[str, Any], words: str) -> None:
    with pytest.raises(InjectError, match=words):
        ask(drive, {"do": "add", "fault": fault})
    assert ask(drive, {"do": "clear"}) == {"active": []}


def test_noise_at_the_door_is_answered_and_harmless(drive: Path, runtime: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ours, short_name(drive) as name:
        ours.bind(str(runtime / "noise"))
        for noise in (b"", b"\xff\xfe", b"[1]", b"{}", b'{"do": "add"}'):
            ours.sendto(noise, name)
            assert "error" in json.loads(ours.recv(4096))


def test_where_no_drive_listens_the_next_step_is_said(tmp_path: Path, runtime: Path) -> None:
    with pytest.raises(InjectError, match="stagectl virtual-drive"):
        ask(tmp_path / "nobody", {"do": "clear"})
    assert socket_path("embedded", str(tmp_path), 5) == tmp_path / "node-5.inject"
    path = socket_path("socketcan", "can0", 5)  # no participant of the bus makes that folder
    InjectionSocket(path).close()
    assert path.is_relative_to(runtime)


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    path = tmp_path / "nowhere" / "node-5.inject"
    with pytest.raises(InjectError) as caught:
        InjectionSocket(path)
    assert caught.value.place == str(path)


def test_words_are_read_as_strictly_as_a_file(command: Command) -> None:
    assert read_fault("encoder-jump", ["counts=500", "every=10ms"]) == PositionJump("encoder-jump", 500, 0.01)
    for name, words, message in (
        ("encoder-jump", ["counts=1e12"], "must be a whole number"),
        ("encoder-stuck", ["duration=1"], "the unit is missing"),
        ("encoder-stuck", ["durations=1s"], "did you mean duration"),
        ("encoder-stuck", ["duration"], "write it as key=value"),
        ("encoder-stukc", [], "did you mean encoder-stuck"),
        ("loop-stalled", [], "happens in the controller"),
    ):
        with pytest.raises(StageError, match=message):
            read_fault(name, words)
    code, _, err = command("inject", CONFIG / "ball-screw.yaml")
    assert (code, "either the name of a fault" in err) == (2, True)
    code, out, _ = command("inject", "--list")
    assert (code, out.count("after=0s")) == (0, len(TABLE))
    code, out, _ = command("inject", "--list", "--json", "-")
    listed = {entry["fault"]: entry for entry in json.loads(out)["faults"]}
    assert (code, list(listed)) == (0, [row.name for row in TABLE])
    assert listed["encoder-jump"]["parameters"] == "counts=100000, every=0s, after=0s, duration=0s"
    assert listed["emergency"]["parameters"].startswith("code=0x4310, ")


def test_the_stage_file_takes_faults_and_refuses_what_is_none(tmp_path: Path) -> None:
    text = (CONFIG / "ball-screw.yaml").read_text()
    good = "\nvirtual_drive:\n  faults:\n    - fault: encoder-jump\n      counts: 5000\n      after: 0.3 s\n"
    path = tmp_path / "stage.yaml"
    path.write_text(text + good)
    assert load_stage(path).file.virtual_drive.faults == (PositionJump("encoder-jump", 5000, after=0.3),)
    for wrong, message in (
        (good.replace("encoder-jump", "encoder-jmp"), "must be one of"),
        (good.replace("0.3 s", "-1 s"), r"must lie in \[0, 1e6\] s"),
        (good.replace("counts", "count"), "did you mean counts"),
        (good.replace("encoder-jump", "controller-dead"), "must be one of"),
    ):
        path.write_text(text + wrong)
        with pytest.raises(StageError, match=message):
            load_stage(path)


def test_the_manual_is_the_table() -> None:
    manual = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
    rows = [f"| `{fault['fault']}` | {' | '.join(fault[column] for column in HEAD[1:])} |" for fault in faults()]
    assert "\n".join([f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}", *rows]) in manual
    assert all(f"`{name}`" in manual for name in BLOCKS)
