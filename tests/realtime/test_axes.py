"""Several axes in one real-time process: begun together or not at all, stopped together, and left in order."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives.bus.frames import frame
from stagectl.drives.bus.shared_bus import Ports
from stagectl.drives.clock import WALL
from stagectl.drives.drive import Fault
from stagectl.realtime.axes import Loop, Post
from stagectl.realtime.shared_memory import PENDING, REFUSED, TAKEN, Order
from stagectl.realtime.states import Event, State
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.service.machine import machine
from stagectl.service.planning import laid_out
from tests.conftest import CONFIG, varied

STAGE = CONFIG / "ball-screw.yaml"


class Group:
    """X and Y with a plant each in this process, and a clock that only sleeping moves."""

    def __init__(self, setup: Setup, monkeypatch: pytest.MonkeyPatch, coupled: bool = True) -> None:
        self.now = 100.0
        monkeypatch.setattr(time, "monotonic", lambda: self.now)
        monkeypatch.setattr(WALL, "now", lambda: self.now, raising=False)
        monkeypatch.setattr(time, "sleep", self._spend)
        monkeypatch.setattr(WALL, "sleep", self._spend, raising=False)
        setup = varied(setup, substeps=1)
        self.manned = {name: AxisController(name, setup) for name in "xy"}
        orders = tuple(controller.orders()._replace(wire=None) for controller in self.manned.values())
        self.loop = Loop(Post(orders, setup.dt, 0, None, coupled))
        for axis in self.loop.axes:
            axis.happen(Event.CONNECT)

    def _spend(self, seconds: float) -> None:
        self.now += seconds

    def run(self, periods: int) -> None:
        for _ in range(periods):
            self.loop.period()

    def order(self, name: str, order: Order) -> int:
        return self.manned[name].board.order(order)

    def states(self) -> list[State]:
        return [axis.state for axis in self.loop.axes]

    def enable(self) -> None:
        for name in "xy":
            self.order(name, Order(Event.ENABLE))
        self.run(20)
        assert self.states() == [State.STANDING, State.STANDING]

    def moves(self) -> dict[str, Order]:
        return {
            name: value.start(laid_out(value.move(distance, 0.03, None)), 2)
            for (name, value), distance in zip(self.manned.items(), (0.002, -0.001), strict=True)
        }


def test_moves_begin_in_one_period(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    group = Group(ball_screw, monkeypatch)
    group.enable()
    moves = group.moves()
    first = group.order("x", moves["x"])
    group.run(5)
    assert group.states() == [State.STANDING, State.STANDING]  # x waits for y
    assert group.manned["x"].board.verdict(first) == PENDING
    group.order("y", moves["y"])
    group.run(1)
    assert group.states() == [State.MOVING, State.MOVING]
    group.run(1500)
    assert group.states() == [State.STANDING, State.STANDING]
    scale = ball_screw.file.axis.travel_per_unit
    positions = [axis.seen.position * scale for axis in group.loop.axes]
    assert positions == pytest.approx([0.002, -0.001], abs=3e-7)


def test_a_move_that_waits_for_another_is_in_no_stops_way(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    group = Group(ball_screw, monkeypatch)
    group.enable()
    waits = group.order("x", group.moves()["x"])
    group.run(5)
    off = group.order("x", Order(Event.DISABLE))
    group.run(2)
    board = group.manned["x"].board
    assert (board.verdict(waits), board.verdict(off)) == (REFUSED, TAKEN)
    group.run(200)
    assert group.states() == [State.DISABLED, State.STANDING]


def test_where_one_cannot_begin_none_does(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    group = Group(ball_screw, monkeypatch)
    group.enable()
    moves = group.moves()
    far = moves["y"]._replace(numbers=(*moves["y"].numbers[:2], -1e6, 0.0, 2.0))
    numbers = {"x": group.order("x", moves["x"]), "y": group.order("y", far)}
    group.run(2)
    assert group.states() == [State.STANDING, State.STANDING]
    assert [group.manned[name].board.verdict(number) for name, number in numbers.items()] == [REFUSED, REFUSED]


@pytest.mark.parametrize("coupled", [True, False])
def test_a_fault_of_one_stops_all_as_configured(
    ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, coupled: bool
) -> None:
    group = Group(ball_screw, monkeypatch, coupled)
    group.enable()
    for name, order in group.moves().items():
        group.order(name, order)
    group.run(60)
    x, y = group.loop.axes
    y.happen(Event.RAMP, Fault.EMERGENCY)
    group.run(1)
    assert y.state is State.QUICK_STOPPING
    assert (x.state, x.fault) == ((State.QUICK_STOPPING, Fault.PARTNER) if coupled else (State.MOVING, Fault.NONE))
    group.run(600)
    assert y.state is State.FAULT
    number = group.order("y", Order(Event.RESET))
    group.run(2)
    assert group.manned["y"].board.verdict(number) == (TAKEN if coupled else REFUSED)  # x has power where it is not


def test_an_axis_that_an_earlier_fault_has_stopped_stops_with_its_partner(
    ball_screw: Setup, monkeypatch: pytest.MonkeyPatch
) -> None:
    """X stands under power since its setpoints ran out, while y had none."""
    group = Group(ball_screw, monkeypatch)
    group.enable()
    x, y = group.loop.axes
    group.order("y", Order(Event.DISABLE))
    group.run(2)
    group.order("x", group.moves()["x"]._replace(numbers=(*group.moves()["x"].numbers[:4], 1.0)))
    group.run(60)
    x.happen(Event.HOLD, Fault.STARVED)
    group.run(800)
    group.order("y", Order(Event.ENABLE))
    group.run(20)
    assert group.states() == [State.STANDING, State.STANDING] and x.fault is Fault.STARVED
    y.happen(Event.RAMP, Fault.EMERGENCY)
    group.run(1)
    assert (x.state, x.fault) == (State.QUICK_STOPPING, Fault.PARTNER)


def test_nobody_gives_orders_any_more(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    group = Group(ball_screw, monkeypatch)
    group.enable()
    for name, order in group.moves().items():
        group.order(name, order)
    group.run(60)
    periods = 0
    while not group.loop.abandon():
        group.run(1)
        periods += 1
        assert periods < 2000
    assert group.states() == [State.FAULT, State.FAULT]
    assert [axis.faults for axis in group.loop.axes] == [1, 1]
    assert group.loop.axes[0].fault is Fault.UNATTENDED


def test_periods_lost_over_an_order_are_late_and_the_grid_goes_on(
    ball_screw: Setup, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What an order takes is no part of the period that it came in: the next one is late, and begins on the grid."""
    group, dt = Group(ball_screw, monkeypatch), ball_screw.dt
    group.enable()
    x, y = group.loop.axes

    def take(order: Order) -> bool:
        group._spend(3.3 * dt)
        return True

    monkeypatch.setattr(x, "take", take)
    began, late = group.now, x.late
    group.order("x", Order(Event.STOP))
    group.run(1)
    assert (x.late, y.late) == (late, late)
    group.run(1)
    assert (x.late, y.late) == (late + 1, late + 1)
    assert group.now - began == pytest.approx((2 + 3) * dt, rel=1e-9)
    group.run(5)
    assert (x.late, y.late) == (late + 1, late + 1)


