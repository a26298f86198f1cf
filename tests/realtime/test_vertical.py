"""A vertical axis with a brake that its drive works: whatever ends its power, it does not drop."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, cast

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives.brake import Brake
from stagectl.drives.canopen.library import SdoAbortedError
from stagectl.drives.drive import Fault, StartUp
from stagectl.drives.faults import BLOCKS
from stagectl.drives.homing import Homing
from stagectl.drives.limits import BRAKE_PATIENCE
from stagectl.kernels.effects import Harmonic
from stagectl.kernels.plant import Cable
from stagectl.realtime.states import Event, State
from stagectl.realtime.stops import without_power
from stagectl.selftest.rig import usual
from tests.single_motion import SingleMotion

DROP = 0.1e-3  # m
WEIGHT = -2.0  # N m, more than the friction carries
PER_UNIT = 12e-3 / 6.283185307179586  # m/rad
ENGAGE = 0.05  # s
WRITE_ONLY = 0x0601_0001  # SDO abort code of CiA 301


@pytest.fixture
def upright(ball_screw: Setup) -> Setup:
    p, file = ball_screw.stage, ball_screw.file
    return ball_screw._replace(
        stage=p._replace(mechanics=p.mechanics._replace(bias=WEIGHT)),
        file=file._replace(brake=Brake("drive", 0.03, ENGAGE)),
    )


class Bench(SingleMotion):
    """The loop of a single motion against the virtual drive, in virtual time."""

    def __init__(self, setup: Setup, moving: bool) -> None:
        pace = usual(setup)
        super().__init__(setup, moving, pace._replace(acceleration=0.2 * pace.acceleration))  # the weight has its share

    def run(self, over: Callable[[], bool], most: int = 20_000) -> None:
        for _ in range(most):
            if over():
                return
            self.loop.period()
        raise AssertionError(f"{self.axis.state.name}: {self.axis.board.words}")

    def to_motion(self, periods: int = 200) -> None:
        self.run(lambda: self.axis.state is State.MOVING)
        for _ in range(periods):
            self.loop.period()

    @property
    def secured(self) -> bool:
        """Whether the brake holds, and the power is off."""
        return not self.rig.seen.powered and not self.rig.node.axis.brake.free

    def dropped(self, since: int) -> float:
        """How far below the highest place after row `since` of the trace it ended (m)."""
        places = [sample.position for sample in self.rig.trace[since:]]
        return (max(places) - places[-1]) * PER_UNIT


def killed(bench: Bench) -> None:
    """No more periods: as after kill -9."""


def tripped(bench: Bench) -> None:
    bench.rig.trip(0x2310)
    bench.run(lambda: bench.axis.state in (State.FAULT, State.OFFLINE))


def switched_off(bench: Bench) -> None:
    bench.axis.happen(Event.QUICK_STOP)
    bench.run(lambda: bench.axis.state is State.DISABLED)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("end", [killed, tripped, switched_off])
def test_it_does_not_drop(upright: Setup, end: Callable[[Bench], None], moving: bool) -> None:
    bench = Bench(upright, moving)
    bench.to_motion()
    since = len(bench.rig.trace)
    end(bench)
    bench.rig.time.sleep(3.0)
    assert not bench.rig.seen.powered
    assert bench.rig.seen.velocity == 0.0
    assert bench.dropped(since) <= DROP


def test_an_order_to_switch_off_lets_the_brake_hold_first(upright: Setup) -> None:
    bench = Bench(upright, False)
    bench.run(lambda: bench.axis.state is State.MOVING)
    bench.axis.state = State.STANDING
    since, began = len(bench.rig.trace), bench.rig.time.now()
    bench.loop.engage()
    assert bench.axis.state is State.DISABLED
    assert bench.rig.time.now() - began >= ENGAGE
    bench.loop.leave()
    bench.rig.time.sleep(1.0)
    assert not bench.rig.seen.powered
    assert bench.dropped(since) <= DROP


def test_torque_comes_before_release_and_release_before_motion(upright: Setup) -> None:
    bench = Bench(upright, True)
    bench.run(lambda: bench.rig.node.axis.enabled)
    powered = bench.rig.time.now()
    bench.run(lambda: bench.axis.state is State.MOVING)
    assert bench.rig.time.now() - powered >= 0.03
    assert bench.dropped(0) <= DROP  # nor while it gets its power


def hanging(setup: Setup) -> Setup:
    """A weight that turns with the axis, 1.5 N m where it stands."""
    gravity = Harmonic(1.5, 1.0, 1.2)
    return setup._replace(stage=setup.stage._replace(mechanics=setup.stage.mechanics._replace(gravity=gravity)))


@pytest.mark.parametrize("control", ["drive", "output"])
def test_its_brake_is_released_under_no_more_current_than_the_load_needs(ball_screw: Setup, control: str) -> None:
    setup = hanging(ball_screw.having(brake=Brake(cast(Any, control), 0.03, ENGAGE)))
    bench = Bench(setup.with_wire(start_up=(StartUp(0x605A00, 6),)) if control == "output" else setup, False)
    p = setup.stage
    needs, step = 1.5 * math.sin(1.2) / p.motor.force_constant, p.drive.current_quantum
    plant = bench.rig.node.axis.plant
    currents: list[float] = []
    bench.run(lambda: currents.append(plant.state.current) or bench.rig.node.axis.brake.free)  # type: ignore[func-returns-value]
    assert currents[-1] == pytest.approx(needs, abs=step)
    assert min(currents) >= 0.0 and max(currents) <= needs + step
    bench.to_motion()
    assert abs(bench.rig.seen.position) < p.encoder.step  # nor does it move as it gets free


def test_without_a_home_the_place_of_a_weight_is_not_known(ball_screw: Setup) -> None:
    """Half a turn off, a current against it would push with it."""
    setup = hanging(ball_screw.having(brake=Brake("drive", 0.03, ENGAGE)))
    bench = Bench(setup, False)
    bench.axis.homed = False
    bench.run(lambda: bench.axis.state is not State.ENABLING)
    assert bench.axis.holding == 0.0


@pytest.mark.parametrize("control", ["drive", "output"])
def test_a_bus_that_fails_as_power_comes_leaves_the_axis_where_it_is(ball_screw: Setup, control: str) -> None:
    """With a brake of ours its drive holds it under power, which nobody can cut: that it has none is not claimed."""
    setup = hanging(ball_screw.having(brake=Brake(cast(Any, control), 0.03, ENGAGE)))
    bench = Bench(setup.with_wire(start_up=(StartUp(0x605A00, 6),)) if control == "output" else setup, False)
    bench.run(lambda: bench.rig.node.axis.brake.free)
    assert bench.axis.state is State.ENABLING
    bench.rig.cut_off()
    bench.run(lambda: bench.axis.state is State.FAULT)
    bench.rig.time.sleep(2.0)
    assert abs(bench.rig.seen.position) < setup.stage.encoder.step
    assert bench.rig.seen.powered == (control == "output")
    assert without_power(Fault.BUS) not in bench.axis.board.words


def test_a_single_motion_that_needs_no_home_does_not_know_the_place_either(ball_screw: Setup) -> None:
    """`run` counts from where the drive's counter happens to stand, unless the stage file calls that absolute."""
    setup = hanging(ball_screw.having(brake=Brake("drive", 0.03, ENGAGE), homing=Homing("limit", 1.0, 10.0)))
    bench = Bench(setup, False)
    bench.run(lambda: bench.axis.state is not State.ENABLING)
    assert bench.axis.homed and bench.axis.holding == 0.0


