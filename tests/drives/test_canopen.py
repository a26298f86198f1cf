"""Our master: against the virtual drive, against a node of the stock library, and frame by frame."""

from __future__ import annotations

import configparser
import itertools
import math
import re
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import canopen
import pytest

from stagectl.drives.bus.can_plugin import EmbeddedBus
from stagectl.drives.bus.frames import Bus, frame, parse
from stagectl.drives.canopen import configuration, power_states, protection
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.cia402 import state as state_of
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.canopen.fault_texts import FAULTS
from stagectl.drives.canopen.network import load_eds
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.canopen.pdo import CommandPdo, FeedbackPdo
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, Drive, DriveError, Fault, Feedback, Power
from stagectl.drives.limits import RESET_TIME
from stagectl.drives.virtual.node import VirtualNode
from stagectl.kernels import stage
from tests.drives import workbench
from tests.drives.workbench import DT, EDS, STEP, SYNC, Workbench, linear_stage


class Tapped:
    """A bus that a test can break and add frames to, with the clock that its drive goes by."""

    def __init__(self, bus: Bus, clock: Clock) -> None:
        self._bus, self.clock = bus, clock
        self.broken = False
        self.before: list[bytes] = []  # heard before anything else
        self.sent: list[bytes] = []

    def send(self, raw: bytes) -> None:
        if self.broken:
            raise OSError(100, "Network is down")
        self.sent.append(raw)
        self._bus.send(raw)

    def receive(self, timeout: float) -> bytes | None:
        return self.before.pop(0) if self.before else self._bus.receive(timeout)

    def close(self) -> None:
        self._bus.close()


@pytest.fixture
def bus(bench: Workbench) -> Tapped:
    """Our end of the bus of `bench.booted`, in virtual time: no computer is too busy for it."""
    return Tapped(bench.ours, bench.time)


def drive_on(bench: Workbench, bus: Tapped, **changes: Any) -> CanopenDrive:
    drive = CanopenDrive(Wishes(bench.settings(**changes), STEP, DT), bus, clock=bus.clock)
    protocol: Drive = drive  # the protocol holds, says mypy
    assert protocol is drive
    return drive


def enabled(drive: CanopenDrive) -> Feedback:
    return workbench.enabled(drive, drive._clock)


def stopped(drive: CanopenDrive, patience: float = 10.0) -> Feedback:
    return workbench.stopped(drive, drive._clock, patience)


