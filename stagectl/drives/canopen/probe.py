"""What a CiA 402 drive reports about itself over SDO, without an EDS: nothing is written, no state is changed."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from stagectl.drives.bus.frames import MASTER, SDO_ANSWER, SDO_REQUEST, Bus, frame, parse
from stagectl.drives.canopen import cia402, presets
from stagectl.drives.canopen.network import check_profile, load_eds
from stagectl.drives.canopen.object_access import PlainSdo, SilentDriveError, number
from stagectl.drives.canopen.presets import Preset
from stagectl.drives.canopen.protection import NOT_OFFERED, outlook
from stagectl.drives.clock import WALL
from stagectl.drives.drive import Canopen, DriveError
from stagectl.drives.limits import SCAN_AT_ONCE, SCAN_TIME, SHOWN_NAME
from stagectl.drives.run_on import UNKNOWN_AXIS, AxisLimits

MODES = {0: "profile position", 2: "profile velocity", 3: "profile torque", 5: "homing", 6: "interpolated position"}
MODES |= {7: "cyclic synchronous position", 8: "cyclic synchronous velocity", 9: "cyclic synchronous torque"}
UNIT_OF_ACCELERATION = 0x60AA
_NUMBERS = ("vendor", "product", "revision", "serial number")
RPM_PER_SECOND = 0x00C0_0300  # of 0x60AA, as CiA 303-2 writes it

Read = Callable[[int, int], bytes | None]


class ProbeResult(NamedTuple):
    """What the drive reports, and what follows from it."""

    answers: dict[str, str]  # in words, in the order of the questions
    vendor: int | None
    modes: int | None  # 0x6502
    rated: float | None  # A, that 1000 per mille stand for
    preset: Preset
    values: dict[str, float | int]  # for ``drive.wire``, SI; empty while the rated current is not known
    doubts: tuple[str, ...]  # what must be looked at


def probe(
    wire: Canopen,
    bus: Bus,
    chosen: Preset | None = None,
    rated: float | None = None,
    limits: AxisLimits = UNKNOWN_AXIS,
) -> ProbeResult:
    """Read the node of `wire`; `chosen` and `rated` (A) replace what it does not report, `limits` are the axis'.

    Raises DriveError where no node answers, or the node is no CiA 402 drive.
    """
    objects = PlainSdo(wire, bus)

    def read(index: int, subindex: int = 0) -> bytes | None:
        try:
            return objects.read(index, subindex)
        except SilentDriveError as error:
            raise DriveError(_silent(wire, answering(bus)), place=wire.channel, node=wire.node) from error

    check_profile(number(read(cia402.DEVICE_TYPE, 0)) or 0, wire.node)
    result = _concluded(read, chosen, rated)
    protection = outlook(wire, lambda index, subindex: number(read(index, subindex), signed=True), limits)
    answers = {**result.answers, "protection": protection.words}
    doubts = [] if protection.good else [f"it is not enabled like this: protection {protection.words}"]
    if result.values and "deceleration_scale" not in result.values and wire.deceleration_scale:
        doubts.append("remove drive.wire.deceleration_scale: the drive's stop ramp counts encoder steps")
    return result._replace(answers=answers, doubts=(*result.doubts, *doubts, *against_eds(wire, read, result.preset)))


def answering(bus: Bus, nodes: Sequence[int] = range(1, MASTER), patience: float = SCAN_TIME) -> list[int]:
    """Which of the `nodes` answer an SDO on `bus` within `patience` (s): asked eight at a time, as queues are short."""
    found = set[int]()
    for first in range(0, len(nodes), SCAN_AT_ONCE):
        asked = nodes[first : first + SCAN_AT_ONCE]
        for node in asked:
            bus.send(frame(SDO_REQUEST + node, cia402.UPLOAD_DEVICE_TYPE))
        end = WALL.now() + patience
        while not found.issuperset(asked) and (left := end - WALL.now()) > 0.0:
            raw = bus.receive(left)
            if raw is None:
                break
            found.add(parse(raw)[0] - SDO_ANSWER)
    return sorted(found.intersection(nodes))


def _silent(wire: Canopen, others: list[int]) -> str:
    silence = f"node {wire.node} does not answer on {wire.interface} {wire.channel}"
    if others:
        ids = ", ".join(map(str, others))
        fix = f"set 'node: {others[0]}' in the stage file, or run `stagectl doctor STAGE.yaml`"
        return f"{silence}, but node {ids} does: {fix}"
    return (
        f"{silence}, and no other node does. Probable causes: no power, a wrong bit rate, no bus termination; for a"
        " virtual drive: 'stagectl virtual-drive' does not run on this channel. Next: `stagectl doctor STAGE.yaml`"
    )


def against_eds(wire: Canopen, read: Read, preset: Preset) -> list[str]:
    """Where the EDS of the stage file belongs to another drive, or has no object that the cycle needs.

    Raises DriveError where it cannot be read.
    """
    od = load_eds(wire.eds, wire.node)
    eds, doubts = od.device_information, []
    for subindex, name, written in ((1, "vendor", eds.vendor_number), (2, "product", eds.product_number)):
        reported = number(read(cia402.IDENTITY, subindex))
        if written is not None and reported is not None and written != reported:
            doubts.append(
                f"{wire.eds} is for {name} 0x{written:08X}, the drive reports 0x{reported:08X}: take its own EDS"
            )
    for key in (preset.command_object, preset.current_object):
        variable = od.get_variable(key >> 8, key & 0xFF)
        if variable is None or not variable.pdo_mappable:
            problem = "has no" if variable is None else "does not let the cycle map"
            doubts.append(f"{wire.eds} {problem} 0x{key >> 8:04X}: take another object, or the EDS of this drive")
    return doubts


def _concluded(read: Read, chosen: Preset | None, rated: float | None) -> ProbeResult:
    vendor, modes = number(read(cia402.IDENTITY, 1)), number(read(cia402.SUPPORTED_MODES, 0))
    preset = chosen or presets.for_vendor(vendor)
    reported_rated = number(read(preset.rated >> 8, preset.rated & 0xFF))
    current = rated or (reported_rated * 1e-3 if reported_rated else None)
    named = identity(read, {cia402.DEVICE_NAME: "device name", cia402.SOFTWARE_VERSION: "software version"})
    about = {name: shown[:SHOWN_NAME] for name, shown in named.items()}
    answers = {**about, **_state(read, modes), **_stops(read), **_units(read)}
    key = f"rated current ({cia402.shown(preset.rated)})"
    answers[key] = f"{reported_rated * 1e-3:g} A" if reported_rated is not None else NOT_OFFERED
    values = presets.wire_values(preset, current) if current else {}
    unit = number(read(UNIT_OF_ACCELERATION, 0))
    if unit == RPM_PER_SECOND and values:
        values["deceleration_scale"] = presets.RPM_PER_SECOND
    return ProbeResult(answers, vendor, modes, current, preset, values, tuple(_doubts(preset, modes, current, values)))


def identity(read: Read, texts: Mapping[int, str]) -> dict[str, str]:
    """The identity object (0x1018), and what the drive gives of the `texts`, objects that are named so."""
    numbers = {name: number(read(cia402.IDENTITY, subindex)) for subindex, name in enumerate(_NUMBERS, start=1)}
    known = {name: f"0x{value:08X}" for name, value in numbers.items() if value is not None}
    for index, name in texts.items():
        if raw := read(index, 0):
            text = raw.decode("latin-1").strip("\0 ")
            known[name] = "".join(letter if letter.isprintable() else "?" for letter in text)
    return known


def _state(read: Read, modes: int | None) -> dict[str, str]:
    statusword = number(read(cia402.STATUSWORD, 0))
    answers = {} if statusword is None else {"state": f"{cia402.state(statusword).words} (0x{statusword:04X})"}
    offered = [words for bit, words in MODES.items() if modes is not None and modes >> bit & 1]
    answers["modes (0x6502)"] = ", ".join(offered) if modes is not None else NOT_OFFERED
    return answers


def _stops(read: Read) -> dict[str, str]:
    answers = {}
    for index, (name, _) in cia402.OPTIONS.items():
        value = number(read(index, 0), signed=True)
        answers[name] = NOT_OFFERED if value is None else f"{value}: {cia402.option(index, value)}"
    return answers


def _units(read: Read) -> dict[str, str]:
    answers = {}
    counts, turns = number(read(cia402.ENCODER, 1)), number(read(cia402.ENCODER, 2))
    if counts and turns:
        answers["encoder (0x608F)"] = f"{counts / turns:.10g} counts per revolution"
    unit = number(read(UNIT_OF_ACCELERATION, 0))
    if unit is not None:
        known = "rpm/s" if unit == RPM_PER_SECOND else f"0x{unit:08X}, see CiA 303-2"
        answers["unit of accelerations (0x60AA)"] = known
    return answers


def _doubts(preset: Preset, modes: int | None, rated: float | None, values: dict[str, float | int]) -> list[str]:
    doubts = []
    if modes is not None and not modes & cia402.CYCLIC_SYNCHRONOUS_TORQUE_BIT:
        doubts.append("it does not offer cyclic synchronous torque mode: enable it in the drive, or use another one")
    if rated is None:
        doubts.append(f"the drive does not report its rated current ({preset.rated_words}): give it with --rated '4 A'")
    elif preset.deceleration_scale is None and "deceleration_scale" not in values:
        doubts.append(
            "the unit of its stop ramp (0x6085) is not known: look it up, and set drive.wire.deceleration_scale"
        )
    return doubts
