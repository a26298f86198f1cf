"""The virtual drive: byte scripts from CiA 301 and CiA 402, its delay, its own stops, and the stock library."""

from __future__ import annotations

import math
import random
import struct
import time
from collections.abc import Callable
from typing import Any

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402

from stagectl.drives.bus.frames import frame, parse
from stagectl.drives.bus.virtual_time import End, Timeline
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.drive import DriveError
from stagectl.drives.virtual.node import VirtualNode
from stagectl.kernels import stage
from tests.drives.workbench import DT, STEP, SYNC, Script, Workbench, linear_stage

START, STOP, RESET = (frame(0, bytes([command, 5])) for command in (0x01, 0x02, 0x81))
MAPPED = (0x6040_0010, 0x2071_0020)


def sdo(text: str) -> bytes:
    """An SDO request from its bytes as the standard prints them."""
    return frame(0x605, bytes.fromhex(text))


def write(index: int, subindex: int, value: int, size: int) -> bytes:
    head = bytes([0x23 | (4 - size) << 2]) + struct.pack("<HB", index, subindex)
    return frame(0x605, head + value.to_bytes(size, "little", signed=value < 0).ljust(4, b"\0"))


def rpdo(controlword: int, current: int = 0) -> bytes:
    return frame(0x205, struct.pack("<Hi", controlword, current))


def remapped() -> list[bytes]:
    """The RPDO of the tests: controlword and fine current."""
    return [
        write(0x1400, 2, 1, 1),
        write(0x1400, 1, 0x8000_0205, 4),
        write(0x1600, 0, 0, 1),
        *(write(0x1600, n, entry, 4) for n, entry in enumerate(MAPPED, start=1)),
        write(0x1600, 0, 2, 1),
        write(0x1400, 1, 0x205, 4),
        write(0x6060, 0, 10, 1),
    ]


def enabled() -> list[bytes]:
    return [*remapped(), START, rpdo(6), SYNC, rpdo(7), SYNC, rpdo(15), SYNC]


def play(bench: Workbench, script: Script, *steps: bytes | Callable[[], Any], **changes: Any) -> VirtualNode:
    node = bench.node(script, **changes)
    script.steps.extend(steps)
    node.run(script.done)
    return node


def answers(script: Script, identifier: int = 0x585) -> list[str]:
    return [parse(raw)[1].hex(" ") for raw in script.sent if parse(raw)[0] == identifier]


def tpdos(script: Script) -> list[tuple[int, int, int]]:
    """Statusword, position (counts) and current (per mille) of each TPDO."""
    data = [parse(raw)[1] for raw in script.sent if parse(raw)[0] == 0x185]
    return [struct.unpack("<Hih", item) for item in data]


def test_it_boots_and_answers_as_cia_301_says(bench: Workbench, script: Script) -> None:
    play(
        bench,
        script,
        sdo("40 00 10 00 00 00 00 00"),  # device type
        sdo("40 08 10 00 00 00 00 00"),  # its name, in segments
        sdo("60 00 00 00 00 00 00 00"),
        sdo("40 34 12 00 00 00 00 00"),  # no such object
        sdo("40 18 10 09 00 00 00 00"),  # no such subindex
        sdo("2b 41 60 00 00 00 00 00"),  # the statusword is read only
        sdo("2f 40 60 00 06 00 00 00"),  # one byte for two
    )
    assert answers(script, 0x705) == ["00"]  # boot-up
    assert answers(script) == [
        "43 00 10 00 92 01 02 00",
        "41 08 10 00 16 00 00 00",
        "00 73 74 61 67 65 63 74",
        "80 34 12 00 00 00 02 06",
        "80 18 10 09 11 00 09 06",
        "80 41 60 00 02 00 01 06",
        "80 40 60 00 10 00 07 06",
    ]