def test_a_drive_that_has_not_answered_yet_is_waited_for(ball_screw: Setup) -> None:
    """Its position is no number until its first answer; power and brake come later."""
    bench = Bench(hanging(ball_screw.having(brake=Brake("drive", 0.03, ENGAGE))), False)
    seen = bench.axis.seen
    bench.axis.seen, bench.axis.start = seen._replace(position=math.nan), math.nan
    assert not bench.axis.adrift() and bench.axis.holding == 0.0
    bench.axis.seen = seen._replace(position=0.0)
    assert not bench.axis.adrift() and bench.axis.holding > 0.0


@pytest.mark.parametrize("place", [1e6, -1e6])
def test_no_place_asks_for_more_than_the_load_within_the_travel(ball_screw: Setup, place: float) -> None:
    """An absolute encoder that has lost its turns: by its reading the cable would be a kilometre long."""
    setup = ball_screw.having(brake=Brake("drive", 0.03, ENGAGE))
    mechanics = setup.stage.mechanics._replace(cable=Cable(0.01))
    bench = Bench(setup._replace(stage=setup.stage._replace(mechanics=mechanics)), False)
    bench.axis.seen = bench.axis.seen._replace(position=place)
    needs = 0.01 * setup.file.limits.travel[1] / setup.stage.motor.force_constant
    assert abs(bench.axis.carrying()) == pytest.approx(needs, abs=setup.stage.drive.current_quantum)


