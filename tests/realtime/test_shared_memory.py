"""Orders, status and setpoints over shared memory, between two views of it as between two processes."""

from __future__ import annotations

import struct

import pytest

from stagectl.realtime.shared_memory import AHEAD, PENDING, REFUSED, SLOTS, TAKEN, Board, BoardFullError, Order, Status
from tests.conftest import endlessly

LOOKS = 300_000


@pytest.fixture
def sides() -> tuple[Board, Board]:
    service = Board.create()
    return service, Board(service.descriptor)


def test_orders_come_in_order_and_are_answered(sides: tuple[Board, Board]) -> None:
    service, loop = sides
    assert loop.next_order() is None
    first, second = service.order(Order(4, (1.5, -2.0))), service.order(Order(6))
    assert loop.next_order() == Order(4, (1.5, -2.0))
    assert loop.next_order() == Order(4, (1.5, -2.0))  # until it is answered
    assert service.verdict(first) == PENDING
    loop.answer(True)
    assert loop.next_order() == Order(6)
    loop.answer(False)
    assert (service.verdict(first), service.verdict(second)) == (TAKEN, REFUSED)
    assert loop.next_order() is None
    for k in range(3 * SLOTS):
        number = service.order(Order(k))
        assert loop.next_order() == Order(k)
        loop.answer(True)
        assert service.verdict(number) == TAKEN


def test_the_status_is_whole(sides: tuple[Board, Board]) -> None:
    service, loop = sides
    shown = Status(*map(float, range(len(Status._fields))))
    loop.show(shown)
    assert service.status() == shown
    loop.say("µ" * 5000)  # longer than there is room for
    assert service.words.startswith("µ" * 100)
    loop.say("stands")
    assert service.words == "stands"


def test_an_order_too_many_is_refused_and_loses_none(sides: tuple[Board, Board]) -> None:
    service, loop = sides
    for k in range(SLOTS):
        service.order(Order(k))
    with pytest.raises(BoardFullError, match="16 orders wait already"):
        service.order(Order(99))
    for k in range(SLOTS):
        assert loop.next_order() == Order(k)
        loop.answer(True)
    service.order(Order(99))
    assert loop.next_order() == Order(99)


def test_no_count_is_ever_seen_as_zero_while_another_process_writes_it() -> None:
    """`struct.pack_into` clears first: motions ended as "setpoints ran out", with 16 s of them on the board."""
    ours = Board.create()
    ours.fill(bytes(64))
    ours.order(Order(1))
    ours.next_order()
    ours.answer(True)
    writer = "from stagectl.realtime.shared_memory import Board, Status; b = Board(int(sys.argv[1]))\n"
    writer += "b.fill(b''); b.show(Status()); b._counts[0] = b.ordered"
    with endlessly(writer, ours.descriptor):
        seen = {(ours.setpoint(0) is None, ours.next_order() is None) for _ in range(LOOKS)}
    assert seen == {(False, True)}


def test_a_loop_killed_while_it_shows_its_status_does_not_hang_the_service(sides: tuple[Board, Board]) -> None:
    service, loop = sides
    shown = Status(*map(float, range(len(Status._fields))))
    loop.show(shown)
    assert service.status() == shown
    loop.show(shown)
    loop._counts[2] = 5  # signal 9 between the count that opens a status and the one behind it
    struct.pack_into("<d", loop.memory, 64, -1.0)
    assert service.status() == shown
    assert Board(service.descriptor).status() == Status()  # who never saw a whole one knows nothing


def test_setpoints_wrap_around(sides: tuple[Board, Board]) -> None:
    service, loop = sides
    rows = b"".join(struct.pack("<8d", k, *[0.0] * 7) for k in range(20000))
    assert loop.setpoint(0) is None
    service.fill(rows)
    service.fill(rows[: 64 * 10000])
    service.fill(rows)
    assert service.filled == 50000 > AHEAD
    assert loop.setpoint(49999) == (19999.0, *[0.0] * 7)
    assert loop.setpoint(30000) == (0.0, *[0.0] * 7)
    assert loop.setpoint(29999) == (9999.0, *[0.0] * 7)
    assert loop.setpoint(50000) is None
