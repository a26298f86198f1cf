"""What a CiA 402 drive says of itself over SDO, without an EDS: nothing is written, and no state is changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from stagectl.drives.bus.frames import Bus, frame, parse
from stagectl.drives.canopen import cia402, presets
from stagectl.drives.canopen.library import SdoAbortedError, SdoCommunicationError, SdoError, canopen
from stagectl.drives.canopen.network import Network, Partner, load_eds
from stagectl.drives.canopen.presets import Preset
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, DriveError

MODES = {0: "profile position", 2: "profile velocity", 3: "profile torque", 5: "homing", 6: "interpolated position"}
MODES |= {7: "cyclic synchronous position", 8: "cyclic synchronous velocity", 9: "cyclic synchronous torque"}
UNIT_OF_ACCELERATION = 0x60AA
RPM_PER_SECOND = 0x00C0_0300  # of 0x60AA, as CiA 303-2 writes it
ENCODER = 0x608F
_ANSWER_TIME = 0.5  # s for one answer
_NODES, _AT_ONCE, _TURN = 126, 8, 0.02  # ids, requests at once, s for their answers
_REQUEST, _ANSWER = 0x600, 0x580  # SDO, less the node id
_UPLOAD_DEVICE_TYPE = b"\x40\x00\x10\x00\x00\x00\x00\x00"
_NAME = 200  # characters of a name that are shown

Read = Callable[[int, int], bytes | None]


class Probed(NamedTuple):
    """What the drive said, and what follows from it."""

    told: dict[str, str]  # in words, in the order in which it was asked
    vendor: int | None
    modes: int | None  # 0x6502
    rated: float | None  # A, that 1000 per mille stand for
    preset: Preset
    values: dict[str, float | int]  # for ``drive.wire``, SI; empty while the rated current is not known
    doubts: tuple[str, ...]  # what must be looked at


def probe(
    wire: Canopen, bus: Bus, chosen: Preset | None = None, rated: float | None = None, clock: Clock = WALL
) -> Probed:
    """Ask the node of `wire`; `chosen` and `rated` (A) stand for what it does not tell.

    Raises DriveError where nobody answers, or what answers is no CiA 402 drive.
    """
    network = Network(bus, clock)
    node = Partner(wire.node, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
    network[wire.node] = node
    node.sdo.RESPONSE_TIMEOUT = _ANSWER_TIME

    def read(index: int, subindex: int = 0) -> bytes | None:
        try:
            return bytes(node.sdo.upload(index, subindex))
        except SdoAbortedError:
            return None
        except SdoCommunicationError as error:
            raise DriveError(_silent(wire, answering(bus, clock))) from error
        except SdoError as error:
            raise DriveError(
                f"node {wire.node}: object 0x{index:04X}:{subindex:02X} cannot be read: {error}"
            ) from error

    _check_profile(wire, read)
    found = _concluded(read, chosen, rated)
    return found._replace(doubts=(*found.doubts, *against_eds(wire, read, found.preset)))


def answering(bus: Bus, clock: Clock = WALL) -> list[int]:
    """Ids of the nodes that answer an SDO on `bus`, asked eight at a time as queues are short."""
    found = set()
    for first in range(1, _NODES + 1, _AT_ONCE):
        for node in range(first, min(first + _AT_ONCE, _NODES + 1)):
            bus.send(frame(_REQUEST + node, _UPLOAD_DEVICE_TYPE))
        end = clock.now() + _TURN
        while (left := end - clock.now()) > 0.0:
            raw = bus.receive(left)
            identifier = parse(raw)[0] if raw is not None else 0
            if _ANSWER < identifier <= _ANSWER + _NODES:
                found.add(identifier - _ANSWER)
            if raw is None:
                break
    return sorted(found)


def _silent(wire: Canopen, others: list[int]) -> str:
    said = f"node {wire.node} does not answer on {wire.interface} {wire.channel}"
    if others:
        ids = ", ".join(map(str, others))
        return (
            f"{said}, node {ids} does: set 'node: {others[0]}' in the stage file, or see `stagectl doctor STAGE.yaml`"
        )
    return (
        f"{said}, and nobody else does; is the drive powered, is the bit rate right, the bus terminated? "
        f"`stagectl doctor STAGE.yaml` looks at the interface (virtual: is 'stagectl virtual-drive' running on this "
        f"channel?)"
    )


def against_eds(wire: Canopen, read: Read, preset: Preset) -> list[str]:
    """Where the EDS of the stage file is of another drive, or lacks what the cycle needs.

    Raises DriveError where it cannot be read.
    """
    od = load_eds(wire.eds, wire.node)
    about, found = od.device_information, []
    for subindex, name, written in ((1, "vendor", about.vendor_number), (2, "product", about.product_number)):
        said = _number(read(cia402.IDENTITY, subindex))
        if written is not None and said is not None and written != said:
            found.append(f"{wire.eds} is for {name} 0x{written:08X}, the drive says 0x{said:08X}: take its own EDS")
    for key in (preset.command_object, preset.current_object):
        variable = od.get_variable(key >> 8, key & 0xFF)
        if variable is None or not variable.pdo_mappable:
            lacking = "lacks" if variable is None else "does not let map"
            found.append(f"{wire.eds} {lacking} 0x{key >> 8:04X}: take another object, or the EDS of this drive")
    return found


def _check_profile(wire: Canopen, read: Read) -> None:
    kind = _number(read(cia402.DEVICE_TYPE, 0)) or 0
    if kind & 0xFFFF != cia402.PROFILE:
        raise DriveError(
            f"node {wire.node}: device type 0x1000 = 0x{kind:08X} is profile {kind & 0xFFFF}; must be {cia402.PROFILE} "
            f"(a CiA 402 drive); check 'node: {wire.node}' in the stage file"
        )


def _concluded(read: Read, chosen: Preset | None, rated: float | None) -> Probed:
    vendor, modes = _number(read(*_IDENTITY)), _number(read(cia402.SUPPORTED_MODES, 0))
    preset = chosen or presets.for_vendor(vendor)
    told_rated = _number(read(preset.rated >> 8, preset.rated & 0xFF))
    current = rated or (told_rated * 1e-3 if told_rated else None)
    told = {**_identity(read), **_state(read, modes), **_stops(read), **_units(read)}
    key = f"rated current (0x{preset.rated >> 8:04X}:{preset.rated & 0xFF:02X})"
    told[key] = f"{told_rated * 1e-3:g} A" if told_rated is not None else "not offered by this drive"
    values = presets.wire_values(preset, current) if current else {}
    unit = _number(read(UNIT_OF_ACCELERATION, 0))
    if unit == RPM_PER_SECOND and values:
        values["deceleration_scale"] = presets.RPM_PER_SECOND
    return Probed(
        told, vendor, modes, current, preset, values, (*_doubts(preset, modes, current, values), *_careless(read))
    )


_IDENTITY = (cia402.IDENTITY, 1)


def _identity(read: Read) -> dict[str, str]:
    found = {}
    for subindex, name in enumerate(("vendor", "product", "revision", "serial number"), start=1):
        value = _number(read(cia402.IDENTITY, subindex))
        if value is not None:
            found[name] = f"0x{value:08X}"
    for index, name in ((cia402.DEVICE_NAME, "device name"), (cia402.SOFTWARE_VERSION, "software version")):
        raw = read(index, 0)
        if raw:
            text = raw.decode("latin-1").strip("\0 ")
            found[name] = "".join(one if one.isprintable() else "?" for one in text)[:_NAME]
    return found


def _state(read: Read, modes: int | None) -> dict[str, str]:
    statusword = _number(read(cia402.STATUSWORD, 0))
    found = {} if statusword is None else {"state": f"{cia402.state(statusword).words} (0x{statusword:04X})"}
    offered = [words for bit, words in MODES.items() if modes is not None and modes >> bit & 1]
    found["modes (0x6502)"] = ", ".join(offered) if modes is not None else "not offered by this drive"
    return found


def _stops(read: Read) -> dict[str, str]:
    found = {}
    for index, (name, _) in cia402.OPTIONS.items():
        value = _number(read(index, 0), signed=True)
        found[name] = "not offered by this drive" if value is None else f"{value}: {cia402.option(index, value)}"
    heartbeat = read(cia402.CONSUMER_HEARTBEAT, 1)
    found["notices a dead controller (0x1016)"] = "yes, once it is configured" if heartbeat is not None else "NO"
    deadline = read(cia402.RPDO_PARAMETER, 5)
    found["RPDO time-out (0x1400:05)"] = "offered" if deadline is not None else "not offered by this drive"
    return found


def _units(read: Read) -> dict[str, str]:
    found = {}
    counts, turns = _number(read(ENCODER, 1)), _number(read(ENCODER, 2))
    if counts and turns:
        found["encoder (0x608F)"] = f"{counts / turns:.10g} counts per revolution"
    unit = _number(read(UNIT_OF_ACCELERATION, 0))
    if unit is not None:
        found["unit of accelerations (0x60AA)"] = "rpm/s" if unit == RPM_PER_SECOND else f"0x{unit:08X}, see CiA 303-2"
    return found


def _doubts(preset: Preset, modes: int | None, rated: float | None, values: dict[str, float | int]) -> list[str]:
    found = []
    if modes is not None and not modes & cia402.CYCLIC_SYNCHRONOUS_TORQUE_BIT:
        found.append("it does not offer cyclic synchronous torque mode: enable it in the drive, or use another one")
    if rated is None:
        found.append(f"the drive does not report its rated current ({preset.rated_words}): give it with --rated '4 A'")
    elif "deceleration_scale" not in values:
        found.append(
            "the unit of its stop ramp (0x6085) is not known: look it up, and set drive.wire.deceleration_scale"
        )
    return found


def _careless(read: Read) -> list[str]:
    """Where the drive, as it is set, would let the axis go on without a controller."""
    if _number(read(cia402.ABORT_CONNECTION, 0), signed=True) != 0:
        return []
    return [
        "its abort connection option (0x6007) is 0: the axis goes on when the controller is lost; set it to 3, quick "
        "stop, in the drive, and then: stagectl drive probe again"
    ]


def _number(raw: bytes | None, signed: bool = False) -> int | None:
    return None if not raw else int.from_bytes(raw[:8], "little", signed=signed)
