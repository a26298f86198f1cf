"""The standard's tables: states, commands, transitions, words."""

from __future__ import annotations

import pytest

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import TOWARDS_ENABLED, TRANSITIONS, DeviceCommand, DriveState

# CiA 402-2, table of the statusword: bits xxxx xxxx x.xx .... with x = anything
PATTERNS = {
    "xxxxxxxxx0xx0000": DriveState.NOT_READY,
    "xxxxxxxxx1xx0000": DriveState.SWITCH_ON_DISABLED,
    "xxxxxxxxx01x0001": DriveState.READY,
    "xxxxxxxxx01x0011": DriveState.SWITCHED_ON,
    "xxxxxxxxx01x0111": DriveState.OPERATION_ENABLED,
    "xxxxxxxxx00x0111": DriveState.QUICK_STOP_ACTIVE,
    "xxxxxxxxx0xx1111": DriveState.FAULT_REACTION_ACTIVE,
    "xxxxxxxxx0xx1000": DriveState.FAULT,
}


@pytest.mark.parametrize(("pattern", "state"), PATTERNS.items())
def test_statusword_says_the_state_whatever_the_other_bits(pattern: str, state: DriveState) -> None:
    for filler in ("0", "1"):
        assert cia402.state(int(pattern.replace("x", filler), 2)) is state


def test_every_statusword_has_at_most_one_state_of_the_standard() -> None:
    for word in range(0x80):
        assert sum(word & mask == bits for mask, bits in (state.value for state in DriveState)) <= 1


@pytest.mark.parametrize(
    ("pattern", "command"),
    [
        ("0xxxx110", DeviceCommand.SHUTDOWN),
        ("0xxx0111", DeviceCommand.SWITCH_ON),
        ("0xxx1111", DeviceCommand.ENABLE_OPERATION),
        ("0xxxxx0x", DeviceCommand.DISABLE_VOLTAGE),
        ("0xxxx01x", DeviceCommand.QUICK_STOP),
        ("1xxxxxxx", None),
    ],
)
def test_controlword_gives_the_command_whatever_the_other_bits(pattern: str, command: DeviceCommand | None) -> None:
    for filler in ("0", "1"):
        assert cia402.command(int(pattern.replace("x", filler), 2)) is command


def test_controlwords_are_those_everybody_sends() -> None:
    assert [command.controlword for command in DeviceCommand] == [0x06, 0x07, 0x0F, 0x00, 0x02, 0x80]


def test_transitions_are_those_of_the_drawing() -> None:
    assert len(TRANSITIONS) == 16
    assert (DriveState.SWITCH_ON_DISABLED, DeviceCommand.ENABLE_OPERATION) not in TRANSITIONS
    assert (DriveState.FAULT, DeviceCommand.ENABLE_OPERATION) not in TRANSITIONS
    assert {start for start, command in TRANSITIONS if command is DeviceCommand.QUICK_STOP} == {
        DriveState.READY,
        DriveState.SWITCHED_ON,
        DriveState.OPERATION_ENABLED,
    }
    left_by_nobody = {state for state in DriveState} - {start for start, _ in TRANSITIONS}
    assert left_by_nobody == {DriveState.NOT_READY, DriveState.FAULT_REACTION_ACTIVE}  # the drive leaves them by itself


@pytest.mark.parametrize(
    "state", [DriveState.FAULT, DriveState.SWITCH_ON_DISABLED, DriveState.READY, DriveState.SWITCHED_ON]
)
def test_the_way_up_leads_to_operation_enabled(state: DriveState) -> None:
    for _ in range(4):
        if state is not DriveState.OPERATION_ENABLED:
            state = TRANSITIONS[state, TOWARDS_ENABLED[state]]
    assert state is DriveState.OPERATION_ENABLED


@pytest.mark.parametrize(
    ("index", "value", "words"),
    [
        (0x605A, 2, "slow down on the quick stop ramp, then Switch on disabled"),
        (0x605A, 6, "slow down on the quick stop ramp and stay in Quick stop active"),
        (0x605E, 0, "power off, the axis coasts"),
        (0x6007, 0, "NO ACTION: the axis goes on when the controller is lost"),
        (0x6007, 3, "quick stop"),
        (0x605A, -3, "-3: specific to the vendor, see the drive's manual"),
        (0x605C, 17, "17: reserved"),
    ],
)
def test_options_in_words(index: int, value: int, words: str) -> None:
    assert cia402.option(index, value) == words


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x8130, "the heartbeat of the controller is lost"),
        (0x8250, "the cyclic command (RPDO) is lost"),
        (0x3210, "voltage of the DC link"),
        (0x7305, "sensor or encoder"),
        (0x4310, "temperature of the drive"),
        (0xFF12, "specific to this device: see its manual"),
        (0x0000, "error reset, or no error"),
        (0xA000, "unknown class"),
    ],
)
def test_emergencies_in_words(code: int, words: str) -> None:
    assert cia402.emergency(code) == words


def test_states_are_spelled_as_in_the_standard() -> None:
    assert [state.words for state in DriveState][:5] == [
        "Not ready to switch on",
        "Switch on disabled",
        "Ready to switch on",
        "Switched on",
        "Operation enabled",
    ]