def test_without_its_brake_it_would_drop(upright: Setup) -> None:
    """Or else the tests above show nothing."""
    bench = Bench(upright.having(brake=Brake()), False)
    bench.to_motion()
    since = len(bench.rig.trace)
    bench.axis.happen(Event.QUICK_STOP)
    for _ in range(1000):
        bench.loop.period()
    assert bench.dropped(since) > DROP


def let_go(bench: Bench) -> None:
    """Kill -9: only the drive is left, which holds the axis by itself."""
    bench.rig.time.sleep(3.0)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize(("end", "power"), [(let_go, True), (switched_off, False)])
def test_a_brake_on_an_output_holds(upright: Setup, end: Callable[[Bench], None], power: bool, moving: bool) -> None:
    """The drive has no brake of its own: we set it by 0x60FE; where we die, the drive holds under power (0x605A)."""
    holding = upright.with_wire(start_up=(StartUp(0x605A00, 6),))
    bench = Bench(holding.having(brake=Brake("output", 0.03, ENGAGE)), moving)
    assert not bench.rig.node.axis.brake.free
    bench.to_motion()
    assert bench.rig.node.axis.brake.free
    since = len(bench.rig.trace)
    end(bench)
    for _ in range(0 if power else 500):
        bench.loop.period()
    assert bench.rig.seen.powered == power
    assert bench.rig.node.axis.brake.free == power
    assert abs(bench.rig.seen.velocity) < 1e-3
    assert bench.dropped(since) <= DROP


@pytest.mark.parametrize("reset", ["none", "communication", "node"])
def test_a_new_controller_sets_the_brake_before_it_takes_the_power(upright: Setup, reset: str) -> None:
    """The drive holds the axis that its controller has left; the next one must not let it drop."""
    holding = upright.with_wire(start_up=(StartUp(0x605A00, 6),), reset=reset)
    bench = Bench(holding.having(brake=Brake("output", 0.03, ENGAGE)), False)
    bench.to_motion()
    since = len(bench.rig.trace)
    bench.rig.node.axis.restart = bench.rig.node.axis.power_cycled  # type: ignore[method-assign]  # moves no machine
    let_go(bench)
    assert bench.rig.seen.powered and bench.rig.node.axis.brake.free
    drive = bench.rig.connect()
    bench.rig.time.sleep(1.0)
    assert "stopped, and its power cut" in drive.describe()["found under power"]
    assert bench.secured
    assert bench.dropped(since) <= DROP


def worked_by_us(setup: Setup, release: float, holding: float | None = None) -> Bench:
    """An axis whose brake opens 30 ms after the order, and may move after `release` (s)."""
    stays = setup.with_wire(start_up=(StartUp(0x605A00, 6),))
    bench = Bench(stays.having(brake=Brake("output", release, 4 * ENGAGE, holding)), False)
    bench.rig.node.axis.brake._p = Brake("output", 0.03, 4 * ENGAGE)
    return bench


@pytest.mark.parametrize("order", [Event.STOP, Event.QUICK_STOP, Event.DISABLE])
def test_a_stop_while_its_brake_is_released_lets_the_brake_hold_again_first(upright: Setup, order: Event) -> None:
    bench = worked_by_us(upright, release=0.3)
    bench.run(lambda: bench.rig.node.axis.brake.free)
    assert bench.axis.state is State.ENABLING
    since = len(bench.rig.trace)
    assert bench.axis.happen(order)
    bench.run(lambda: bench.axis.state is State.DISABLED)
    bench.loop.leave()
    bench.rig.time.sleep(1.0)
    assert bench.secured
    assert bench.dropped(since) <= DROP


