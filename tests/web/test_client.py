"""A service that does not answer, as a command sees it."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.runtime_folder import short_name
from stagectl.web import client
from stagectl.web.client import ControlError, ask


@pytest.fixture
def stuck(tmp_path: Path) -> Iterator[Path]:
    """Socket of a service that is there and says nothing."""
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listening:
        with short_name(path) as name:
            listening.bind(name)
        listening.listen()
        yield path


@pytest.mark.parametrize(("method", "what"), [("GET", "/v1/status"), ("POST", "/v1/stop?axis=x")])
def test_a_service_that_is_stuck_is_not_waited_for(
    stuck: Path, monkeypatch: pytest.MonkeyPatch, method: str, what: str
) -> None:
    monkeypatch.setattr(client, "ANSWER_TIME", 0.2)
    with pytest.raises(ControlError, match=r"systemctl restart stagectl"):
        ask(stuck, method, what)


def test_a_motion_is_waited_for(stuck: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "ANSWER_TIME", 0.1)
    monkeypatch.setattr(client, "MOTION_TIME", 0.4)
    with pytest.raises(ControlError, match=r"for 0\.4 s"):
        ask(stuck, "POST", "/v1/home?axis=x")