@pytest.mark.parametrize(
    ("steps", "abort"),
    [
        ([write(0x1600, 1, 0x6041_0010, 4)], 0x0800_0022),  # the PDO exists
        ([write(0x1400, 1, 0x8000_0205, 4), write(0x1600, 1, 0x6040_0010, 4)], 0x0800_0022),  # count is not 0
        ([write(0x1A01, 0, 0, 1), write(0x1A01, 1, 0x6040_0008, 4)], 0x0607_0010),  # wrong length
        ([write(0x1A01, 0, 0, 1), write(0x1A01, 1, 0x1018_0120, 4)], 0x0604_0041),  # not mappable
        ([write(0x1A01, 0, 0, 1), write(0x1A01, 1, 0x5555_0020, 4)], 0x0602_0000),  # no such object
        ([write(0x1601, 0, 0, 1), write(0x1601, 1, 0x6041_0010, 4)], 0x0604_0041),  # not to be written
        ([write(0x1A01, 0, 0, 1), *(write(0x1A01, n, 0x6064_0020, 4) for n in (1, 2, 3)), write(0x1A01, 0, 3, 1)],
         0x0604_0042),  # twelve bytes
        ([write(0x1800, 1, 0x186, 4)], 0x0609_0030),  # an existing PDO keeps its identifier
        ([write(0x1800, 2, 254, 1)], 0x0609_0030),  # event-driven TPDOs are not offered
        ([write(0x605A, 0, 3, 2)], 0x0609_0030),
        ([write(0x605A, 0, -1, 2)], 0x0609_0030),
        ([write(0x6060, 0, 8, 1)], 0x0609_0030),  # no position mode
    ],
)  # fmt: skip
def test_what_the_standard_forbids_is_aborted(bench: Workbench, script: Script, steps: list[bytes], abort: int) -> None:
    play(bench, script, *steps)
    assert answers(script)[-1].endswith(abort.to_bytes(4, "little").hex(" "))
    assert all(answer.startswith("60") for answer in answers(script)[:-1])


def test_the_state_machine_goes_up_and_down_by_pdos(bench: Workbench, script: Script) -> None:
    down = [rpdo(7), SYNC, rpdo(6), SYNC, rpdo(0), SYNC, SYNC]
    play(bench, script, *enabled(), *down)
    # each TPDO carries the state before the RPDO that acts with the same SYNC
    assert [hex(status & 0x6F) for status, _, _ in tpdos(script)] == [
        "0x40", "0x21", "0x23", "0x27", "0x23", "0x21", "0x40"]  # fmt: skip


def test_nothing_is_skipped_and_nothing_moves_before(bench: Workbench, script: Script) -> None:
    node = play(bench, script, *remapped(), START, rpdo(15, 500_000), SYNC, rpdo(7, 500_000), *[SYNC] * 20)
    assert node.axis.state is DriveState.SWITCH_ON_DISABLED
    assert {position for _, position, _ in tpdos(script)} == {0}


def test_pdos_need_operational_and_another_mode_gives_no_current(bench: Workbench, script: Script) -> None:
    node = play(bench, script, *remapped(), SYNC, rpdo(6), SYNC)
    assert (tpdos(script), node.axis.state) == ([], DriveState.SWITCH_ON_DISABLED)
    script.steps += [*enabled(), write(0x6060, 0, 0, 1), rpdo(15, 900_000), *[SYNC] * 20]
    node.run(script.done)
    assert node.axis.state is DriveState.OPERATION_ENABLED
    assert tpdos(script)[-1][1] == 0


def test_the_delay_is_exactly_one_period(bench: Workbench, script: Script) -> None:
    draw = random.Random(7)
    commands = [draw.randrange(-800_000, 800_000) for _ in range(200)]
    play(bench, script, *enabled(), *(step for count in commands for step in (SYNC, rpdo(15, count))))
    measured = [position for _, position, _ in tpdos(script)][-len(commands) :]
    p = linear_stage()
    p = p._replace(drive=p.drive._replace(delay_samples=1))
    x, expected = stage.at_rest(p), []
    for count in commands:  # latch, then command: what `sample` and `apply` do
        expected.append(round(stage.measured(p.encoder, x, stage.SILENT) / STEP))
        x = stage.period(p, x, count * 1e-5, stage.SILENT, DT, 4)
    assert measured == expected
    assert max(expected) - min(expected) > 1000


def test_per_mille_of_rated_current_is_offered_too(bench: Workbench, script: Script) -> None:
    changes = {"command_object": 0x607100, "command_scale": 0.01}
    mapping = [step for step in remapped()]
    mapping[4] = write(0x1600, 2, 0x6071_0010, 4)
    steps = [*mapping, START]
    for word, current in ((6, 0), (7, 0), (15, 0), (15, 123), (15, 123), (15, 123)):
        steps += [frame(0x205, struct.pack("<Hh", word, current)), SYNC]
    node = play(bench, script, *steps, **changes)
    assert node.axis.applied == pytest.approx(1.23)
    assert tpdos(script)[-1][2] == 123  # measured, the current loop being ideal