def test_nobody_gives_orders_any_more_while_its_brake_engages(upright: Setup) -> None:
    bench = worked_by_us(upright, release=0.03)
    bench.to_motion()
    bench.axis.state = State.STANDING
    since = len(bench.rig.trace)
    bench.axis.happen(Event.DISABLE)
    bench.loop.period()
    bench.run(bench.loop.abandon)
    bench.loop.leave()
    bench.rig.time.sleep(1.0)
    assert bench.axis.state is State.DISABLED
    assert not bench.rig.seen.powered
    assert bench.dropped(since) <= DROP


def test_an_order_to_the_brake_that_is_lost_is_given_again_before_power_goes(upright: Setup) -> None:
    bench = worked_by_us(upright, release=0.03)
    bench.to_motion()
    since, ours = len(bench.rig.trace), cast(Any, bench.rig.ours)
    sent: Callable[[bytes], None] = ours.send
    lost: list[bytes] = []

    def send(raw: bytes) -> None:
        if raw[0:2] == b"\x05\x06" and raw[9:12] == b"\xfe\x60\x01" and not lost:  # SDO to node 5: 0x60FE:01
            lost.append(raw)
        else:
            sent(raw)

    ours.send = send
    switched_off(bench)
    bench.loop.leave()
    bench.rig.time.sleep(1.0)
    assert lost and bench.secured
    assert bench.dropped(since) <= DROP


def test_a_brake_does_not_stay_released_where_power_goes_before_the_axis_may_move(upright: Setup) -> None:
    bench = worked_by_us(upright, release=0.3)
    bench.run(lambda: bench.rig.node.axis.brake.free)
    assert bench.axis.state is State.ENABLING
    bench.rig.node.axis.open_sto()
    began = bench.rig.time.now()
    bench.run(lambda: not bench.rig.node.axis.brake.free)
    assert bench.rig.time.now() - began <= 4 * ENGAGE + 0.01  # no sooner can it hold


def test_an_axis_that_its_holding_current_does_not_carry_loses_its_power_within_the_following_error(
    upright: Setup,
) -> None:
    bench = worked_by_us(upright, release=0.5, holding=-8.0)  # of the wrong sign
    bench.run(lambda: bench.axis.state is not State.ENABLING)
    assert (bench.axis.state, bench.axis.fault) == (State.FAULT, Fault.FOLLOWING_ERROR)
    assert "brake.holding_current" in bench.axis.board.words
    limit = upright.file.limits.following_error
    assert abs(bench.rig.seen.position) < 3.0 * limit
    for _ in range(1000):
        bench.loop.period()
    assert bench.secured


def test_a_brake_that_takes_its_time_is_waited_for(upright: Setup) -> None:
    """Longer than a drive may take to give power; the block `brake` admits 5 s."""
    bench = worked_by_us(upright, release=5.0)
    bench.run(lambda: bench.axis.state is not State.ENABLING, 25_000)
    assert bench.axis.state is State.MOVING, bench.axis.board.words


def test_a_release_that_the_outputs_do_not_show_moves_nothing(upright: Setup) -> None:
    bench = worked_by_us(upright, release=0.03)
    bench.rig.node.objects.getters[0x60FE01] = lambda: 1
    bench.run(lambda: bench.axis.state is not State.ENABLING, 25_000)
    assert (bench.axis.state, bench.axis.fault) == (State.FAULT, Fault.DRIVE_FAULT)
    assert "0x60FE" in bench.axis.board.words


def test_outputs_that_cannot_be_read_are_taken_by_the_answer_to_the_write(upright: Setup) -> None:
    bench = worked_by_us(upright, release=0.03)

    def unreadable() -> int:
        raise SdoAbortedError(WRITE_ONLY)

    bench.rig.node.objects.getters[0x60FE01] = unreadable
    bench.to_motion()
    since = len(bench.rig.trace)
    switched_off(bench)
    bench.loop.leave()
    bench.rig.time.sleep(1.0)
    assert bench.secured
    assert bench.dropped(since) <= DROP