def test_a_stage_moves_over_the_bus_with_a_delay_of_one_period(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    drive = drive_on(bench, bus)
    assert enabled(drive).position == 0.0
    p = linear_stage()
    p = p._replace(drive=p.drive._replace(delay_samples=1, current_quantum=1e-5))
    x = stage.at_rest(p)
    for k in range(300):
        now = drive.sample()
        assert now.fault is Fault.NONE
        assert now.position == stage.measured(p.encoder, x, stage.SILENT), k
        assert now.current == pytest.approx(x.current, abs=0.005)
        current = 0.7 * math.sin(0.05 * k) + 1.23e-6
        drive.apply(current)
        x = stage.period(p, x, current, stage.SILENT, DT, 4)
    assert abs(x.position) > 1e-3
    stands = stopped(drive)
    assert state_of(stands.statusword) is DriveState.SWITCH_ON_DISABLED
    assert "no fault" in drive.explain()  # it was asked for
    assert bench.reports[-1].startswith("stands after")
    drive.close()
    drive.close()


def test_no_thread_is_started(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    before = threading.active_count()
    drive = drive_on(bench, bus)
    enabled(drive)
    assert threading.active_count() == before
    drive.close()


def test_it_configures_and_describes_the_drive(bench: Workbench, bus: Tapped) -> None:
    node = bench.booted("sync")
    description = drive_on(bench, bus).describe()
    assert description["device type"] == "0x00020192: CiA 402, servo drive"
    assert description["device name"] == "stagectl virtual drive"
    assert description["rated current (0x6075)"] == "10 A"
    assert description["heartbeat time-out in the drive (0x1016)"] == "10000 ms"
    assert description["RPDO time-out (0x1400:05)"] == "10000 ms"
    assert description["quick stop option (0x605A)"].startswith("slow down on the quick stop ramp")
    assert description["abort connection option (0x6007)"] == "quick stop"
    assert node.objects.number(0x6085) == round(2.0 / STEP)
    assert node.objects.number(0x1016, 1) == 127 << 16 | 10000
    assert [node.objects.number(0x1600, n) for n in range(3)] == [2, 0x60400010, 0x20710020]


def test_heartbeats_go_by_time_however_late_the_cycles(bench: Workbench, bus: Tapped) -> None:
    """Counted in cycles, a loop ten times too slow would be taken for a dead one."""
    bench.booted("sync")
    drive = drive_on(bench, bus)
    enabled(drive)
    begun = bench.time.now()
    bus.sent.clear()
    for _ in range(100):
        bench.time.sleep(10.0 * DT)
        drive.sample()
        drive.apply(0.0)
    assert 49 <= bus.sent.count(frame(0x77F, b"\x05")) <= (bench.time.now() - begun) / 0.02 + 1.0  # each 20 ms
    assert bus.sent.count(SYNC) == 100


@pytest.mark.parametrize("code", [0x2310, 0x7305])
def test_a_fault_is_reset_by_a_person_alone(bench: Workbench, bus: Tapped, code: int) -> None:
    node = bench.booted("sync")
    drive = drive_on(bench, bus)
    enabled(drive)
    node.trip(code)
    faults = []
    for _ in range(40):
        faults.append(drive.sample().fault)
        drive.apply(0.5)
    assert Fault.EMERGENCY in faults
    assert f"emergency 0x{code:04X}" in drive.explain()
    assert "stagectl fault reset" in drive.explain()
    with pytest.raises(DriveError, match="--reset-fault"):  # nobody but a person resets it
        enabled(drive)
    assert node.axis.state is DriveState.FAULT
    drive.reset_fault()
    assert node.axis.state is DriveState.SWITCH_ON_DISABLED
    assert enabled(drive).fault is Fault.NONE
    assert enabled(drive).fault is Fault.NONE  # enabled already: goes on
    drive.apply(0.0)
    assert drive.sample().fault is Fault.NONE
    assert drive.explain().startswith("node 5: no fault")


def test_it_enables_from_quick_stop_active(bench: Workbench, bus: Tapped) -> None:
    node = bench.booted("sync")
    drive = drive_on(bench, bus)
    node.objects.node.set_data(0x605A, 0, b"\x06\x00")
    node.axis.options = node.objects.options()
    enabled(drive)
    assert state_of(stopped(drive).statusword) is DriveState.QUICK_STOP_ACTIVE
    assert enabled(drive).fault is Fault.NONE


def test_a_vanished_drive_is_feedback_lost(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    drive = drive_on(bench, bus, feedback_timeout=0.05, heartbeat=5.0)  # none between its last answer and its end
    enabled(drive)
    last = drive.sample()
    bench.stop()
    began = bench.time.now()
    lost = drive.sample()
    assert bench.time.now() - began == pytest.approx(0.05)
    assert (lost.fault, lost.position) == (Fault.FEEDBACK_LOST, last.position)
    assert "no answer to SYNC" in drive.explain()
    assert "cable" in drive.explain()
    stopped(drive, patience=0.2)
    assert "no answer to SYNC" in drive.explain()
    drive.close()


def test_a_late_answer_is_not_taken_for_the_next(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    drive = drive_on(bench, bus, feedback_timeout=0.05)
    enabled(drive)
    receive, bus.receive = bus.receive, bench.time.sleep  # type: ignore[method-assign,assignment]
    assert drive.sample().fault is Fault.FEEDBACK_LOST
    bus.receive = receive  # type: ignore[method-assign]
    for _ in range(3):
        assert drive.sample().fault is Fault.NONE
        left = list(iter(lambda: bus.receive(0.005), None))
        assert not [raw for raw in left if parse(raw)[0] == 0x185]  # one answer for each SYNC


def test_a_broken_bus_raises_nowhere(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    drive = drive_on(bench, bus)
    enabled(drive)
    bus.broken = True
    drive.apply(1.0)
    assert drive.sample().fault is Fault.BUS
    assert "Network is down" in drive.explain()
    assert stopped(drive).fault is Fault.BUS
    drive.close()


def test_a_drive_that_leaves_operation_is_a_drive_fault(bench: Workbench, bus: Tapped) -> None:
    node = bench.booted("sync")
    drive = drive_on(bench, bus)
    enabled(drive)
    node.axis.quick_stop()
    assert drive.sample().fault is Fault.DRIVE_FAULT
    stopped(drive)  # does not hide what came first
    assert "Quick stop active (statusword 0x0217)" in drive.explain()


def test_other_frames_are_taken_up_on_the_way(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    drive = drive_on(bench, bus)
    enabled(drive)
    bus.before += [frame(0x705, b"\x05"), frame(0x123, b"x"), frame(0x085, bytes.fromhex("1043010102030405"))]
    assert drive.sample().fault is Fault.EMERGENCY
    assert "0x4310 (temperature of the drive), error register 0x01, vendor's bytes 01 02 03 04 05" in drive.explain()
    assert "last heartbeat" in drive.explain()
    bus.before.append(frame(0x085, bytes(8)))  # error reset
    assert drive.sample().fault is Fault.NONE
    bus.before.append(frame(0x185, b"\x37\x12"))  # a TPDO of another mapping
    assert drive.sample().fault is Fault.DRIVE_FAULT
    assert "its TPDO has 2 bytes, must have 8" in drive.explain()


def test_a_command_that_is_no_number_becomes_zero_and_a_fault(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    drive = drive_on(bench, bus)
    enabled(drive)
    drive.sample()
    drive.apply(math.nan)
    sent = [data for identifier, data, *_ in map(parse, bus.sent) if identifier == 0x205]
    assert sent[-1] == struct.pack("<Hi", 0x0F, 0)
    assert drive.sample().fault is Fault.DRIVE_FAULT
    assert "not a number; zero was sent instead" in drive.explain()


def test_a_drive_that_hangs_is_explained(bench: Workbench, bus: Tapped, monkeypatch: pytest.MonkeyPatch) -> None:
    node = bench.booted("sync")
    monkeypatch.setattr(workbench, "ENABLE_TIME", 0.2)
    drive = drive_on(bench, bus)
    node.axis.control = lambda controlword: None  # type: ignore[method-assign]
    with pytest.raises(DriveError) as caught:
        enabled(drive)
    assert "statusword 0x0250" in str(caught.value) and "STO open" in str(caught.value)


class Doubled(Tapped):
    """A bus on which late answers about the first object come before the answer about the second."""

    def __init__(self, bench: Workbench, late: list[bytes]) -> None:
        super().__init__(bench.ours, bench.time)
        self.late, self.asked = late, list[bytes]()

    def send(self, raw: bytes) -> None:
        cob_id, request = parse(raw)[:2]
        if cob_id == 0x605 and request[1:4] not in self.asked:  # a repeated request asks about the same object
            self.asked.append(request[1:4])
            self.before += self.late * (len(self.asked) == 2)
        super().send(raw)


class Flash(Tapped):
    """A bus whose drive takes 0.6 s to write down its quick stop ramp."""

    held: tuple[float, bytes] | None = None

    def receive(self, timeout: float) -> bytes | None:
        end = self.clock.now() + timeout
        while True:
            if self.held is not None and self.clock.now() >= self.held[0]:
                raw, self.held = self.held[1], None
                return raw
            result = super().receive(max(min(end - self.clock.now(), 0.01), 0.0))
            if result is not None and parse(result)[0] == 0x585 and parse(result)[1][:3] == bytes([0x60, 0x85, 0x60]):
                self.held = (self.clock.now() + 0.6, result)
            elif result is not None or self.clock.now() >= end:
                return result


def test_a_drive_that_writes_its_flash_is_waited_for(bench: Workbench) -> None:
    bench.booted("sync")
    description = drive_on(bench, Flash(bench.ours, bench.time)).describe()
    assert description["quick stop ramp (0x6085)"] == "200000000 counts/s^2"


def test_a_late_answer_to_a_request_that_was_given_up_is_none_to_the_next(bench: Workbench, bus: Tapped) -> None:
    """A drive that boots slowly answers the first request and its repetition, one after the other."""
    bench.booted("sync")
    late = [frame(0x585, bytes.fromhex(text)) for text in ("4300100000000000", "8000100000000405")]  # value, and abort
    description = drive_on(bench, Doubled(bench, late)).describe()
    assert re.fullmatch("0x[0-9A-F]{8}", description["vendor"])
    assert description["device type"] == "0x00020192: CiA 402, servo drive"


def test_nobody_answers(bench: Workbench, bus: Tapped) -> None:
    with pytest.raises(DriveError, match="stagectl drive probe") as caught:
        drive_on(bench, bus, boot_time=0.1)
    assert caught.value.node == 5


def test_the_drives_rated_current_is_believed(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync", rpdo=(0x604000, 0x607100), command_object=0x607100, command_scale=0.01)
    with pytest.raises(DriveError, match="0x6075") as caught:
        drive_on(bench, bus, command_object=0x607100, rpdo=(0x604000, 0x607100), rated_current=8.0)
    error = caught.value
    assert (error.place, error.node, error.object_key, error.value) == ("rated_current", 5, 0x607500, 10.0)


def eds_without(folder: Path, *sections: str) -> str:
    eds = configparser.RawConfigParser()
    eds.optionxform = str  # type: ignore[assignment,method-assign]
    eds.read(EDS)
    for name in [s for s in eds.sections() if s.split("sub")[0] in sections or s in sections]:
        eds.remove_section(name)
    path = folder / "less.eds"
    with path.open("w") as file:
        eds.write(file)
    return str(path)


def test_objects_that_drives_may_lack_are_described_as_such(bench: Workbench, bus: Tapped, tmp_path: Path) -> None:
    eds = eds_without(tmp_path, "605B", "6008", "1009", "6502")
    bench.booted("sync")
    drive = drive_on(bench, bus, eds=eds)
    assert drive.describe()["shutdown option (0x605B)"] == "not offered by this drive"
    assert drive.describe()["hardware version"] == "not offered by this drive"
    assert enabled(drive).fault is Fault.NONE


def test_objects_it_must_have_are_an_error(bench: Workbench, bus: Tapped, tmp_path: Path) -> None:
    bench.booted("sync")
    with pytest.raises(DriveError, match="0x6061:00") as caught:
        drive_on(bench, bus, eds=eds_without(tmp_path, "6061"))
    assert (caught.value.node, caught.value.object_key, caught.value.abort_code) == (5, 0x606100, 0x0602_0000)
    with pytest.raises(DriveError, match="eds") as caught:
        drive_on(bench, bus, eds=str(tmp_path / "nowhere.eds"))
    assert caught.value.place == str(tmp_path / "nowhere.eds")
    with pytest.raises(DriveError, match="1000000000000000") as caught:
        drive_on(bench, bus, quick_stop_deceleration=1e7)
    assert (caught.value.place, caught.value.value) == ("quick_stop_deceleration", 1e7)


@pytest.mark.parametrize(
    ("changes", "place", "object_key", "value"),
    [
        ({"rpdo": (0x604000,)}, "rpdo", 0x207100, None),
        ({"tpdo": (0x604100, 0x607700)}, "tpdo", 0x606400, None),
        ({"tpdo": (0x604100, 0x606400, 0x207700)}, "tpdo", None, 10),  # bytes, two too many
        ({"rpdo": (0x604000, 0x555500)}, "rpdo", 0x555500, None),
        ({"rpdo": (0x604000, 0x607500)}, "rpdo", 0x607500, None),
        ({"rpdo": (0x604000, 0x100800)}, "rpdo", 0x100800, 0x9),  # data type: a string
    ],
)
def test_a_mapping_that_cannot_work_is_refused(
    bench: Workbench, bus: Tapped, changes: dict[str, Any], place: str, object_key: int | None, value: int | None
) -> None:
    with pytest.raises(DriveError) as caught:
        drive_on(bench, bus, **changes)
    assert (caught.value.place, caught.value.object_key, caught.value.value) == (place, object_key, value)


def pdos(settings: Canopen) -> tuple[CommandPdo, FeedbackPdo]:
    od = load_eds(settings.eds, settings.node)
    return CommandPdo(settings, od), FeedbackPdo(settings, od)


@pytest.mark.parametrize(
    ("current", "counts"),
    [(0.0, 0), (0.0149, 1), (0.015, 2), (-0.015, -1), (1e9, 32767), (-1e9, -32768), (math.inf, 32767)],
)
def test_commands_are_rounded_and_saturated(bench: Workbench, current: float, counts: int) -> None:
    changes = {"rpdo": (0x606000, 0x607100, 0x604000), "command_object": 0x607100, "command_scale": 0.01}
    command, _ = pdos(bench.settings(**changes))
    assert command.encode(0x0F, current) == frame(0x205, struct.pack("<bhH", 10, counts, 0x0F))


def test_the_position_counter_wraps_around(bench: Workbench) -> None:
    _, feedback = pdos(bench.settings(tpdo=(0x606400, 0x604100), current_object=0))
    way = [2**31 - 10, 2**31 + 10, 2**32 + 5, 2**32 - 7, 2**31 + 100, 2**31 - 10, 5, -5, -(2**31) - 1]
    seen = [feedback.decode(frame(0x185, struct.pack("<IH", count % 2**32, 0x1237))) for count in way]
    assert [counts for _, counts, _ in seen] == way
    assert seen[0][0] == 0x1237
    assert math.isnan(seen[0][2])


class Echo:
    """A drive that answers each SYNC in no time."""

    def __init__(self, drive: CanopenDrive) -> None:
        drive._bus = drive._line._bus = self
        self._answer = frame(0x185, struct.pack("<Hih", 0x1237, 123456, 100))

    def send(self, raw: bytes) -> None:
        """Costs nothing, as what is measured is our own share."""

    def receive(self, timeout: float) -> bytes | None:
        return self._answer if timeout else None  # nothing was left over

    def close(self) -> None:
        """Nothing is open."""


def test_one_cycle_costs_a_few_microseconds(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    drive = drive_on(bench, bus)
    Echo(drive)
    took = []
    for k in range(5000):
        began = time.perf_counter_ns()
        drive.sample()
        drive.apply(0.001 * k)
        took.append(time.perf_counter_ns() - began)
    assert 0.5e3 < sorted(took)[len(took) // 2] < 10e3


CONTROLLER = """
import sys, time
sys.path[:0] = {path!r}
from tests.drives.workbench import canopen_settings, enabled, STEP, DT
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.canopen.object_rules import Wishes
s = canopen_settings({channel!r}, heartbeat_timeout=0.5, rpdo_timeout=0.0)
drive = CanopenDrive(Wishes(s, STEP, DT), open_bus("embedded", {channel!r}, 1e6))
enabled(drive)
print("enabled", flush=True)
while True:
    drive.sample(); drive.apply(0.3); time.sleep(DT)
"""


def test_a_killed_controller_leaves_a_drive_that_stops(bench: Workbench) -> None:
    node = bench.running("wall")
    program = CONTROLLER.format(path=sys.path, channel=bench.channel)
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as controller:
        assert controller.stdout is not None
        assert controller.stdout.readline() == "enabled\n"
        while node.axis.plant.state.velocity < 0.01:
            assert bench.reports == []
            time.sleep(0.001)
        controller.kill()
    died = time.monotonic()
    while len(bench.reports) < 2:
        assert time.monotonic() - died < 60.0, bench.reports  # how soon it must be: see test_node, in virtual time
        time.sleep(0.001)
    silence = re.match(r"no heartbeat from the controller for (\d+) ms \(time-out 500 ms\)", bench.reports[0])
    assert silence is not None and int(silence[1]) >= 500, bench.reports
    assert bench.reports[1].startswith("stands after")
    assert node.axis.state is DriveState.SWITCH_ON_DISABLED


class StockDrive:
    """A drive made with the stock library: its node, its threads, and a state machine in callbacks."""

    def __init__(self, channel: str) -> None:
        self.network = canopen.Network(EmbeddedBus(channel=channel))
        self.network.connect()
        self.node = self.network.create_node(5, str(EDS))
        self.node.add_write_callback(self._written)
        self.state = DriveState.SWITCH_ON_DISABLED
        self.position = 0
        self.target = 0
        self._received = (0, 0)
        self.network.subscribe(0x205, self._rpdo)
        self.network.subscribe(0x080, self._sync)
        self.node.nmt.state = "PRE-OPERATIONAL"

    def _written(self, *, index: int, subindex: int, od: Any, data: bytes) -> None:
        if index == 0x6060:
            self.node.data_store.setdefault(0x6061, {})[0] = bytes(data)

    def _rpdo(self, identifier: int, data: bytearray, timestamp: float) -> None:
        self._received = struct.unpack("<Hi", data)

    def _sync(self, identifier: int, data: bytearray, timestamp: float) -> None:
        if self.node.nmt.state != "OPERATIONAL":
            return
        fields = 0x0200 | self.state.value[1], self.position, 42
        self.network.send_message(0x185, struct.pack("<Hih", *fields))
        controlword, self.target = self._received
        way = {
            6: DriveState.READY,
            7: DriveState.SWITCHED_ON,
            15: DriveState.OPERATION_ENABLED,
            2: DriveState.QUICK_STOP_ACTIVE,
        }
        self.state = way.get(controlword, DriveState.SWITCH_ON_DISABLED)
        self.position += self.target


@pytest.fixture
def stock(bench: Workbench) -> Iterator[StockDrive]:
    drive = StockDrive(bench.channel)
    yield drive
    drive.node.nmt.stop_heartbeat()
    drive.network.disconnect()


def test_it_drives_a_node_of_the_stock_library(bench: Workbench, stock: StockDrive) -> None:
    drive = drive_on(bench, Tapped(bench.bus(), WALL))
    assert drive.describe()["device name"] == "stagectl virtual drive"
    assert stock.node.get_data(0x1A00, 2) == struct.pack("<I", 0x6064_0020)
    enabled(drive)
    assert drive.sample().position == 0.0
    drive.apply(3e-5)
    positions = []
    for _ in range(4):
        now = drive.sample()
        assert (now.fault, now.current) == (Fault.NONE, 0.42)
        positions.append(round(now.position / STEP))
        drive.apply(3e-5)
    assert positions == [0, 3, 6, 9]
    assert state_of(stopped(drive).statusword) is DriveState.QUICK_STOP_ACTIVE
    drive.close()
    end = time.monotonic() + 10.0
    while stock.node.nmt.state != "PRE-OPERATIONAL" and time.monotonic() < end:
        time.sleep(0.01)
    assert stock.node.nmt.state == "PRE-OPERATIONAL"
    assert stock.state is DriveState.SWITCH_ON_DISABLED


def test_every_emergency_but_class_zero_is_one(bench: Workbench, bus: Tapped) -> None:
    """Codes 00xx say that there is no error, whatever xx; 1000 and 2300 are errors in spite of their zeros."""
    bench.booted("sync")
    drive = drive_on(bench, bus)
    enabled(drive)
    for code, fault in ((0x1000, Fault.EMERGENCY), (0x0001, Fault.NONE), (0x2300, Fault.EMERGENCY)):
        bus.before.append(frame(0x085, struct.pack("<HB5x", code, 1)))
        assert drive.sample().fault is fault, hex(code)


def test_chatter_does_not_extend_the_time_out(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    drive = drive_on(bench, bus, feedback_timeout=0.05)
    enabled(drive)
    began = bench.time.now()

    def chatter(timeout: float) -> bytes:
        assert bench.time.now() - began < 1.0, "it waits for ever"
        bench.time.sleep(min(timeout, 0.01))
        return frame(0x123, b"x")

    bus.receive = chatter  # type: ignore[method-assign]
    assert drive.sample().fault is Fault.FEEDBACK_LOST
    assert bench.time.now() - began == pytest.approx(0.05)


def test_what_was_lost_has_no_current(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    drive = drive_on(bench, bus, feedback_timeout=0.02)
    enabled(drive)
    bench.stop()
    assert math.isnan(drive.sample().current)


def test_the_first_fault_is_the_one_that_is_explained(bench: Workbench, bus: Tapped) -> None:
    node = bench.booted("sync")
    drive = drive_on(bench, bus)
    enabled(drive)
    node.axis.quick_stop()
    assert drive.sample().fault is Fault.DRIVE_FAULT
    bus.broken = True
    assert drive.sample().fault is Fault.BUS
    assert FAULTS[Fault.DRIVE_FAULT].words in drive.explain()


def test_an_emergency_of_before_does_not_keep_it_from_running(
    bench: Workbench, bus: Tapped, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.booted("sync")
    monkeypatch.setattr(workbench, "ENABLE_TIME", 1.0)
    drive = drive_on(bench, bus)
    bus.before.append(frame(0x085, struct.pack("<HB5x", 0x8130, 0x10)))  # and no reset of it follows
    assert enabled(drive).fault is Fault.NONE


def test_a_quick_stop_goes_on_until_the_drive_obeys(bench: Workbench, bus: Tapped) -> None:
    """Standing is not enough: a drive that still says Operation enabled could move again."""
    node = bench.booted("sync")
    drive = drive_on(bench, bus)
    enabled(drive)
    control, deaf = node.axis.control, 200
    seen: list[int] = []

    def late(controlword: int) -> None:
        seen.append(controlword)
        if len(seen) > deaf:
            control(controlword)

    node.axis.control = late  # type: ignore[method-assign]
    state = state_of(stopped(drive).statusword)
    assert state in (DriveState.QUICK_STOP_ACTIVE, DriveState.SWITCH_ON_DISABLED)
    assert set(seen[1:]) == {2}  # the first may be the last command of enabling
    assert deaf < len(seen) < deaf + 100


def test_a_quick_stop_is_sent_on_to_a_drive_that_is_not_heard(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    drive = drive_on(bench, bus, feedback_timeout=0.02)
    enabled(drive)
    bench.stop()
    bus.sent.clear()
    stopped(drive, patience=0.5)
    stops = [raw for raw in bus.sent if parse(raw)[0] == 0x205]
    assert {parse(raw)[1] for raw in stops} == {struct.pack("<Hi", 2, 0)}
    assert len(stops) > 10


def test_it_leaves_quick_stop_active_only_when_the_axis_stands(bench: Workbench, bus: Tapped) -> None:
    node = bench.booted("sync")
    drive = drive_on(bench, bus)
    node.objects.node.set_data(0x605A, 0, b"\x06\x00")
    node.axis.options = node.objects.options()
    enabled(drive)
    for _ in range(60):
        drive.apply(-1.0)
        drive.sample()
    assert node.axis.plant.state.velocity < -0.2
    control, left = node.axis.control, []

    def watched(controlword: int) -> None:
        if node.axis.state is DriveState.QUICK_STOP_ACTIVE and controlword == 0:
            left.append(node.axis.plant.state.velocity)
        control(controlword)

    node.axis.control = watched  # type: ignore[method-assign]
    node.axis.quick_stop()
    assert enabled(drive).fault is Fault.NONE
    assert abs(left[0]) < 1e-3


def test_standing_still_is_the_same_in_both_directions_and_begins_anew() -> None:
    for step in (2.5, -2.5):
        still = power_states.Standstill(1.0)
        assert not any(still.stands(step * k) for k in range(300))
    still = power_states.Standstill(1.0)
    assert [still.stands(0.9 * (-1) ** k if k else 0.0) for k in range(99)] == [False] * 99
    assert not still.stands(5.0)
    assert [still.stands(5.0) for _ in range(100)] == [False] * 99 + [True]
    assert not still.stands(math.nan)


def test_a_fault_is_reset_by_few_edges_that_are_held_with_a_pause_between_them() -> None:
    """Drives were met that want bit 7 for 50 ms."""
    words = [power_states.fault_reset(0.01 * k) for k in range(round(100 * RESET_TIME))]
    runs = [(word, len(list(run))) for word, run in itertools.groupby(words)]
    assert runs == [(0x80, 30), (0x00, 10)] * 3
    assert power_states._towards_enabled(DriveState.FAULT, False) == 0x00  # not on the way to power


def with_value(node: VirtualNode, index: int, subindex: int, value: int, size: int) -> None:
    """Another default than that of the EDS."""
    node.objects.node.set_data(index, subindex, value.to_bytes(size, "little"))


@pytest.mark.parametrize("kind", [0x0002_0191, 0x0002_0198, 0x0000_0000])
def test_another_profile_is_refused(bench: Workbench, bus: Tapped, kind: int) -> None:
    with_value(bench.booted("sync"), 0x1000, 0, kind, 4)
    with pytest.raises(DriveError, match="402") as caught:
        drive_on(bench, bus)
    assert (caught.value.node, caught.value.object_key, caught.value.value) == (5, 0x100000, kind)


def test_a_drive_without_torque_mode_is_refused(bench: Workbench, bus: Tapped) -> None:
    with_value(bench.booted("sync"), 0x6502, 0, 0x0000_01FF, 4)  # every mode but bit 9
    with pytest.raises(DriveError, match="0x6502") as caught:
        drive_on(bench, bus)
    assert (caught.value.object_key, caught.value.value) == (0x650200, 0x1FF)


def test_a_drive_that_keeps_its_mode_is_refused(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync").objects.getters[0x606000] = lambda: 8
    with pytest.raises(DriveError, match="0x6060") as caught:
        drive_on(bench, bus)
    assert (caught.value.object_key, caught.value.value) == (0x606000, 8)


def test_a_drive_may_show_its_mode_once_it_is_enabled(
    bench: Workbench, bus: Tapped, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The set-up says so; from Operation enabled on the mode is watched."""
    monkeypatch.setattr(configuration, "MODE_TIME", 0.05)
    bench.booted("sync").objects.getters[0x606100] = lambda: 8
    assert "0x6061 shows 8" in drive_on(bench, bus).describe()["mode of operation"]


def test_the_rated_current_only_matters_where_commands_count_in_it(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync")
    assert drive_on(bench, bus, rated_current=8.0).describe()["rated current (0x6075)"] == "10 A"


def test_other_pdos_are_switched_off_and_bits_that_are_the_drives_stay(bench: Workbench, bus: Tapped) -> None:
    node = bench.booted("sync")
    for n, base in ((1, 0x280), (2, 0x380), (3, 0x480)):
        with_value(node, 0x1800 + n, 1, base + 5, 4)
        with_value(node, 0x1400 + n, 1, base + 0x85, 4)
    with_value(node, 0x1800, 1, 0x4000_0185, 4)  # no remote requests
    with_value(node, 0x1005, 0, 0x81, 4)
    drive_on(bench, bus)
    for parameter in (0x1400, 0x1800):
        assert [node.objects.number(parameter + n, 1) >> 31 for n in range(4)] == [0, 1, 1, 1]
    assert node.objects.number(0x1800, 1) == 0x4000_0185
    assert node.objects.number(0x1005) == 0x80


def test_a_short_time_out_is_not_rounded_to_none() -> None:
    """0 would switch the supervision off."""
    times = [0.0, 1e-4, 4e-4, 1.4e-3, 0.0996, 1.0]
    assert [protection.milliseconds(seconds) for seconds in times] == [0, 1, 1, 1, 100, 1000]


def test_power_is_asked_for_while_the_cycle_goes_on(bench: Workbench, bus: Tapped) -> None:
    """On, stopped, on again, off: one period after the other, nobody waits."""
    bench.booted("sync")
    drive = drive_on(bench, bus)
    for power, done in (
        (Power.ON, DriveState.OPERATION_ENABLED),
        (Power.QUICK_STOP, DriveState.SWITCH_ON_DISABLED),
        (Power.ON, DriveState.OPERATION_ENABLED),
        (Power.OFF, DriveState.SWITCH_ON_DISABLED),
    ):
        drive.ask(power)
        for _ in range(200):
            now = drive.sample()
            drive.apply(0.0)
            if state_of(now.statusword) is done:
                break
        assert state_of(now.statusword) is done
        assert now.fault is (Fault.NONE if power is Power.ON else Fault.DRIVE_FAULT)


def test_after_a_fault_nothing_enables_it_again_by_itself(bench: Workbench, bus: Tapped) -> None:
    node = bench.booted("sync")
    drive = drive_on(bench, bus)
    enabled(drive)
    node.trip(0x2310)
    for _ in range(300):
        now = drive.sample()
        drive.apply(0.0)
        assert now.fault is not Fault.NONE or not node.axis.stopping
    assert state_of(now.statusword) is DriveState.FAULT
    assert not node.axis.enabled


def test_a_drive_that_boots_in_mid_operation_is_told(bench: Workbench, bus: Tapped) -> None:
    bench.booted("sync", feedback_timeout=0.1)
    drive = drive_on(bench, bus, feedback_timeout=0.1)
    enabled(drive)
    reset = frame(0, b"\x81\x05")  # NMT: reset node, by another controller: we hear it, too
    bench.ours.send(reset)
    bus.before.append(reset)
    faults = []
    for _ in range(5):
        faults.append(drive.sample().fault)
        drive.apply(0.0)
    assert Fault.REBOOTED in faults
    assert drive.explain().startswith("node 5: the drive booted in mid operation")


@pytest.mark.parametrize(("code", "fault"), [(0x8130, Fault.NONE), (0x8250, Fault.NONE), (0x2310, Fault.EMERGENCY)])
def test_without_power_a_missed_controller_is_no_fault(bench: Workbench, bus: Tapped, code: int, fault: Fault) -> None:
    """Another drive's set-up may keep us away; the drive says that it missed us, and nothing has happened."""
    bench.booted("sync")
    drive = drive_on(bench, bus)
    drive.sample()
    bus.before.append(frame(0x085, struct.pack("<HB5x", code, 0x11)))
    seen = drive.sample().fault
    assert seen is (fault or Fault.DRIVE_FAULT)  # that it has no power is no fault of the axis
    assert (f"0x{code:04X}" in drive.explain()) and ("no fault" in drive.explain()) == (fault is Fault.NONE)
