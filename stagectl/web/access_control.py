"""Who may do what over TCP: the token reads, the key moves; and no other site's page may speak for the user.

On the Unix socket its permissions have decided already.  Only there is the key given out (`stagectl page`), so that
whoever may use the socket may move the axis from a browser.  Both are
files in the state folder and outlive the service.
"""

import enum
import hmac
import os
import re
import secrets
import shlex
import stat
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from stagectl.problem import Problem, ProblemKind, why_unread
from stagectl.service.axis_controller import ServiceError
from stagectl.web.bodies import refusal
from stagectl.web.limits import LEAST_SECRET, MOST_SECRET, SECRET_BYTES

PUBLIC = ("/", "/page/")  # the page itself: nothing of the machine is in it
_HOME = ("localhost", "127.0.0.1", "::1")
_SECRET = re.compile(r"[!-~]+")  # what a header can carry as one word
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


Answer = Callable[[Any, Any, Any], Awaitable[None]]  # an ASGI application
Check = Callable[[Any], Answer | None]  # of the scope of a request: None, or the refusal that answers it
Seat = Callable[[Any, Permission], bool]  # for the scope of a request; see `seats`


def guarded(app: Answer, *checks: Check) -> Answer:
    """The application behind these checks, in this order."""

    async def answer(scope: Any, receive: Any, send: Any) -> None:
        refusal = next(filter(None, (check(scope) for check in checks)), None)
        await (refusal or app)(scope, receive, send)

    return answer


def at_home(seat: Seat) -> Check:
    """The Unix socket: whoever may use it owns the machine, and takes an owner's seat."""
    return lambda scope: refusal(503, _FULL) if scope["type"] == "http" and not seat(scope, Permission.MOVE) else None


def by_key(keys: Keys, seat: Seat) -> Check:
    """TCP: a request gets the permission of its key or is refused; a live connection sends its key itself."""

    def refused(scope: Any) -> Answer | None:
        if scope["type"] == "websocket":
            scope["keys"] = keys
        if scope["type"] != "http" or scope["path"] == PUBLIC[0] or scope["path"].startswith(PUBLIC[1]):
            return None
        bearer = dict(scope["headers"]).get(b"authorization", b"").decode("latin-1")
        scope["may"] = may = keys.grant(bearer.removeprefix("Bearer ")) if bearer else Permission.NOTHING
        if may is Permission.NOTHING:
            return refusal(401, "the token is missing or wrong: send the header 'Authorization: Bearer TOKEN'")
        if scope["method"] not in _READING and may is not Permission.MOVE:
            return refusal(
                403, "this token only allows reading: use the Unix socket, or the key that `stagectl page` prints"
            )
        return None if seat(scope, may) else refusal(503, _FULL)

    return refused


def same_site(home: bool) -> Check:
    """Refuses what a browser sends for a page that is not ours; `home`: ours is only found on this machine.

    Programs send no Origin; a browser does with everything that changes something, and with live connections.
    """

    def refused(scope: Any) -> Answer | None:
        if scope["type"] not in ("http", "websocket") or _ours(dict(scope["headers"]), home):
            return None
        return refusal(
            403, "the request comes from the page of another site: open the address that `stagectl page` prints"
        )

    return refused


def _ours(headers: dict[bytes, bytes], home: bool) -> bool:
    origin, host = (headers.get(name, b"").decode("latin-1") for name in (b"origin", b"host"))
    if not origin:
        return True
    return origin.partition("://")[2] == host and (not home or urlsplit(f"//{host}").hostname in _HOME)


def secret(path: Path) -> str:
    """The secret in a file that only its owner can read; a new one where there is no file.

    Raises ServiceError where others can read it, or it holds something else: whoever names the wrong file must not be
    led to remove it.
    """
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(secrets.token_urlsafe(SECRET_BYTES) + "\n")
    text = _written(path)
    if stat.S_IMODE(path.stat().st_mode) & 0o077:
        words = f"other users can read {path}, and with its token may use the service"
        remedy = f"run `chmod 600 {shlex.quote(str(path))}`"
        raise ServiceError(Problem(words, ProblemKind.FILE, remedy=f"{remedy}, then start again", file=path))
    return text


def _written(path: Path) -> str:
    """The one word of a token file.  Raises ServiceError for any other file."""
    try:
        with path.open("rb") as file:
            text = file.read(MOST_SECRET + 1).decode("ascii").strip()
        if _SECRET.fullmatch(text) and LEAST_SECRET <= len(text) < MOST_SECRET:
            return text
        why = f"it must hold one word of {LEAST_SECRET} to {MOST_SECRET} characters, without spaces, and nothing else"
    except (OSError, UnicodeDecodeError) as error:
        why = why_unread(error)
    remedy = "name another file; one that does not exist is made, with a new token"
    raise ServiceError(Problem(f"{path} is no token file: {why}", ProblemKind.FILE, remedy=remedy, file=path))
