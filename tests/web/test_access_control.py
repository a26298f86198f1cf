"""Who gets in: every mixture of what is said, where it is asked and what it comes from."""

from __future__ import annotations

import asyncio
import os
import stat
from pathlib import Path
from typing import Any

import pytest

from stagectl.problem import ProblemKind
from stagectl.service.axis_controller import ServiceError
from stagectl.web.access_control import Answer, Keys, Permission, by_key, guarded, same_site, secret
from tests.problems import refused

TOKEN, KEY = "t" * 43, "k" * 43
KEYS = Keys(TOKEN, KEY, token_moves=False)


def asked(
    app: Any, method: str = "GET", path: str = "/v1/status", kind: str = "http", **headers: str
) -> tuple[int, Any]:
    """Status of the answer, and the scope as it came through."""
    through: list[dict[str, Any]] = []
    sent: list[dict[str, Any]] = []

    async def inner(scope: Any, receive: Any, send: Any) -> None:
        through.append(scope)
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {"type": "http.request", "body": b"", "more_body": False}

    raw = [(name.lower().encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": kind, "method": method, "path": path, "headers": raw}
    asyncio.run(app(inner)(scope, receive, send))
    return sent[0]["status"], through[0] if through else None


def keyed(inner: Any) -> Answer:
    return guarded(inner, by_key(KEYS, lambda *_: True))


@pytest.mark.parametrize(
    ("said", "get", "post", "may"),
    [
        ("", 401, 401, None),
        ("Bearer ", 401, 401, None),
        ("Bearer " + "x" * 43, 401, 401, None),
        (f"Bearer {TOKEN[:-1]}", 401, 401, None),
        (f"Bearer {TOKEN}", 200, 403, Permission.READ),
        (f"Bearer {KEY}", 200, 200, Permission.MOVE),
    ],
)
def test_the_token_reads_and_the_key_moves(said: str, get: int, post: int, may: Permission | None) -> None:
    header = {"authorization": said} if said else {}
    status, scope = asked(keyed, **header)
    assert status == get
    assert (scope["may"] if scope else None) is may
    assert asked(keyed, "POST", "/v1/enable", **header)[0] == post


@pytest.mark.parametrize("path", ["/", "/page/main.js", "/page/plots/uPlot.min.js"])
def test_the_page_itself_is_open(path: str) -> None:
    assert asked(keyed, path=path)[0] == 200


@pytest.mark.parametrize("path", ["/v1/recordings", "/openapi.json", "/page", "//", "/v1/../page/"])
def test_nothing_else_is(path: str) -> None:
    assert asked(keyed, path=path)[0] == 401


def test_a_live_connection_gets_the_keys_to_be_asked_for() -> None:
    _, scope = asked(keyed, kind="websocket", path="/v1/live")
    assert scope["keys"] is KEYS
    assert Keys(TOKEN, KEY, token_moves=True).grant(TOKEN) is Permission.MOVE
    assert KEYS.grant("ü") is Permission.NOTHING


@pytest.mark.parametrize(
    ("home", "host", "origin", "status"),
    [
        (True, "localhost", "", 200),
        (True, "localhost:8402", "http://localhost:8402", 200),
        (True, "127.0.0.1:9000", "http://127.0.0.1:9000", 200),
        (True, "[::1]:9000", "http://[::1]:9000", 200),
        (True, "localhost:8402", "https://evil.example", 403),
        (True, "evil.example", "http://evil.example", 403),
        (True, "evil.example:80", "http://evil.example:80", 403),
        (True, "localhost:8402", "null", 403),
        (False, "stage.example:8402", "http://stage.example:8402", 200),
        (False, "stage.example:8402", "http://evil.example", 403),
    ],
)
def test_no_other_site_speaks_for_the_user(home: bool, host: str, origin: str, status: int) -> None:
    header = {"host": host} | ({"origin": origin} if origin else {})
    assert asked(lambda inner: guarded(inner, same_site(home)), "POST", "/v1/enable", **header)[0] == status
    live = asked(lambda inner: guarded(inner, same_site(home)), path="/v1/live", kind="websocket", **header)
    assert live[0] == status and (live[1] is not None) == (status == 200)


def test_a_secret_is_its_owners(tmp_path: Path) -> None:
    path = tmp_path / "state" / "key"
    first = secret(path)
    assert len(first) >= 43
    assert secret(path) == first
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    os.chmod(path, 0o640)
    with refused(ServiceError, kind=ProblemKind.FILE, file=path) as caught:
        secret(path)
    assert "chmod 600" in str(caught.value)


@pytest.mark.parametrize("text", ["short", "", "axis:\n  lead: 12 mm\n", "x" * 300, "\N{MICRO SIGN}" * 40])
@pytest.mark.parametrize("mode", [0o600, 0o644])
def test_a_file_that_holds_no_token_is_left_alone(tmp_path: Path, text: str, mode: int) -> None:
    """It may be the stage file, named in the wrong place: nobody must be told to remove it."""
    path = tmp_path / "stage.yaml"
    path.write_text(text)
    os.chmod(path, mode)
    with refused(ServiceError, kind=ProblemKind.FILE, file=path) as caught:
        secret(path)
    assert "no token file" in str(caught.value) and "remove" not in str(caught.value)
    assert path.read_text() == text
