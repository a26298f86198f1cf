"""Seats: who makes room for whom.  Bodies: what is taken whole, and what is refused."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import pytest

from stagectl.service.limits import BODY, OWNERS, READERS, STRANGERS, STRANGERS_EACH, STRUCTURE, UPLOAD
from stagectl.web import bodies
from stagectl.web.access_control import Permission
from stagectl.web.bodies import Bodies, structure
from stagectl.web.seats import Guest as Connection
from stagectl.web.seats import Seats


class Guest:
    """A connection that does what it is told."""

    def __init__(self, address: str = "") -> None:
        self.address, self.busy, self.gone, self.permission = address, False, False, Permission.NOTHING

    def leave(self) -> None:
        self.gone = True


def admitted(seats: Seats, count: int, address: Any = lambda k: "") -> list[Any]:
    guests = [Guest(address(k)) for k in range(count)]
    for guest in guests:
        seats.admit(guest)  # type: ignore[arg-type]
    return guests


def test_the_newest_strangers_stay() -> None:
    guests = admitted(Seats(), 1100, lambda k: f"10.0.0.{k % 200}")
    assert [guest.gone for guest in guests] == [True] * (1100 - STRANGERS) + [False] * STRANGERS


def test_one_address_takes_no_seats_of_others() -> None:
    seats = Seats()
    (first,) = admitted(seats, 1, lambda _: "10.0.0.1")
    crowd = admitted(seats, 1000, lambda _: "10.0.0.2")
    assert not first.gone
    assert sum(not guest.gone for guest in crowd) == STRANGERS_EACH


def test_who_is_being_answered_stays() -> None:
    seats = Seats()
    (busy,) = admitted(seats, 1)
    busy.busy = True
    admitted(seats, 1000)
    assert not busy.gone


def test_readers_and_strangers_leave_owners_alone() -> None:
    seats = Seats()
    owners, readers = admitted(seats, 3), admitted(seats, 3)
    for guest in owners:
        assert seats.promote(guest, Permission.MOVE)
    for guest in [*readers, *admitted(seats, 40)]:
        assert seats.promote(guest, Permission.READ)
    admitted(seats, 1000)
    assert not any(guest.gone for guest in owners)
    assert all(guest.gone for guest in readers)  # the oldest of more than there are seats


@pytest.mark.parametrize(("permission", "most"), [(Permission.READ, READERS), (Permission.MOVE, OWNERS)])
def test_where_all_are_at_work_the_newcomer_is_refused(permission: Permission, most: int) -> None:
    seats = Seats()
    for _ in range(most):
        (guest,) = admitted(seats, 1)
        guest.busy = True
        assert seats.promote(guest, permission)
    (late,) = admitted(seats, 1)
    assert not seats.promote(late, permission) and not late.gone


def test_a_connection_that_has_ended_is_not_ended_again() -> None:
    """It was closed with data to send, and the client has read them: asyncio's transport is no more then."""

    async def ended() -> None:
        guest, loop = Connection.__new__(Connection), asyncio.get_running_loop()
        ours, theirs = socket.socketpair()
        theirs.setblocking(False)
        guest._overdue = None
        guest.transport, _ = await loop.create_connection(asyncio.Protocol, sock=ours)
        guest.transport.write(bytes(1 << 20))
        guest.transport.close()
        with theirs:
            while await loop.sock_recv(theirs, 1 << 16):
                pass
            guest.leave()

    asyncio.run(asyncio.wait_for(ended(), 60.0))


def posted(*parts: bytes, path: str = "/v1/move", length: int | None = None, slow: bool = False) -> tuple[int, bytes]:
    """Status, and the body that came through."""
    seen: list[bytes] = []
    statuses: list[int] = []
    waiting = [{"type": "http.request", "body": part, "more_body": k + 1 < len(parts)} for k, part in enumerate(parts)]

    async def app(scope: Any, receive: Any, send: Any) -> None:
        seen.append((await receive())["body"])
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive() -> Any:
        if slow:
            await asyncio.sleep(1.0)
        return waiting.pop(0)

    async def send(message: Any) -> None:
        if message["type"] == "http.response.start":
            statuses.append(message["status"])

    headers = [] if length is None else [(b"content-length", str(length).encode())]
    asyncio.run(Bodies(app)({"type": "http", "path": path, "headers": headers}, receive, send))
    return statuses[0], b"".join(seen)


def test_a_body_comes_through_whole() -> None:
    assert posted(b'{"a"', b": 1}") == (200, b'{"a": 1}')
    long = b'{"yaml": "%s"}' % (b"x" * (1 << 20))
    assert posted(long, path="/v1/trajectory") == (200, long)


def test_a_body_that_is_too_large_is_not_read() -> None:
    assert posted(length=200_000_000)[0] == 413
    assert posted(length=10**30)[0] == 413
    assert posted(*[b"x" * 4096] * (BODY // 4096 + 1))[0] == 413
    assert posted(*[b"x" * 65536] * (UPLOAD // 65536 + 1), path="/v1/trajectory")[0] == 413


@pytest.mark.parametrize("bomb", [b"[" * 60_000, b"[%s]" % (b"1," * 25_000), b"{%s}" % (b'"":1,' * 12_000)])
def test_a_body_that_would_keep_the_parser_busy_is_refused(bomb: bytes) -> None:
    assert posted(bomb)[0] == 413


def test_texts_are_no_structure() -> None:
    assert structure(b'{"a": "%s"}' % (b'\\"[,]\\\\' * STRUCTURE)) == len(b"{: }")


def test_a_body_that_drips_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bodies, "BODY_TIME", 0.05)
    assert posted(b"x", slow=True)[0] == 408
