"""Random and mutated frames at both ends of the bus; raises AssertionError where the axis moves or one end hangs.

The virtual drive is fed whatever comes but one thing: no frame in which bits 0 to 3 of a controlword are all set, as
that is the command Enable operation.  Nothing else may ever give the axis power.  The controller, enabled on a drive in
virtual time, is fed between its cycles; its command must stay zero unless it is told that the drive is enabled.
"""

from __future__ import annotations

import random
import struct
import tempfile

from stagectl.drives.bus.frames import frame, parse
from stagectl.drives.bus.virtual_time import Timeline, Wire
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.drive import Fault, Power, Simulation
from stagectl.drives.simulated import Plant
from stagectl.drives.virtual.node import VirtualNode
from tests.drives.workbench import DT, GAIN, STEP, Script, canopen_settings, enabled, linear_stage, stopped

NODE_IDS = (0x000, 0x080, 0x205, 0x305, 0x405, 0x505, 0x605, 0x605, 0x77F, 0x7E5, 0x700, 0x6FF)
MASTER_IDS = (0x085, 0x185, 0x185, 0x285, 0x585, 0x705, 0x705, 0x000, 0x080, 0x7E4)
_FED = (0,) * 12 + (1, 5, 20, 60)  # frames between two cycles, one of these
_BACKLOG = 64  # frames that a cycle clears away
OPERATION = 0x0F  # bits of the controlword that together are Enable operation
SEEDS = [
    frame(0x000, bytes([1, 5])), frame(0x000, bytes([0x80, 5])), frame(0x000, bytes([0x81, 0])), frame(0x080),
    frame(0x205, struct.pack("<Hi", 6, 0)), frame(0x205, struct.pack("<Hi", 7, 900_000)),
    frame(0x605, bytes.fromhex("4000100000000000")), frame(0x605, bytes.fromhex("4008100000000000")),
    frame(0x605, bytes.fromhex("2f6060000a000000")), frame(0x605, bytes.fromhex("2b40600006000000")),
    frame(0x605, bytes.fromhex("2300140105020080")), frame(0x605, bytes.fromhex("2300160110004060")),
    frame(0x605, bytes.fromhex("2116100004000000")), frame(0x605, bytes.fromhex("8000000000000000")),
    frame(0x77F, b"\x05"),
]  # fmt: skip
ANSWERS = [
    frame(0x185, struct.pack("<Hih", 0x1637, 0, 0)), frame(0x185, struct.pack("<Hih", 0x0250, 0, 0)),
    frame(0x085, bytes.fromhex("1043010000000000")), frame(0x085, bytes(8)), frame(0x705, b"\x00"),
    frame(0x705, b"\x05"), frame(0x705, b"\x7f"), frame(0x585, bytes.fromhex("4300100092010200")),
    frame(0x585, bytes.fromhex("8000100000000206")),
]  # fmt: skip


def mutated(chance: random.Random, seeds: list[bytes], identifiers: tuple[int, ...]) -> bytes:
    """A frame of the standard, one with flipped bits, or noise; some with flags, wrong lengths or no meaning."""
    kind = chance.random()
    if kind < 0.2:
        return chance.choice(seeds)
    if kind < 0.6:
        raw = bytearray(chance.choice(seeds))
        for _ in range(chance.randint(1, 4)):
            raw[chance.choice((4, *range(8, 16)))] ^= 1 << chance.randrange(8)
        return bytes(raw)
    if kind < 0.9:
        return frame(chance.choice(identifiers), chance.randbytes(chance.choice((0, 1, 2, 4, 6, 8, 8, 8))))
    return struct.pack("<IB3x8s", chance.getrandbits(32), chance.randrange(256), chance.randbytes(8))


def enables(raw: bytes) -> bool:
    """Whether a frame may hold Enable operation: all four bits in any byte that can be a controlword's first."""
    identifier, _ = parse(raw)
    low = identifier & 0x7FF
    if 0x200 <= low < 0x580:  # any place: a mapping may have put the controlword there
        return any(byte & OPERATION == OPERATION for byte in raw[8:16])
    return low == 0x605 and raw[9:11] == b"\x40\x60" and raw[12] & OPERATION == OPERATION


def fuzz_node(frames: int, seed: int) -> str:
    """Feed the virtual drive; what it did, in words."""
    chance, script = random.Random(seed), Script()
    with tempfile.TemporaryDirectory() as folder:
        plant = Plant(linear_stage(), Simulation(substeps=1), DT)
        node = VirtualNode(canopen_settings(folder), plant, script, "sync", GAIN, lambda _: None)
        node.boot()
        for _ in range(frames):
            raw = mutated(chance, SEEDS, NODE_IDS)
            if enables(raw):
                continue
            script.steps.append(raw)
            node.turn()
            script.sent.clear()
            assert not node.axis.enabled, f"enabled by {raw.hex()}"
        script.steps.append(frame(0x000, bytes([0x81, 5])))
        node.turn()
        script.steps.append(SEEDS[6])
        node.turn()
    assert plant.position_counts == 0 and plant.state.velocity == 0.0
    answers = [parse(sent)[1].hex() for sent in script.sent if parse(sent)[0] == 0x585]
    assert answers == ["4300100092010200"]
    return "no exception, no power, no motion; it answers"


def fuzz_controller(frames: int, seed: int) -> str:
    """Feed the controller between its cycles; what it did, in words."""
    chance, timeline = random.Random(seed), Timeline()
    ours, theirs = Wire(timeline, 1e6).ends
    plant = Plant(linear_stage(), Simulation(substeps=1), DT)
    settings = canopen_settings("unused", feedback_timeout=0.002)
    node = VirtualNode(settings, plant, theirs, "wall", GAIN, lambda _: None, time=timeline)
    theirs.wakes = node.turn
    timeline.every(0.001, node.turn)
    node.boot()
    drive = CanopenDrive(Wishes(settings, STEP, DT), ours, clock=timeline)
    stops = cycles = fed = 0
    while fed < frames:
        for _ in range(chance.choice(_FED)):
            ours.take(mutated(chance, ANSWERS, MASTER_IDS))
            fed += 1
        began, cycles = timeline.now(), cycles + 1
        fault = drive.sample().fault
        assert timeline.now() - began < 0.01, "a cycle hangs"
        drive.apply(0.0)
        timeline.sleep(DT)
        stops += fault is not Fault.NONE
        if fault is not Fault.NONE:
            drive.ask(chance.choice((*Power, Power.ON, Power.ON)))  # whatever a daemon may answer to it
        if cycles % 1000 == 0 or (fault is Fault.REBOOTED and cycles % 20 == 0):
            stopped(drive, timeline)
            drive = CanopenDrive(Wishes(settings, STEP, DT), ours, clock=timeline)
        assert abs(plant.state.velocity) < 1e-6, "it moves"
        assert len(ours.inbox) < 2 * _BACKLOG, f"frames pile up after {fed}"
    drive = CanopenDrive(Wishes(settings, STEP, DT), ours, clock=timeline)
    enabled(drive, timeline)
    assert node.axis.state is cia402.DriveState.OPERATION_ENABLED
    drive.close()
    assert abs(plant.position_counts) <= 4
    return f"no exception, no motion; {stops} of {cycles} cycles with a fault, enabled at the end"
