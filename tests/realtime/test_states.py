"""The state machine's table, walked whole: every fault in every state, every order, and the way out of each state."""

from __future__ import annotations

import pytest

from stagectl.drives.drive import Fault
from stagectl.realtime.states import POWERED, STOPS_GOING_ON, TABLE, Event, State, event_of, following, why_not
from stagectl.realtime.stops import STOPS, Category

FAULTS = [fault for fault in Fault if fault is not Fault.NONE]
ENDS = {Category.COAST: State.COASTING, Category.RAMP: State.QUICK_STOPPING}


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_in_every_state_ends_where_its_category_says(state: State, fault: Fault) -> None:
    next_state, category = following(state, event_of(fault)), STOPS[fault].category
    if state in (State.OFFLINE, State.CONNECTING):
        assert next_state is State.OFFLINE
    elif state in (State.DISABLED, State.ENABLING, State.FAULT, State.ENGAGING):
        assert next_state is State.FAULT  # nothing moves: nothing to stop
    elif state in STOPS_GOING_ON:
        assert next_state is (State.COASTING if category is Category.COAST else state)  # a stop is never made weaker
    elif category is Category.HOLD:
        own = {State.STANDING: State.STANDING, State.DRIVE_HOMING: State.QUICK_STOPPING}  # there our law does not act
        assert next_state is own.get(state, State.STOPPING)
    else:
        assert next_state is ENDS[category]


@pytest.mark.parametrize("state", [*POWERED, *STOPS_GOING_ON, State.ENABLING, State.ENGAGING, State.DRIVE_HOMING])
@pytest.mark.parametrize("order", [Event.STOP, Event.QUICK_STOP, Event.DISABLE])
def test_a_stop_is_never_refused(state: State, order: Event) -> None:
    next_state = following(state, order)
    assert next_state is not None
    assert next_state not in (State.MOVING, State.HOMING, State.ENABLING)


def test_only_enabling_brings_power_and_only_standing_begins_a_motion() -> None:
    powered = {*POWERED, *STOPS_GOING_ON, State.DRIVE_HOMING}
    gained = {(a, event, b) for (a, event), b in TABLE.items() if a not in powered and b in powered}
    assert gained == {(State.ENABLING, Event.DONE, State.STANDING)}
    assert {a for (a, _), b in TABLE.items() if b is State.DRIVE_HOMING and a is not b} == {State.HOMING}
    begun = {(a, event) for (a, event), b in TABLE.items() if b in (State.MOVING, State.HOMING) and a is not b}
    assert begun == {(State.STANDING, Event.MOVE), (State.STANDING, Event.HOME)}


def test_a_fault_is_left_by_reset_alone() -> None:
    assert {event for (a, event), b in TABLE.items() if a is State.FAULT and b is not a} == {Event.RESET}
    assert following(State.FAULT, Event.RESET) is State.CONNECTING
    for order in (Event.ENABLE, Event.MOVE, Event.HOME, Event.CONNECT):
        assert following(State.FAULT, order) is None


def test_from_every_state_there_is_a_way_to_stand_without_power_and_to_stand_under_it() -> None:
    for start in State:
        reached, fresh = {start}, {start}
        while fresh:
            fresh = {b for (a, _), b in TABLE.items() if a in fresh} - reached
            reached |= fresh
        assert reached >= {State.DISABLED, State.STANDING}, start


def test_every_state_has_words() -> None:
    assert len({state.words for state in State}) == len(State)


@pytest.mark.parametrize("order", [Event.ENABLE, Event.MOVE, Event.HOME])
def test_what_an_axis_in_fault_refuses_begins_with_a_reset(order: Event) -> None:
    advice = why_not(order, State.FAULT)
    assert "`stagectl fault reset`" in advice
    if order is not Event.ENABLE:
        assert advice.index("fault reset") < advice.index("`stagectl enable`")
        assert "fault reset" not in why_not(order, State.DISABLED)
