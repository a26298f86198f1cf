"""Who may do what over TCP: the token reads, the key moves; and no other site's page may speak for the user.

On the Unix socket its permissions have decided already.  Only there is the key given out (`stagectl page`), so that
whoever may use the socket may move the axis from a browser.  Both are
files in the state folder and outlive the service.
"""

from __future__ import annotations

import enum
import hmac
import os
import secrets
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from starlette.responses import JSONResponse

from stagectl.service.axis_controller import ServiceError
from stagectl.web.limits import LEAST_SECRET, SECRET_BYTES

PUBLIC = ("/", "/page/")  # the page itself: nothing of the machine is in it
_HOME = ("localhost", "127.0.0.1", "::1")
_READING = ("GET", "HEAD", "OPTIONS")
_FULL = "all seats of your kind are taken: close other connections; `stagectl stop` needs no seat"


class Permission(enum.IntEnum):
    """What a request may do."""

    NOTHING = 0
    READ = 1
    MOVE = 2


class Keys(NamedTuple):
    """The two secrets of the TCP port."""

    token: str
    key: str
    token_moves: bool  # `--tcp-may-move`

    def grant(self, credential: str) -> Permission:
        """The permission of who sends `credential`."""
        if hmac.compare_digest(credential.encode(), self.key.encode()):
            return Permission.MOVE
        known = hmac.compare_digest(credential.encode(), self.token.encode())
        return (Permission.MOVE if self.token_moves else Permission.READ) if known else Permission.NOTHING


Seat = Callable[[Any, Permission], bool]  # for the scope of a request; see `seats`


class Home:
    """The Unix socket: whoever may use it owns the machine, and takes an owner's seat."""

    def __init__(self, app: Any, seat: Seat) -> None:
        self._app, self._seat = app, seat

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """One request."""
        if scope["type"] == "http" and not self._seat(scope, Permission.MOVE):
            await _no(503, _FULL)(scope, receive, send)
            return
        await self._app(scope, receive, send)


class Guard:
    """TCP: attaches its permission to a request or refuses it; a live connection sends its key itself."""

    def __init__(self, app: Any, keys: Keys, seat: Seat) -> None:
        self._app, self._keys, self._seat = app, keys, seat

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """One request."""
        if scope["type"] == "websocket":
            scope["keys"] = self._keys
        elif scope["type"] == "http" and not _public(scope["path"]):
            bearer = dict(scope["headers"]).get(b"authorization", b"").decode("latin-1")
            scope["may"] = may = self._keys.grant(bearer.removeprefix("Bearer ")) if bearer else Permission.NOTHING
            if may is Permission.NOTHING:
                await _no(401, "the token is missing or wrong: send the header 'Authorization: Bearer TOKEN'")(
                    scope, receive, send
                )
                return
            if scope["method"] not in _READING and may is not Permission.MOVE:
                words = "this token only allows reading: use the Unix socket, or the key that `stagectl page` prints"
                await _no(403, words)(scope, receive, send)
                return
            if not self._seat(scope, may):
                await _no(503, _FULL)(scope, receive, send)
                return
        await self._app(scope, receive, send)


class SameSite:
    """Refuses what a browser sends for a page that is not ours; `home`: ours is only found on this machine.

    Programs send no Origin; a browser does with everything that changes something, and with live connections.
    """

    def __init__(self, app: Any, home: bool) -> None:
        self._app, self._home = app, home

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """One request."""
        if scope["type"] in ("http", "websocket") and not self._ours(dict(scope["headers"])):
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008})
            else:
                await _no(
                    403, "the request comes from the page of another site: open the address that `stagectl page` prints"
                )(scope, receive, send)
            return
        await self._app(scope, receive, send)

    def _ours(self, headers: dict[bytes, bytes]) -> bool:
        origin, host = (headers.get(name, b"").decode("latin-1") for name in (b"origin", b"host"))
        if not origin:
            return True
        return origin.partition("://")[2] == host and (not self._home or urlsplit(f"//{host}").hostname in _HOME)


def _public(path: str) -> bool:
    return path == PUBLIC[0] or path.startswith(PUBLIC[1])


def _no(status: int, words: str) -> JSONResponse:
    return JSONResponse({"error": words}, status)


def secret(path: Path) -> str:
    """The secret in a file that only its owner can read; a new one where there is no file.

    Raises ServiceError where others can read it.
    """
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(secrets.token_urlsafe(SECRET_BYTES) + "\n")
    if stat.S_IMODE(path.stat().st_mode) & 0o077:
        raise ServiceError(f"other users can read {path}: remove it, and the next start writes a new one")
    text = path.read_text(encoding="utf-8").strip()
    if len(text) < LEAST_SECRET:
        raise ServiceError(
            f"{path} holds {len(text)} characters; a token has at least {LEAST_SECRET}: "
            "remove it, and restart the service"
        )
    return text
