"""Faults on demand: each can begin and be undone, and does to frames and signals what the table says."""

from __future__ import annotations

import random
import struct
from typing import Any

import pytest

from stagectl.drives import faults
from stagectl.drives.bus import faulty_bus
from stagectl.drives.bus.faulty_bus import FaultyBus, Rule
from stagectl.drives.bus.frames import frame, parse
from stagectl.drives.bus.virtual_time import Timeline
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.clock import SkewedClock
from stagectl.drives.virtual.fault_actions import ACTIONS
from stagectl.drives.virtual.node import VirtualNode
from tests.drives.test_node import START, answers, enabled, rpdo, sdo, tpdos
from tests.drives.workbench import SYNC, Script, Workbench

PUSH = [rpdo(15, 100_000), SYNC]


def moving(bench: Workbench, script: Script, name: str, cycles: int = 20, **parameters: Any) -> VirtualNode:
    """A drive that moves, then has the fault for so many cycles, still pushed."""
    node = bench.node(script)
    block = faults.default(name)._replace(**parameters)
    script.steps += [*enabled(), *PUSH * 20, lambda: node.faults.begin(block, node.now()), *PUSH * cycles]
    node.run(script.done)
    return node


def test_the_table_and_the_deeds_are_one() -> None:
    assert set(ACTIONS) == set(faults.BLOCKS)
    assert len(faults.TABLE) == len(faults.FAULT_TYPES) >= 25
    assert all(row.block._field_defaults.keys() >= {"after", "duration"} for row in faults.TABLE)


@pytest.mark.parametrize("name", sorted(faults.BLOCKS))
def test_each_fault_begins_and_is_undone(bench: Workbench, script: Script, name: str) -> None:
    node = moving(bench, script, name)
    assert node.faults.active == [name]
    node.faults.clear()
    assert node.faults.active == []
    assert (node._bus._rules, node.axis.sensor._distortions, node.axis._actuator._distortions) == ([], [], [])
    assert bench.reports[0] == f"fault begins: {name}" or name in ("drive-fault", "encoder-off")
    assert f"fault is over: {name}" in bench.reports
    script.steps += [sdo("40 00 10 00 00 00 00 00")]
    script.sent.clear()
    node.run(script.done)
    assert answers(script)[-1] == "43 00 10 00 92 01 02 00"


def test_a_stuck_encoder_stands_while_the_axis_moves(bench: Workbench, script: Script) -> None:
    node = moving(bench, script, "encoder-stuck")
    seen = [position for _, position, _ in tpdos(script)]
    assert len(set(seen[-20:])) == 1
    assert node.axis.plant.position_counts > seen[-1] + 1000


def test_a_jump_is_as_many_counts_as_asked_for(bench: Workbench, script: Script) -> None:
    node = moving(bench, script, "encoder-jump", counts=-12345)
    assert node.axis.sensor.counts == node.axis.plant.position_counts - 12345
    assert node.axis.sensor.velocity == node.axis.plant.state.velocity


def test_a_reversed_encoder_runs_the_wrong_way(bench: Workbench, script: Script) -> None:
    node = moving(bench, script, "encoder-reversed")
    seen = [position for _, position, _ in tpdos(script)][-19:]
    assert seen == sorted(seen, reverse=True)
    assert node.axis.plant.state.velocity > 0.0 > node.axis.sensor.velocity


@pytest.mark.parametrize(("name", "current"), [("current-off", 0.0), ("current-reversed", -1.0), ("current-weak", 0.3)])
def test_the_current_that_flows_is_reported(bench: Workbench, script: Script, name: str, current: float) -> None:
    node = moving(bench, script, name)
    assert node.axis.applied == pytest.approx(1.0)
    assert tpdos(script)[-1][2] == pytest.approx(100 * current)  # counts of 10 mA


def test_sto_takes_the_power_and_gives_none_back(bench: Workbench, script: Script) -> None:
    node = moving(bench, script, "drive-disabled")
    assert node.axis.state is DriveState.SWITCH_ON_DISABLED
    script.steps += [START, rpdo(6), SYNC, rpdo(7), SYNC, rpdo(15), SYNC, rpdo(15), SYNC]
    node.run(script.done)
    assert node.axis.state is DriveState.SWITCHED_ON
    node.faults.clear()
    script.steps += [START, rpdo(15), SYNC, SYNC]
    node.run(script.done)
    assert node.axis.state is DriveState.OPERATION_ENABLED


def test_a_drive_back_from_bus_off_says_so_and_one_without_supply_boots(bench: Workbench, script: Script) -> None:
    node = moving(bench, script, "bus-off")
    silent = len(tpdos(script))
    node.faults.clear()
    assert answers(script, 0x085)[-1] == "40 81 10 00 00 00 00 00"
    node.faults.begin(faults.default("power-off"), node.now())
    moved = node.axis.plant.state.position
    assert (node.axis.state, len(tpdos(script))) == (DriveState.SWITCH_ON_DISABLED, silent)
    node.faults.clear()
    assert answers(script, 0x705) == ["00", "00"]
    assert node.axis.plant.state.position == moved != 0.0  # the machine stays where it is