class Wire:
    """A bus that remembers what was sent and gives what it is told."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.coming: list[bytes] = []
        self.closed = False

    def send(self, frame: bytes) -> None:
        self.sent.append(frame)

    def receive(self, timeout: float) -> bytes | None:
        return self.coming.pop(0) if self.coming else None

    def close(self) -> None:
        self.closed = True


def test_one_sync_for_all_and_each_its_own_answers() -> None:
    wire = Wire()
    ports = Ports(lambda: wire)
    x, y = ports.port(5), ports.port(6)
    alive = {x: frame(0x705 | 1 << 30), y: frame(0x77F, b"\5")}  # one is guarded, the other watches our heartbeat
    for port in (x, y):
        port.send(frame(0x080))
        port.send(frame(0x200 + port.node, b"\1\2"))
        port.send(alive[port])
    assert wire.sent == [frame(0x080), frame(0x205, b"\1\2"), alive[x], frame(0x206, b"\1\2"), alive[y]]
    wire.coming = [frame(0x186, b"y"), frame(0x185, b"x"), frame(0x123, b"?")]
    assert x.receive(0.01) == frame(0x185, b"x")
    assert y.receive(0.01) == frame(0x186, b"y")
    assert y.receive(0.01) is not None  # of nobody: whoever listens may see it
    assert x.receive(0.001) is None
    x.close()
    x.close()
    y.send(frame(0x080))  # now it is y that gives the beat
    assert wire.sent[-1] == frame(0x080)
    assert not wire.closed
    y.close()
    assert wire.closed


def test_axes_that_cannot_share_are_refused_with_figures(tmp_path: Path) -> None:
    slow = tmp_path / "slow.yaml"
    slow.write_text(
        STAGE.read_text().replace("period: 0.5 ms", "period: 1 ms").replace("bandwidth: 40 Hz", "bandwidth: 20 Hz")
    )
    (tmp_path / "drives").symlink_to(CONFIG / "drives")
    other = tmp_path / "other.yaml"
    for text, period, wrong in (
        (slow.read_text(), "slow", "for both: give each another number"),
        (STAGE.read_text().replace("node: 5", "node: 6"), "slow", "the same$"),
        (STAGE.read_text().replace("node: 5", "node: 6"), "fast", r"take 119 % of the bus, .* at least 0.744 ms"),
    ):
        other.write_text(text)
        with pytest.raises(ServiceError, match=wrong):
            machine([f"x={slow if period == 'slow' else STAGE}", f"y={other}"], None)
    other.write_text(slow.read_text().replace("node: 5", "node: 6"))
    assert list(machine([f"x={slow}", f"y={other}"], None)) == ["x", "y"]
    assert list(machine([str(STAGE)], None)) == ["axis"]
    with pytest.raises(ServiceError, match="a name of its own"):
        machine([str(slow), str(other)], None)
