"""Foxglove's live view, seen through its own protocol by another reader of its messages."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.conftest import ROOT
from tests.service.serving import Served, free_port, served, within

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed: pip install 'stagectl[foxglove]'")
pytest.importorskip("rosbags", reason="rosbags is not installed: pip install rosbags")
PORT = free_port()
ADDRESS = f"ws://127.0.0.1:{PORT}"
ROWS, MESSAGE_DATA = 3000, 1


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("foxglove"), "--foxglove", f"127.0.0.1:{PORT}") as service:
        yield service


def told(link: ClientConnection, op: str) -> dict[str, object]:
    """The next message of this kind."""
    while True:
        text = link.recv(timeout=60.0)
        if isinstance(text, str) and json.loads(text)["op"] == op:
            answer: dict[str, object] = json.loads(text)
            return answer


def subscribed(link: ClientConnection) -> dict[str, str]:
    """The axis' channel, asked for."""
    channels: object = told(link, "advertise")["channels"]
    assert isinstance(channels, list)
    (channel,) = channels
    link.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel["id"]}]}))
    assert isinstance(channel, dict)
    return channel


def messages(link: ClientConnection, count: int) -> list[tuple[int, bytes]]:
    """Log time (ns) and body of so many."""
    heard: list[tuple[int, bytes]] = []
    while len(heard) < count:
        raw = link.recv(timeout=60.0)
        if isinstance(raw, bytes) and raw[0] == MESSAGE_DATA:
            subscription, stamp = struct.unpack_from("<IQ", raw, 1)
            assert subscription == 7
            heard.append((stamp, raw[13:]))
    return heard


def test_every_row_comes_as_another_reader_understands_it(machine: Served) -> None:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    machine.until(lambda axis: axis["state"] == "disabled")
    machine.begin_moving()
    with connect(ADDRESS, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as link:
        channel = subscribed(link)
        heard = messages(link, ROWS)
    assert (channel["topic"], channel["encoding"]) == ("/axis", "cdr")
    store.register(get_types_from_msg(channel["schema"], channel["schemaName"]))
    rows: list[Any] = [store.deserialize_cdr(raw, channel["schemaName"]) for _, raw in heard]
    time = np.array([row.time_s for row in rows])
    assert np.diff(time) == pytest.approx(5e-4)  # none is missing
    assert np.ptp([row.reference_rad for row in rows]) > 0.0
    assert np.max(np.abs([row.error_rad for row in rows])) < 1e-2
    assert np.all(np.diff([stamp for stamp, _ in heard]) > 0)
    machine.ask("POST", "disable")


def test_its_end_is_told_and_disturbs_nothing(machine: Served) -> None:
    machine.until(lambda axis: axis["state"] == "disabled")
    machine.kill("stagectl.service.foxglove_live")
    assert within(30.0, lambda: "foxglove_ended" in machine.faults())
    assert machine.axis()["state"] == "disabled"


_FORM = "must be HOST:PORT, such as 127.0.0.1:8765"


@pytest.mark.parametrize(
    ("text", "words"), [("8765", _FORM), ("localhost:none", _FORM), ("127.0.0.1:99999", "must lie in [1, 65535]")]
)
def test_where_it_cannot_listen(tmp_path: Path, text: str, words: str) -> None:
    line = ["serve", "config/ball-screw.yaml", "--foxglove", text, "--socket", str(tmp_path / "s")]
    done = subprocess.run([sys.executable, "-m", "stagectl", *line], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert words in " ".join(done.stderr.split())
