"""The set-up against drives that lack, refuse, forget or boot: each ends set up and read back, or refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest

from stagectl.drives.brake import NO_BRAKE, Brake
from stagectl.drives.bus.frames import frame, parse
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.canopen.library import SdoAbortedError
from stagectl.drives.canopen.network import load_eds
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.canopen.pdo import CommandPdo, PdoMap
from stagectl.drives.drive import ACCEPTED, DriveError, Fault, Identity, StartUp
from stagectl.drives.limits import SETUPS
from stagectl.drives.run_on import AxisLimits, RunOn
from stagectl.drives.virtual.node import VirtualNode
from stagectl.number_format import Travel
from tests.drives.workbench import DT, STEP, Workbench, enabled

READ_ONLY, ABSENT = 0x0601_0002, 0x0602_0000
RUN = RunOn(0.1, 100.0, 2.0)
AXIS = AxisLimits(20.0, 0.1, Travel(1.0, "m", False), RUN, RUN)


class Stubborn:
    """What a node refuses: keys (index << 8 | subindex) that are read-only, absent, or confirmed and forgotten."""

    def __init__(self, node: VirtualNode) -> None:
        self.node = node
        self.read_only: set[int] = set()
        self.absent: set[int] = set()
        self.forgets: set[int] = set()
        self.requests = 0
        self.event: Callable[[int], None] = lambda request: None
        local: Any = node.objects.node
        self._get, self._set = local.get_data, local.set_data
        local.get_data, local.set_data = self.get_data, self.set_data

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> Any:
        if check_readable:
            self.asked(index << 8 | subindex)
        return self._get(index, subindex, check_readable)

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        key = index << 8 | subindex
        if check_writable:
            self.asked(key)
            if key in self.read_only:
                raise SdoAbortedError(READ_ONLY)
            if key in self.forgets:
                return
        self._set(index, subindex, data, check_writable)

    def asked(self, key: int) -> None:
        self.requests += 1
        self.event(self.requests)
        if key in self.absent:
            raise SdoAbortedError(ABSENT)


class Scene:
    """A virtual drive in virtual time, and what it refuses."""

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench
        self.node, self.ours, self.time = bench.timed()
        self.refuses = Stubborn(self.node)

    def drive(self, brake: Brake = NO_BRAKE, **changes: Any) -> CanopenDrive:
        settings = self.bench.settings(**changes)
        return CanopenDrive(Wishes(settings, STEP, DT, AXIS), self.ours, brake, self.time)

    def store(self, key: int, value: int, size: int) -> None:
        """As the drive was delivered: no rule for writes applies."""
        data = self.node.objects.node.data_store.setdefault(key >> 8, {})
        data[key & 0xFF] = value.to_bytes(size, "little")
        self.node._configure()

    def number(self, key: int) -> int:
        return self.node.objects.number(key >> 8, key & 0xFF)


@pytest.fixture
def scene(bench: Workbench) -> Scene:
    return Scene(bench)


def refused(scene: Scene, **changes: Any) -> DriveError:
    with pytest.raises(DriveError) as caught:
        scene.drive(**changes)
    assert caught.value.node == 5
    return caught.value


def test_what_is_right_already_is_not_written(scene: Scene) -> None:
    scene.drive()
    scene.refuses.read_only |= {key for key in range(0x100000, 0x610000) if key not in (0x604000,)}
    assert enabled(scene.drive(), scene.time).fault is Fault.NONE


def test_the_protection_is_read_back_and_described_with_its_way(scene: Scene) -> None:
    description = scene.drive().describe()
    assert (scene.number(0x140005), scene.number(0x101601) & 0xFFFF, scene.number(0x600700)) == (10000, 10000, 3)
    assert "10000 ms" in description["protection"] and " m" in description["protection"]


@pytest.mark.parametrize("how", ["absent", "forgets", "read_only"])
def test_without_a_supervisor_it_is_refused_unless_accepted(scene: Scene, how: str) -> None:
    getattr(scene.refuses, how).update({0x101601, 0x140005})
    assert refused(scene).object_key == 0x101601
    assert refused(scene).place == "drive.wire.accept"
    description = scene.drive(accept=("no_supervision",)).describe()
    assert description["ACCEPTED: no_supervision"] == ACCEPTED["no_supervision"]
    assert description["protection"].startswith("NONE")


@pytest.mark.parametrize(("missing", "left"), [(0x101601, "0x1400:05"), (0x140005, "0x1016")])
def test_one_supervisor_is_enough(scene: Scene, missing: int, left: str) -> None:
    """What protects the axis is named, and nothing else is."""
    scene.refuses.absent.add(missing)
    drive = scene.drive()
    assert enabled(drive, scene.time).fault is Fault.NONE
    words = drive.describe()["protection"]
    assert left in words and len({"0x1400:05", "0x1016", "0x100C"} & set(re.findall("0x[0-9A-F:]+", words))) == 1


def test_a_heartbeat_alone_is_as_quick_as_the_missing_deadline(scene: Scene) -> None:
    scene.refuses.absent.add(0x140005)
    scene.drive(rpdo_timeout=0.02, heartbeat=0.05, heartbeat_timeout=0.5)
    assert scene.number(0x101601) == 127 << 16 | 20


@pytest.mark.parametrize("code", [0, 1, 2])
def test_the_reaction_becomes_a_quick_stop(scene: Scene, code: int) -> None:
    scene.store(0x600700, code, 2)
    scene.drive()
    assert scene.number(0x600700) == 3


@pytest.mark.parametrize("option", [1, 5])
def test_a_quick_stop_goes_by_the_ramp_that_is_set(scene: Scene, option: int) -> None:
    """Or else neither its length nor that of a stop without a controller would be what is claimed."""
    scene.store(0x605A00, option, 2)
    scene.refuses.read_only.add(0x605A00)
    error = refused(scene)
    assert (error.object_key, error.value) == (0x605A00, option)
    scene.refuses.read_only.clear()
    assert "brakes by its ramp" in scene.drive().describe()["protection"]
    assert scene.number(0x605A00) == option + 1


@pytest.mark.parametrize("option", [1, -1])
def test_a_lost_connection_that_is_a_fault_goes_by_the_ramp_that_is_set(scene: Scene, option: int) -> None:
    """The option of faults is another than that of quick stops."""
    scene.store(0x605E00, option & 0xFFFF, 2)
    scene.drive()  # a quick stop: it does not matter
    scene.store(0x600700, 1, 2)
    scene.refuses.read_only |= {0x600700, 0x605E00}
    error = refused(scene)
    assert (error.object_key, error.value) == (0x605E00, option)
    if option == 1:
        scene.refuses.read_only.remove(0x605E00)
        assert "brakes by its ramp" in scene.drive().describe()["protection"]
        assert scene.number(0x605E00) == 2


def test_a_quick_stop_of_the_vendors_own_is_not_taken_for_the_ramp(scene: Scene) -> None:
    scene.store(0x605A00, -1 & 0xFFFF, 2)
    assert (refused(scene).object_key, refused(scene).value) == (0x605A00, -1)


def test_a_person_may_want_another_reaction(scene: Scene) -> None:
    scene.drive(start_up=(StartUp(0x600700, 2),))
    assert scene.number(0x600700) == 2


def test_a_reaction_that_does_not_stop_is_refused_unless_accepted(scene: Scene) -> None:
    scene.store(0x600700, 0, 2)
    scene.refuses.read_only.add(0x600700)
    error = refused(scene)
    assert (error.object_key, error.value, error.place) == (0x600700, 0, "drive.wire.accept")
    assert scene.drive(accept=("no_reaction",)).describe()["protection"].startswith("NONE")


def test_a_fixed_reaction_that_stops_is_taken(scene: Scene) -> None:
    scene.store(0x600700, 2, 2)
    scene.refuses.read_only.add(0x600700)
    assert "coasts" in scene.drive().describe()["protection"]


def test_without_an_option_code_leaving_operational_must_be_accepted(scene: Scene) -> None:
    scene.refuses.absent.add(0x600700)
    assert refused(scene).object_key == 0x600700
    assert "ACCEPTED: no_reaction" in scene.drive(accept=("no_reaction",)).describe()  # this drive's 0x1029 is fixed
    scene.node.objects.getters[0x102901] = lambda: 0
    assert refused(scene, accept=("no_reaction",)).object_key == 0x600700
    assert "ACCEPTED: nmt_reaction" in scene.drive(accept=("nmt_reaction",)).describe()


OUTPUT = Brake("output", 0.03, 0.05)


def output_brake(scene: Scene, **changes: Any) -> DriveError:
    with pytest.raises(DriveError) as caught:
        scene.drive(brake=OUTPUT, **changes)
    return caught.value


def test_a_brake_that_we_set_needs_a_drive_that_holds_without_us(scene: Scene) -> None:
    scene.store(0x605A00, 2, 2)
    assert (output_brake(scene).object_key, output_brake(scene).value) == (0x605A00, 2)
    assert "ACCEPTED: output_brake" in scene.drive(brake=OUTPUT, accept=("output_brake",)).describe()
    scene.store(0x605A00, 6, 2)
    scene.drive(brake=OUTPUT)
    assert [scene.node.objects.number(0x60FE, subindex) for subindex in (1, 2)] == [1, 1]  # set, before any power
    scene.refuses.absent.add(0x60FE01)
    assert output_brake(scene).object_key == 0x60FE01
    scene.store(0x600700, 2, 2)
    scene.refuses.read_only.add(0x600700)
    assert (output_brake(scene).object_key, output_brake(scene).value) == (0x600700, 2)


@pytest.mark.parametrize("under_power", [0, 10])
def test_the_mode_is_shown_before_an_axis_may_move(scene: Scene, under_power: int) -> None:
    scene.node.objects.getters[0x606100] = lambda: 0
    drive = scene.drive()
    scene.node.objects.getters[0x606100] = lambda: under_power
    if under_power:
        assert enabled(drive, scene.time).fault is Fault.NONE
    else:
        with pytest.raises(DriveError, match="0x6061"):
            enabled(drive, scene.time)


MAPPINGS = {index << 8 | subindex for index in (0x1600, 0x1A00) for subindex in range(9)}


def fixed(scene: Scene, mapping: int, *entries: int) -> None:
    for subindex, entry in enumerate(entries, start=1):
        scene.store(mapping << 8 | subindex, entry, 4)
    scene.store(mapping << 8, len(entries), 1)
    scene.refuses.read_only |= MAPPINGS


@pytest.mark.parametrize(
    "entries",
    [(0x2071_0020, 0x6040_0010), (0x6040_0010, 0x6060_0008, 0x2071_0020), (0x6060_0008, 0x2071_0020, 0x6040_0010)],
)
def test_a_fixed_map_that_holds_what_is_needed_is_followed(scene: Scene, entries: tuple[int, ...]) -> None:
    fixed(scene, 0x1600, *entries)
    drive = scene.drive()
    assert enabled(drive, scene.time).fault is Fault.NONE
    for _ in range(50):
        drive.apply(1.0)
        assert drive.sample().fault is Fault.NONE
    assert scene.node.axis.plant.state.velocity > 0.0
    assert scene.node.axis.mode == 10


@pytest.mark.parametrize(
    ("mapping", "entries", "place", "missing"),
    [
        (0x1600, (0x6040_0010, 0x6060_0008), "rpdo", 0x207100),
        (0x1A00, (0x6041_0010, 0x6077_0010), "tpdo", 0x606400),
    ],
)
def test_a_fixed_map_that_does_not_fit_is_refused(
    scene: Scene, mapping: int, entries: tuple[int, ...], place: str, missing: int
) -> None:
    fixed(scene, mapping, *entries)
    error = refused(scene)
    assert (error.place, error.object_key) == (place, missing)


def test_a_fixed_identifier_is_followed(scene: Scene) -> None:
    scene.store(0x140001, 0x305, 4)
    scene.refuses.read_only.add(0x140001)
    drive = scene.drive(rpdo=(0x604000, 0x207100), rpdo_timeout=0.0)
    assert "0x305" in drive.describe()["RPDO"]


def test_what_only_the_drive_wants_in_its_rpdo_keeps_its_value(scene: Scene) -> None:
    settings = scene.bench.settings()
    pdo = PdoMap(0x205, (0x6072_0010, 0x6040_0010, 0x2071_0020), fill=(1500, 0, 0))
    command = CommandPdo(settings, load_eds(settings.eds, settings.node), pdo)
    assert parse(command.encode(0x0F, 0.0))[1] == (1500).to_bytes(2, "little") + b"\x0f\0" + bytes(4)


def test_a_boot_after_any_sdo_of_the_set_up_begins_it_again(bench: Workbench) -> None:
    """Always fully set up and read back, as without the boot."""
    calm = Scene(bench)
    calm.drive()
    wanted = [calm.number(key) for key in (0x101601, 0x140005, 0x600700, 0x608500, 0x160002)]
    for request in range(1, calm.refuses.requests + 1, 7):
        scene = Scene(bench)
        scene.refuses.event = lambda n, at=request, node=scene.node: node._reboot() if n == at else None  # type: ignore[misc]
        drive = scene.drive()
        assert [scene.number(key) for key in (0x101601, 0x140005, 0x600700, 0x608500, 0x160002)] == wanted, request
        assert enabled(drive, scene.time).fault is Fault.NONE, request


def test_a_drive_that_boots_again_and_again_is_refused(scene: Scene) -> None:
    scene.refuses.event = lambda n: scene.node._reboot() if n % 20 == 0 else None
    error = refused(scene)
    assert str(SETUPS) in str(error)
    assert not scene.node.axis.enabled


def test_the_boot_up_message_is_waited_for(scene: Scene) -> None:
    seen = scene.drive(reset="node").describe()["boot-up message"]
    assert seen.startswith("received")


def test_a_drive_without_a_boot_up_message_is_said_to_have_none(scene: Scene) -> None:
    receive = scene.ours.receive
    boot = frame(0x705, b"\0")

    def deaf(timeout: float) -> bytes | None:
        raw = receive(timeout)
        return None if raw == boot else raw

    scene.ours.receive = deaf  # type: ignore[method-assign]
    assert "NOT SENT" in scene.drive(reset="node").describe()["boot-up message"]


@pytest.mark.parametrize(
    ("stated", "key", "value"),
    [
        ({"vendor": 7}, 0x101801, 0),
        ({"product": 7}, 0x101802, 0x402),
        ({"revision": 7}, 0x101803, 0x10000),
        ({"serial": 7}, 0x101804, 1),
    ],
)
def test_another_drive_is_refused(scene: Scene, stated: dict[str, int], key: int, value: int) -> None:
    error = refused(scene, identity=Identity(**stated))
    assert (error.place, error.object_key, error.value) == (f"drive.wire.identity.{next(iter(stated))}", key, value)


def test_the_right_drive_is_taken(scene: Scene) -> None:
    assert scene.drive(identity=Identity(0, 0x402, 0x10000, 1)).describe()["serial number"] == "0x00000001"


def test_a_product_that_its_eds_does_not_know_is_refused_unless_stated(scene: Scene) -> None:
    scene.store(0x101802, 0x403, 4)
    assert refused(scene).object_key == 0x101802
    assert scene.drive(identity=Identity(product=0x403))


def test_objects_follow_from_the_axis(scene: Scene) -> None:
    scene.drive()
    assert scene.number(0x607200) == 2000  # 20 A of 10 A rated
    assert scene.number(0x100600) == 1000  # us
    assert scene.number(0x60C201) * 10.0 ** scene.number(0x60C202) == pytest.approx(DT)


@pytest.mark.parametrize(
    ("key", "value", "size", "read_only"),
    [(0x607300, 600, 2, False), (0x607200, 600, 2, True), (0x607E00, 0x80, 1, False)],
)
def test_a_drive_that_would_limit_or_invert_is_refused(
    scene: Scene, key: int, value: int, size: int, read_only: bool
) -> None:
    scene.store(key, value, size)
    scene.refuses.read_only |= {key} if read_only else set()
    error = refused(scene)
    assert (error.object_key, error.value) == (key, value)


def test_an_inverted_polarity_may_be_accepted(scene: Scene) -> None:
    scene.store(0x607E00, 0xC0, 1)
    assert "ACCEPTED: inverted_polarity" in scene.drive(accept=("inverted_polarity",)).describe()


def test_a_persons_objects_are_written_and_must_hold(scene: Scene) -> None:
    scene.drive(start_up=(StartUp(0x606500, 5000),))
    assert scene.number(0x606500) == 5000
    scene.refuses.forgets.add(0x606500)
    error = refused(scene, start_up=(StartUp(0x606500, 6000),))
    assert (error.place, error.object_key, error.value) == ("drive.wire.start_up", 0x606500, 5000)


@pytest.mark.parametrize(("key", "value"), [(0x600700, 0), (0x608500, 7), (0x101601, 0), (0x140005, 0)])
def test_a_persons_objects_do_not_undo_the_protection(scene: Scene, key: int, value: int) -> None:
    error = refused(scene, start_up=(StartUp(key, value),))
    assert (error.place, error.object_key) == ("drive.wire.start_up", key)
    assert scene.number(key) != value


def test_the_protection_is_described_as_a_persons_objects_leave_it(scene: Scene) -> None:
    assert "coasts" in scene.drive(start_up=(StartUp(0x605A00, 0),)).describe()["protection"]


def test_an_object_that_is_shorter_than_the_eds_says_is_refused_by_name(scene: Scene) -> None:
    local: Any = scene.node.objects.node
    get = local.get_data
    short: Any = lambda index, *rest, **more: b"\x01" if index == 0x6075 else get(index, *rest, **more)  # noqa: E731
    local.get_data = short
    assert refused(scene).object_key == 0x607500


@pytest.mark.parametrize("length", [1, 4, 5])
def test_sdo_answers_cut_short_end_in_a_refusal(scene: Scene, length: int) -> None:
    """The real-time process lives and says what is wrong."""
    bus: Any = scene.node._bus
    send = bus.send
    cut: Any = lambda raw: send(frame(parse(raw)[0], parse(raw)[1][:length]) if parse(raw)[0] == 0x585 else raw)  # noqa: E731
    bus.send = cut
    refused(scene)


def test_a_set_up_that_is_lost_without_a_boot_up_message_is_found_out(scene: Scene) -> None:
    """Once: it is set up again.  Always: refused."""
    manage = scene.node._manage
    lost = [True, False]

    def forgetful(raw: bytes) -> None:
        manage(raw)
        if raw[8] == 1 and lost and lost.pop(0):  # NMT start
            scene.store(0x101601, 0, 4)

    scene.node._manage = forgetful  # type: ignore[method-assign]
    scene.drive()
    assert scene.number(0x101601) == 127 << 16 | 10000
    lost[:] = [True] * SETUPS
    error = refused(scene)
    assert (error.object_key, error.value) == (0x101601, 0)