def test_a_short_answer_and_an_aborted_request(bench: Workbench, script: Script) -> None:
    node = moving(bench, script, "feedback-short", cycles=3)
    assert {raw[4] for raw in script.sent if parse(raw)[0] == 0x185} == {8, 7}
    node.faults.clear()
    node.faults.begin(faults.default("sdo-abort"), node.now())
    script.steps += [sdo("40 00 10 00 00 00 00 00")]
    node.run(script.done)
    assert answers(script)[-1] == "80 00 10 00 00 00 00 08"


def test_standing_faults_wait_for_operation_enabled_each_time(bench: Workbench, script: Script) -> None:
    node = bench.node(script)
    node.faults.standing([faults.OnOffFault("encoder-stuck", after=0.5, duration=0.25)])
    node.faults.look(100.0)
    assert node.faults.active == []
    node.axis.state = DriveState.OPERATION_ENABLED
    for now, active in ((200.0, []), (200.4, []), (200.6, ["encoder-stuck"]), (200.9, []), (300.0, [])):
        node.faults.look(now)
        assert node.faults.active == active, now
    node.faults.renew()
    node.faults.look(400.0)
    node.faults.look(400.5)
    assert node.faults.active == ["encoder-stuck"]


def numbered(count: int) -> list[bytes]:
    return [frame(0x185, struct.pack("<I", n)) for n in range(count)]


def through(act: faulty_bus.Act, frames: list[bytes]) -> list[int]:
    """Numbers of the frames that come out of a bus with this rule."""
    script = Script()
    bus = FaultyBus(script, lambda: 0.0, 1)
    bus.add(Rule("in", frozenset(), act))
    script.steps += frames
    received = iter(lambda: bus.receive(0.0), None)
    return [int.from_bytes(parse(raw)[1][:4], "little") for raw in received]


def test_what_rules_do_to_frames() -> None:
    chance = random.Random(3)
    frames = numbered(400)
    lost = through(faulty_bus.lose(0.25, chance), frames)
    assert lost == sorted(lost) and 0.65 * 400 < len(lost) < 0.85 * 400
    doubled = through(faulty_bus.double(0.5, chance), frames)
    assert doubled == sorted(doubled) and 1.4 * 400 < len(doubled) < 1.6 * 400 and len(set(doubled)) == 400
    swapped = through(faulty_bus.swap(0.2, chance), frames)
    assert sorted(swapped) == list(range(400)) and swapped != sorted(swapped)
    assert max(abs(n - k) for k, n in enumerate(swapped)) == 1
    bent = through(faulty_bus.flip(1.0, chance), frames)
    assert all(0 < (n ^ k).bit_count() <= 4 or n == k for k, n in enumerate(bent))
    assert sum(n != k for k, n in enumerate(bent)) > 350
    assert through(faulty_bus.freeze(), frames) == [0] * 400


def test_delayed_frames_come_when_they_are_due_and_kinds_are_told_apart() -> None:
    clock, script = Timeline(), Script()
    bus = FaultyBus(script, clock.now, 1)
    undo = bus.add(Rule("both", frozenset({"tpdo"}), faulty_bus.delay(0.5)))
    script.steps += [frame(0x185, b"a"), frame(0x705, b"b")]
    assert [bus.receive(0.0), bus.receive(0.0)] == [frame(0x705, b"b"), None]
    bus.send(frame(0x1FF, b"c"))
    assert script.sent == []
    clock.sleep(0.6)
    assert bus.receive(0.0) == frame(0x185, b"a")
    assert script.sent == [frame(0x1FF, b"c")]
    undo()
    bus.send(SYNC)
    assert script.sent[-1] == SYNC
    kinds = {0x000: "nmt", 0x080: "sync", 0x085: "emcy", 0x185: "tpdo", 0x205: "rpdo", 0x385: "tpdo", 0x505: "rpdo"}
    kinds |= {0x585: "sdo answer", 0x605: "sdo request", 0x77F: "heartbeat", 0x7E5: "other"}
    assert {identifier: faulty_bus.kind(identifier) for identifier in kinds} == kinds


def test_a_skewed_clock_never_jumps() -> None:
    true = Timeline()
    clock = SkewedClock(true)
    true.sleep(10.0)
    clock.run_at(1.5)
    assert clock.now() == 10.0
    true.sleep(2.0)
    assert clock.now() == 13.0
    clock.sleep(3.0)
    assert (true.now(), clock.now()) == (14.0, 16.0)
    clock.run_at(1.0)
    true.sleep(1.0)
    assert clock.now() == 17.0
