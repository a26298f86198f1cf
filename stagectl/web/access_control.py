"""Who may do what over TCP: the token reads, the key moves; and no other site's page may speak for the user.

On the Unix socket its permissions have decided already.  The key is told only there (`stagectl page`), so that who may
move the axis from a browser is who may use the socket.  Both are files in the state folder and outlive the service.
"""

from __future__ import annotations

import enum
import hmac
import os
import secrets
import stat
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from starlette.responses import JSONResponse

from stagectl.service.axis_controller import ServiceError

PUBLIC = ("/", "/page/")  # the page itself: nothing of the machine is in it
_HOME = ("localhost", "127.0.0.1", "::1")
_READING = ("GET", "HEAD", "OPTIONS")


class Permission(enum.IntEnum):
    """What somebody may do."""

    NOTHING = 0
    READ = 1
    MOVE = 2


class Keys(NamedTuple):
    """What must be said at the door."""

    token: str
    key: str
    token_moves: bool  # `--tcp-may-move`

    def grant(self, said: str) -> Permission:
        """What who says this may do."""
        if hmac.compare_digest(said.encode(), self.key.encode()):
            return Permission.MOVE
        known = hmac.compare_digest(said.encode(), self.token.encode())
        return (Permission.MOVE if self.token_moves else Permission.READ) if known else Permission.NOTHING


class Guard:
    """TCP: lets a request through with what it may, or answers it; a live connection says its key itself."""

    def __init__(self, app: Any, keys: Keys) -> None:
        self._app, self._keys = app, keys

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """One request."""
        if scope["type"] == "websocket":
            scope["keys"] = self._keys
        elif scope["type"] == "http" and not _public(scope["path"]):
            said = dict(scope["headers"]).get(b"authorization", b"").decode("latin-1")
            scope["may"] = may = self._keys.grant(said.removeprefix("Bearer ")) if said else Permission.NOTHING
            if may is Permission.NOTHING:
                await _no(401, "this needs the header 'Authorization: Bearer TOKEN'")(scope, receive, send)
                return
            if scope["method"] not in _READING and may is not Permission.MOVE:
                words = "over TCP this service may only be read: use its Unix socket, or the key of `stagectl page`"
                await _no(403, words)(scope, receive, send)
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
                await _no(403, "this request comes from the page of another site")(scope, receive, send)
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
            file.write(secrets.token_urlsafe(32) + "\n")
    if stat.S_IMODE(path.stat().st_mode) & 0o077:
        raise ServiceError(f"{path} can be read by others: `chmod 600 {path}`, and take a new token")
    found = path.read_text(encoding="utf-8").strip()
    if len(found) < 16:
        raise ServiceError(f"{path} holds {len(found)} characters; a token has 16 at least: remove it for a new one")
    return found