def test_a_wrong_scale_is_refused(bench: Workbench) -> None:
    with pytest.raises(DriveError, match="1e-05") as caught:
        bench.node(command_scale=0.1)
    assert (caught.value.place, caught.value.object_key, caught.value.value) == ("command_scale", 0x207100, 0.1)


def test_a_fault_is_told_remembered_and_reset(bench: Workbench, script: Script) -> None:
    node = bench.node(script)
    script.steps += [
        *enabled(), lambda: node.trip(0x4310), *[SYNC] * 40,
        sdo("40 03 10 00 00 00 00 00"), sdo("40 03 10 01 00 00 00 00"), sdo("40 3f 60 00 00 00 00 00"),
        rpdo(15), SYNC, rpdo(0x8F), SYNC, SYNC,
    ]  # fmt: skip
    node.run(script.done)
    assert answers(script, 0x085) == ["10 43 01 00 00 00 00 00", "00 00 00 00 00 00 00 00"]
    assert answers(script)[-3:] == [
        "4f 03 10 00 01 00 00 00",
        "43 03 10 01 10 43 00 00",
        "4b 3f 60 00 10 43 00 00",
    ]
    states = [hex(status & 0x4F) for status, _, _ in tpdos(script)]
    assert [state for n, state in enumerate(states[3:]) if state != states[2 + n]] == ["0xf", "0x8", "0x40"]
    assert bench.reports[0] == "fault 0x4310 (temperature of the drive): slow down on the quick stop ramp"


@pytest.mark.parametrize(("option", "state"), [(0, 0x40), (2, 0x40), (5, 0x07), (6, 0x07)])
def test_quick_stop_brakes_on_its_ramp(bench: Workbench, script: Script, option: int, state: int) -> None:
    push = [rpdo(15, 100_000), SYNC] * 60
    node = bench.node(script)
    speeds: list[float] = []
    steps: list[Any] = [write(0x605A, 0, option, 2), write(0x6085, 0, round(2.0 / STEP), 4), *enabled(), *push]
    for _ in range(400):
        steps += [SYNC, lambda: speeds.append(node.axis.plant.state.velocity)]
    steps.insert(-800, rpdo(2))
    script.steps += steps
    node.run(script.done)
    assert tpdos(script)[-1][0] & 0x6F == state
    assert speeds[0] == pytest.approx(0.27, rel=0.1)  # (50 N/A * 1 A - 5 N) / 10 kg * 60 ms
    if option == 0:
        assert speeds[200] > 0.1  # coasts
        return
    assert abs(speeds[-1]) < 1e-3
    ideal = speeds[0] ** 2 / (2 * 2.0)
    duration, counts = (float(word) for word in bench.reports[-1].split() if word.lstrip("-").isdigit())
    assert ideal < counts * STEP < 1.6 * ideal  # the velocity loop lags behind the ramp
    assert 1.0 <= duration * 1e-3 / (speeds[0] / 2.0) < 1.5


def test_quick_stop_options_5_and_6_let_the_axis_be_enabled_again(bench: Workbench, script: Script) -> None:
    stop = [rpdo(2), *[SYNC] * 60, rpdo(15), SYNC, SYNC]
    node = play(bench, script, write(0x605A, 0, 6, 2), *enabled(), *stop)
    assert node.axis.state is DriveState.OPERATION_ENABLED


def test_taken_out_of_operation_it_stops(bench: Workbench, script: Script) -> None:
    node = play(bench, script, *enabled(), STOP, sdo("40 00 10 00 00 00 00 00"))
    assert node.axis.stopping
    assert bench.reports == ["taken out of operation: quick stop"]
    assert answers(script)[-1].startswith("60 60 60")  # stopped, the SDO server is silent


def test_a_short_command_is_an_emergency_and_moves_nothing(bench: Workbench, script: Script) -> None:
    short = frame(0x205, b"\x0f\x00\xff\xff")
    node = play(bench, script, *enabled(), short, SYNC, short, SYNC, SYNC)
    assert answers(script, 0x085) == ["10 82 10 00 00 00 00 00"]
    assert node.axis.applied == 0.0


