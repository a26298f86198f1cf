"""The self-test of a drive that is known by its bus alone: here the virtual one, in virtual time."""

from __future__ import annotations

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives import faults
from stagectl.drives.bus.virtual_time import End, Timeline, Wire
from stagectl.drives.virtual.node import VirtualNode
from stagectl.realtime.states import State
from stagectl.selftest import remote
from stagectl.selftest.matrix import Outcome, matrix
from stagectl.selftest.remote import Gentle
from stagectl.service.virtual_drive import virtual_node
from stagectl.units import StageError

GENTLE = Gentle(4.0, 5.0)  # A, rad: 9.5 mm


@pytest.fixture
def machine(slow_screw: Setup) -> tuple[Setup, VirtualNode, End, Timeline]:
    """A setup whose plant is coarse, the node that the self-test must not know, our end, and its time."""
    simulation = slow_screw.file.simulation._replace(substeps=2)
    setup = slow_screw.having(simulation=simulation)
    time, wire, setup = Timeline(), setup.canopen, setup.with_wire(reset="none")
    ours, theirs = Wire(time, wire.bitrate).ends
    node = virtual_node(setup, wire, theirs, lambda _: None, time)
    theirs.wakes = node.turn
    node.boot()
    time.every(0.001, node.turn)
    return setup, node, ours, time


def tried(machine: tuple[Setup, VirtualNode, End, Timeline], *names: str, states: tuple[State, ...]) -> list[Outcome]:
    setup, node, ours, time = machine
    bench = remote.real(setup, GENTLE, frozenset(names), ours, time)
    largest = [0.0]
    plain = node.axis.plant.command

    def watched(command: float) -> None:
        largest[0] = max(largest[0], abs(node.axis.applied))  # what the controller asks for, not the drive's own ramp
        plain(command)

    node.axis.plant.command = watched  # type: ignore[method-assign]
    cases = list(matrix(bench._replace(states=states)))
    assert 0.5 < largest[0] <= GENTLE.current
    return cases


def test_a_moving_axis_stops_as_the_table_says(machine: tuple[Setup, VirtualNode, End, Timeline]) -> None:
    cases = tried(machine, "cable-out", "node-stuck", "controller-dead", states=(State.MOVING,))
    assert [case.words for case in cases] == ["", "", ""]
    by_name = {case.name: case for case in cases}
    assert by_name["cable-out"].reason == "FEEDBACK_LOST"
    for name in ("cable-out", "controller-dead"):  # time-outs of 500 ms, the heartbeat's 600 ms at most
        stop_time = by_name[name].stop_time
        assert stop_time is not None and 0.45 < stop_time < 0.75
    assert by_name["node-stuck"].reason in ("FREEZE", "FOLLOWING_ERROR")
    # Its power is cut, and the loop goes on asking for its position until it stands: the stop is measured.
    stuck = by_name["node-stuck"]
    assert stuck.stop_time is not None and stuck.stop_time_limit is not None
    assert 0.01 < stuck.stop_time < stuck.stop_time_limit
    _, node, _, _ = machine
    assert not node.axis.enabled and abs(node.axis.plant.state.position) < 2.0 * GENTLE.travel


def test_other_states_and_a_motion_that_goes_on(machine: tuple[Setup, VirtualNode, End, Timeline]) -> None:
    cases = tried(machine, "frames-duplicated", states=(State.STANDING, State.MOVING, State.QUICK_STOPPING))
    assert [case.passed for case in cases] == [True] * 3
    assert [case.stop_time is None for case in cases] == [True, True, False]


def test_what_cannot_be_is_refused(ball_screw: Setup) -> None:
    for only, gentle, said in (
        ({"encoder-stuck"}, GENTLE, "a real drive is only tried with what comes from the controller's end"),
        (set(), Gentle(1.0, 5.0), "does not carry the friction of this stage; must be at least 1.98 A"),
        (set(), Gentle(16.0, 5.0), r"must lie in \(0, 15\] A"),
    ):
        with pytest.raises(StageError, match=said):
            remote.real(ball_screw, gentle, frozenset(only), End(Timeline(), Wire(Timeline(), 1e6)), Timeline())


def test_all_that_is_tried_is_in_the_table_of_faults() -> None:
    assert set(remote.PROVOCABLE) <= set(faults.FAULT_TYPES) and len(remote.PROVOCABLE) == 16
