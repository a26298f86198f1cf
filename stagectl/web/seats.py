"""Seats: how many connections strangers, readers and owners may have, so that nobody takes those of another.

::

    connected ----> stranger -- token --> reader
                       `------- key, or the Unix socket --> owner

Where a class is full, its oldest connection that does nothing makes room: the newcomer always gets a chance to show its
key.  A stranger has a few seconds for the header of its request.
"""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from stagectl.service.limits import CLOSE_TIME, HEADER_TIME, OWNERS, READERS, STRANGERS, STRANGERS_EACH
from stagectl.web.access_control import Permission

_MOST = {Permission.NOTHING: STRANGERS, Permission.READ: READERS, Permission.MOVE: OWNERS}


class Seats:
    """The connections of one listening socket, the oldest first."""

    def __init__(self) -> None:
        self._guests: list[Guest] = []

    def admit(self, guest: Guest) -> None:
        """Seat a stranger; another one makes room for it."""
        self._guests = [seated for seated in self._guests if not seated.gone]
        self._guests.append(guest)
        neighbours = [seated for seated in self._of(Permission.NOTHING) if seated.address == guest.address]
        if guest.address and len(neighbours) > STRANGERS_EACH:
            _makes_room(neighbours)
        elif len(self._of(Permission.NOTHING)) > STRANGERS:
            _makes_room(self._of(Permission.NOTHING))

    def promote(self, guest: Guest, permission: Permission) -> bool:
        """Give it a seat of another class; False where that is full, and all of them are at work."""
        if guest.permission >= permission:
            return True
        seated = self._of(permission)
        if len(seated) >= _MOST[permission]:
            if all(other.busy for other in seated):
                return False
            _makes_room(seated)
        guest.permission = permission
        return True

    def _of(self, permission: Permission) -> list[Guest]:
        return [guest for guest in self._guests if guest.permission is permission and not guest.gone]


def _makes_room(guests: list[Guest]) -> None:
    """The oldest that does nothing leaves; the oldest where all do something."""
    min(guests, key=lambda guest: guest.busy).leave()


class Guest(H11Protocol):
    """One connection: it must show a whole header in time, and may be asked to leave."""

    def __init__(self, seats: Seats, app_state: dict[str, Any], **others: Any) -> None:
        super().__init__(app_state={**app_state, "guest": self}, **others)
        self.seats, self.permission, self.live = seats, Permission.NOTHING, False
        self._overdue: asyncio.TimerHandle | None = None

    @property
    def address(self) -> str:
        """Where it comes from; empty on the Unix socket."""
        return self.client[0] if self.client else ""

    @property
    def busy(self) -> bool:
        """Whether it is being answered, or is a viewer."""
        return self.live or (self.cycle is not None and not self.cycle.response_complete)

    @property
    def gone(self) -> bool:
        """Whether its connection has ended."""
        return self.transport is None or self.transport.is_closing()

    def leave(self) -> None:
        """End the connection at once, unless it has ended."""
        self._in_time()
        if self.transport.get_protocol() is not None:  # asyncio takes it away when the connection is lost
            self.transport.abort()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a seat."""
        super().connection_made(transport)
        self._overdue = self.loop.call_later(HEADER_TIME, self.leave)
        self.seats.admit(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Nothing is waited for any more."""
        self._in_time()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """A header that is not whole has its time, be it the first or a later one."""
        super().data_received(data)
        if self.busy or self.transport.get_protocol() is not self:
            self._in_time()
        elif self._overdue is None:
            self._overdue = self.loop.call_later(HEADER_TIME, self.leave)

    def _in_time(self) -> None:
        if self._overdue is not None:
            self._overdue.cancel()
            self._overdue = None


def seated(scope: Any, permission: Permission) -> bool:
    """Seat whoever makes this request by its permission; False where there is no room for it."""
    guest: Guest | None = scope.get("state", {}).get("guest")
    return guest is None or guest.seats.promote(guest, permission)


def stays(scope: Any) -> None:
    """Whoever makes this request is a viewer: it is at work as long as it is connected."""
    guest: Guest | None = scope.get("state", {}).get("guest")
    if guest is not None:
        guest.live = True


def leaves(scope: Any) -> None:
    """Whoever makes this request is a viewer no more: the connection ends soon, whatever the client does."""
    guest: Guest | None = scope.get("state", {}).get("guest")
    if guest is not None:
        guest.live = False
        guest.loop.call_later(CLOSE_TIME, guest.leave)


class Live(WebSocketsSansIOProtocol):
    """A live connection; the answers to pings do not pile up where the client does not read them.

    Of a message that is too large the rest is read and thrown away for a while: a connection that is closed with
    something unread is reset, and the client never sees why.
    """

    def data_received(self, data: bytes) -> None:
        """Take what has come, unless a message before it was refused."""
        if self.conn.parser_exc is None:
            super().data_received(data)

    def handle_parser_exception(self) -> None:
        """Say why, and wait until the client goes, for `CLOSE_TIME` at most."""
        close = self.conn.close_sent
        assert close is not None
        self.queue.put_nowait({"type": "websocket.disconnect", "code": close.code, "reason": close.reason})
        self.transport.write(b"".join(self.conn.data_to_send()))
        self.close_sent = True
        self.close_timer = self.loop.call_later(CLOSE_TIME, self.transport.close)

    def handle_ping(self) -> None:
        """Answer, or throw the answer away."""
        if self.writable.is_set():
            super().handle_ping()
        else:
            self.conn.data_to_send()