def test_it_survives_any_frames(bench: Workbench, script: Script, caplog: pytest.LogCaptureFixture) -> None:
    draw = random.Random(1)
    identifiers = (0x000, 0x080, 0x205, 0x305, 0x605, 0x605, 0x605, 0x77F, 0x7E5, 0x4000_0605)
    noise = [
        frame(draw.choice(identifiers), draw.randbytes(draw.choice((0, 1, 2, 4, 6, 8, 8, 8)))) for _ in range(3000)
    ]
    play(bench, script, *enabled(), *noise, RESET, sdo("40 00 10 00 00 00 00 00"))
    assert answers(script)[-1] == "43 00 10 00 92 01 02 00"
    assert not [record for record in caplog.records if record.levelname == "ERROR" and record.exc_info]


def test_a_reset_boots_again_with_the_defaults(bench: Workbench, script: Script) -> None:
    node = play(
        bench,
        script,
        write(0x605A, 0, 6, 2),
        *enabled(),
        *[rpdo(15, 90_000), SYNC] * 20,
        RESET,
        sdo("40 5a 60 00 00 00 00 00"),
    )
    assert answers(script, 0x705) == ["00", "00"]
    assert answers(script)[-1] == "4b 5a 60 00 02 00 00 00"
    assert (node.axis.state, node.axis.mode, node.axis.plant.position_counts) == (DriveState.SWITCH_ON_DISABLED, 0, 0)


def cycle(bus: End, time: Timeline, seconds: float, heartbeat: bool, command: bool) -> None:
    """Be a controller that keeps the axis moving to and fro."""
    for n in range(round(seconds / 0.002)):
        bus.send(SYNC)
        if command:
            bus.send(rpdo(15, 50_000 if n % 100 < 50 else -50_000))
        if heartbeat and n % 5 == 0:
            bus.send(frame(0x77F, b"\x05"))
        time.sleep(0.002)


@pytest.mark.parametrize(("clock", "dies"), [("wall", True), ("sync", True), ("wall", False)])
def test_without_heartbeat_it_stops_by_itself(bench: Workbench, clock: str, dies: bool) -> None:
    node, bus, time = bench.timed(clock)
    ramp = write(0x6085, 0, round(2.0 / STEP), 4)
    for step in (write(0x1016, 1, 0x7F_0000 | 60, 4), ramp, *enabled()):
        bus.send(step)
        time.sleep(0.001)
    cycle(bus, time, 0.13, heartbeat=True, command=True)
    assert node.axis.state is DriveState.OPERATION_ENABLED and bench.reports == []
    heard = time.now() - 0.01  # with the last but fourth of the cycles
    time.sleep(0.049) if dies else cycle(bus, time, 0.048, heartbeat=False, command=True)
    assert bench.reports == []  # not before its time
    time.sleep(0.004) if dies else cycle(bus, time, 0.004, heartbeat=False, command=True)  # commands go on
    (reports,) = bench.reports
    silence = int(reports.split()[6])
    assert reports == f"no heartbeat from the controller for {silence} ms (time-out 60 ms): quick stop"
    assert 60 <= silence <= 62
    assert time.now() - heard < 0.064
    time.sleep(0.5)
    assert node.axis.state is DriveState.SWITCH_ON_DISABLED
    assert bench.reports[1].startswith("stands after ")
    assert abs(int(bench.reports[1].split()[5])) * STEP < 0.05
    emergencies = [parse(raw) for raw in iter(lambda: bus.receive(0.0), None) if parse(raw)[0] == 0x085]
    assert emergencies[0][1].hex(" ") == "30 81 10 00 00 00 00 00"


def test_without_commands_it_stops_by_itself(bench: Workbench) -> None:
    node, bus, time = bench.timed("wall")
    for step in (write(0x1400, 5, 50, 2), *enabled()):
        bus.send(step)
        time.sleep(0.001)
    cycle(bus, time, 0.1, heartbeat=True, command=True)
    assert (node.axis.state, bench.reports) == (DriveState.OPERATION_ENABLED, [])
    cycle(bus, time, 0.046, heartbeat=True, command=False)
    assert bench.reports == []  # not before its time
    cycle(bus, time, 0.006, heartbeat=True, command=False)
    assert bench.reports[0].startswith("no cyclic command (RPDO) from the controller for 5")
    assert node.objects.error_code == 0x8250
    assert node.axis.state in (DriveState.QUICK_STOP_ACTIVE, DriveState.SWITCH_ON_DISABLED)