@pytest.mark.parametrize("lost", [0.3, 30.0])
def test_power_stays_until_the_brake_is_confirmed_and_no_longer_than_a_second(upright: Setup, lost: float) -> None:
    """All orders to it are lost, for longer than it takes to engage: it holds nothing before it has heard one."""
    bench = worked_by_us(upright, release=0.03)
    bench.to_motion()
    bench.axis.state = State.STANDING
    since, ours, until = len(bench.rig.trace), cast(Any, bench.rig.ours), bench.rig.time.now() + lost
    sent: Callable[[bytes], None] = ours.send
    deaf = lambda raw: raw[0:2] == b"\x05\x06" and bench.rig.time.now() < until  # noqa: E731
    ours.send = lambda raw: None if deaf(raw) else sent(raw)
    bench.axis.happen(Event.DISABLE)
    began = bench.rig.time.now()
    bench.run(lambda: bench.axis.state is not State.ENGAGING)
    confirmed = lost < BRAKE_PATIENCE
    assert bench.rig.time.now() - began <= 4 * ENGAGE + BRAKE_PATIENCE + 0.01
    assert bench.axis.state is (State.DISABLED if confirmed else State.FAULT)
    assert confirmed or "0x60FE" in bench.axis.board.words
    bench.loop.leave()
    bench.rig.time.sleep(1.0)
    assert not bench.rig.seen.powered
    assert not confirmed or bench.dropped(since) <= DROP


def test_a_bus_that_fails_while_the_brake_engages_does_not_keep_the_process(upright: Setup) -> None:
    bench = worked_by_us(upright, release=0.03)
    bench.to_motion()
    bench.axis.state = State.STANDING
    bench.axis.happen(Event.DISABLE)
    bench.loop.period()
    bench.rig.cut_off()
    end = bench.rig.time.now() + 10.0
    sleep = bench.rig.time.sleep

    def bounded(seconds: float) -> None:
        assert bench.rig.time.now() < end
        sleep(seconds)

    bench.rig.time.sleep = bounded  # type: ignore[method-assign]
    bench.loop.leave()


def test_a_drive_that_holds_by_itself_is_let_go_where_commands_are_lost(upright: Setup) -> None:
    """It stays in Quick stop active, under power: what ends that is told by SDO, too."""
    bench = worked_by_us(upright, release=0.03)
    bench.to_motion()
    since = len(bench.rig.trace)
    bench.rig.begin(BLOCKS["command-lost"]("command-lost"))
    bench.run(lambda: bench.axis.state is State.FAULT)
    bench.run(lambda: not bench.rig.node.axis.brake.free)
    for _ in range(500):
        bench.loop.period()
    bench.rig.time.sleep(0.002)
    assert bench.secured
    assert bench.dropped(since) <= DROP


def test_the_end_of_a_process_takes_the_power_where_commands_are_lost(upright: Setup) -> None:
    bench = worked_by_us(upright, release=0.03)
    bench.to_motion()
    bench.rig.begin(BLOCKS["command-lost"]("command-lost"))
    bench.run(lambda: bench.axis.state is State.FAULT)
    bench.loop.leave()
    bench.rig.time.sleep(1.0)
    assert bench.secured


@pytest.mark.parametrize(("fault", "lasts"), [("feedback-lost", 0.002), ("feedback-lost", 0.0), ("cable-out", 0.0)])
def test_a_drive_that_is_not_heard_is_not_left_before_its_brake_holds(upright: Setup, fault: str, lasts: float) -> None:
    """One answer is lost, or all: what cannot be seen to hold is left to the drive, which holds the axis by itself."""
    bench = worked_by_us(upright, release=0.03)
    bench.to_motion()
    bench.axis.state = State.STANDING
    since = len(bench.rig.trace)
    bench.axis.happen(Event.DISABLE)
    bench.loop.period()
    bench.rig.begin(BLOCKS[fault](fault)._replace(duration=lasts))
    bench.loop.leave()
    bench.rig.time.sleep(3.0)
    assert bench.dropped(since) <= DROP
    assert bench.rig.seen.powered != bool(lasts)