def wait_for(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    """Until `condition` holds."""
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < seconds, "it did not happen"
        time.sleep(0.001)


def test_the_stock_library_takes_it_for_a_drive(bench: Workbench) -> None:
    bench.running("sync")
    network = canopen.Network()
    network.connect(interface="stagectl", channel=bench.channel)
    try:
        drive = BaseNode402(5, bench.settings().eds)
        network.add_node(drive)
        assert drive.sdo[0x1008].raw == "stagectl virtual drive"
        drive.nmt.state = "PRE-OPERATIONAL"
        drive.setup_402_state_machine()
        drive.nmt.state = "OPERATIONAL"
        network.sync.start(0.01)
        drive.rpdo[1].start(0.01)
        drive.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
        drive.rpdo[1].update()
        for state in ("READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"):
            drive.state = state
            assert drive.state == state
        drive.rpdo[1][0x2071].raw = 500_000
        drive.rpdo[1].update()
        wait_for(lambda: drive.tpdo[1][0x6064].raw > 1000)
        assert drive.tpdo[1][0x6077].raw == 500
        drive.state = "SWITCH ON DISABLED"
    finally:
        network.sync.stop()
        drive.rpdo[1].stop()
        network.disconnect()


@pytest.mark.parametrize(("kind", "at_once"), [(0, False), (240, False), (254, True), (255, True)])
def test_commands_wait_for_sync_as_their_transmission_type_says(
    bench: Workbench, script: Script, kind: int, at_once: bool
) -> None:
    """CiA 301: 0 to 240 act with the next SYNC, 254 and 255 when they come."""
    node = play(bench, script, *remapped(), write(0x1400, 2, kind, 1), START, rpdo(6))
    assert (node.axis.state is DriveState.READY) == at_once


@pytest.mark.parametrize(
    "steps",
    [
        [write(0x1400, 1, 0x8000_0000 | 0x0001_0205, 4)],  # 29 bits
        [write(0x1800, 1, 0x8000_0000 | 0x0000_0985, 4)],  # 12 bits
    ],
)
def test_identifiers_have_eleven_bits(bench: Workbench, script: Script, steps: list[bytes]) -> None:
    play(bench, script, *steps)
    assert answers(script)[-1].endswith("30 00 09 06")


@pytest.mark.parametrize(("torque", "current", "limit"), [(400, 900, 4.0), (900, 300, 3.0), (0xFFFF, 0xFFFF, math.inf)])
def test_the_smaller_of_maximal_torque_and_current_holds(
    bench: Workbench, script: Script, torque: int, current: int, limit: float
) -> None:
    """0x6072 and 0x6073 in per mille of the rated 10 A; 8 A are asked for."""
    limits = [write(0x6072, 0, torque, 2), write(0x6073, 0, current, 2)]
    node = play(bench, script, *limits, *enabled(), rpdo(15, 800_000), SYNC)
    assert node.axis.options.current_limit == limit
    assert node.axis.applied == pytest.approx(min(8.0, limit))


def test_the_position_counter_wraps_around(bench: Workbench) -> None:
    """0x6064 is an INTEGER32: after 2^31 - 1 comes -2^31."""
    node = bench.node()
    for counts, shown in ((2**31 - 1, 2**31 - 1), (2**31, -(2**31)), (-(2**31) - 1, 2**31 - 1), (2**32 + 7, 7)):
        node.axis.plant.state = stage.at_rest(linear_stage(), counts * STEP)
        assert node.objects.number(0x6064) == shown


def test_errors_accumulate_in_the_error_register(bench: Workbench, script: Script) -> None:
    node = bench.node(script)
    short = frame(0x205, b"\x0f")
    script.steps += [*enabled(), lambda: node.trip(0x4310), short, *[SYNC] * 40, rpdo(0), SYNC, rpdo(0x80), SYNC]
    node.run(script.done)
    assert answers(script, 0x085) == [
        "10 43 01 00 00 00 00 00", "10 82 11 00 00 00 00 00", "00 00 00 00 00 00 00 00"]  # fmt: skip
    assert node.objects.error_register == 0
