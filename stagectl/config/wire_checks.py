"""Whether the wire to the drive can carry a cycle every control period, and whether it carries what the cycle needs."""

import os
from collections.abc import Iterator
from pathlib import Path

from stagectl.config.bounds import DELAY_LINE, FIRST_OBJECT, LAST_OBJECT, PER_MILLE, SAME_SCALE, SLCAN_BAUD
from stagectl.config.stage_blocks import StageFile
from stagectl.drives import cycle_time
from stagectl.drives.drive import Canopen, Odrive, offered
from stagectl.problem import Problem, ProblemKind, absent
from stagectl.units import LINEAR

OWN = Path(__file__).parents[2] / "config"  # of the checkout
_CONFLICT, _RANGE = ProblemKind.CONFLICT, ProblemKind.RANGE
_HEAD = 4096  # bytes in which an EDS has its first section


def wire_conflicts(file: StageFile, path: Path) -> Iterator[Problem]:
    """What is wrong with the wire of a stage file that lies at `path`."""
    wire, period = file.drive.wire, file.control.period
    if isinstance(wire, Odrive):
        yield from _odrive(file)
        yield from slow_odrive(wire, period)
    elif isinstance(wire, Canopen):
        yield from unusable(wire)
        yield from _objects(wire, path)
        yield from _scales(wire)
        yield from _timeouts(wire, period)
        yield from slow_slcan(wire, period)
        yield from _slow_bus(wire, period)


_TRIED = ("embedded", "stagectl", "socketcan", "slcan", "socketcand")  # the others are passed on to python-can
_UNUSABLE = {
    "udp_multicast": "its frames leave this machine by the default route, and anybody there could move the axis",
    "virtual": "it ends with the process that opens it, and the drive is none of that process",
}


def unusable(wire: Canopen) -> Iterator[Problem]:
    """Why no drive can be reached over this interface, whatever the computer has."""
    key, interface = "drive.wire.interface", wire.interface
    if reason := _UNUSABLE.get(interface, ""):
        yield Problem(reason, _CONFLICT, key, interface, remedy="on one machine take `interface: embedded`")
    elif interface == "socketcand" and offered(wire.channel) is None:
        reason = "of socketcand it must name interface, host and port, such as can0@192.168.1.2:29536"
        yield Problem(reason, ProblemKind.VALUE, "drive.wire.channel", wire.channel)
    elif interface not in _TRIED:
        import can  # a tenth of a second: only where it is asked for

        if interface not in can.VALID_INTERFACES:
            known = tuple(sorted({"embedded", *can.VALID_INTERFACES} - {*_UNUSABLE, "stagectl"}))
            yield Problem("", ProblemKind.VALUE, key, interface, choices=known)


def untried(file: StageFile) -> str:
    """What to say of an interface of python-can that stagectl has not been tried with; empty elsewhere."""
    wire = file.drive.wire
    if not isinstance(wire, Canopen) or wire.interface in _TRIED:
        return ""
    words = f"drive.wire.interface = {wire.interface}: python-can has it, and stagectl has not been tried with it"
    return f"{words}; `stagectl drive probe` shows whether the drive answers, and moves nothing"


def eds_path(name: str, stage_file: Path) -> Path:
    """The EDS file: relative to the stage file, or to the configuration of the checkout where that has it."""
    beside = stage_file.parent.resolve() / name
    return beside if _exists(beside) or not _exists(OWN / name) else OWN / name


def _exists(path: Path) -> bool:
    return os.path.isfile(path)  # unlike `Path.is_file` also for too long a name, and in a folder that is forbidden


def _objects(wire: Canopen, path: Path) -> Iterator[Problem]:
    if not _exists(eds_path(wire.eds, path)):
        reason, remedy = f"the path is relative to {path.parent}", absent(path.parent / wire.eds)
        yield Problem(reason, ProblemKind.FILE, "drive.wire.eds", wire.eds, remedy=remedy)
    elif not _is_eds(eds_path(wire.eds, path)):
        reason, remedy = "must be an EDS or DCF file", "name the file that came with the drive"
        yield Problem(reason, ProblemKind.FILE, "drive.wire.eds", wire.eds, remedy=remedy)
    yield from _pdo("drive.wire.rpdo", wire.rpdo, "drive.wire.command_object", wire.command_object)
    yield from _pdo("drive.wire.tpdo", wire.tpdo, "drive.wire.current_object", wire.current_object)


def _is_eds(path: Path) -> bool:
    """Whether a file has the ending and a section of an electronic data sheet (CiA 306)."""
    with path.open("rb") as file:
        return path.suffix.lower() in (".eds", ".dcf", ".epf") and b"[" in file.read(_HEAD)


def _no_object(key: str, number: int) -> Problem:
    """Why a number is no object; one without 0x was meant as an index."""
    indices = [int(str(number), 16), number]  # 6071, or 0x6071 that YAML has read
    near = next((index for index in indices if FIRST_OBJECT <= index << 8 <= LAST_OBJECT), None)
    remedy = "" if near is None else f"write 0x{near:04x}_00"
    shown = f"0x{number:x}" if near == number else str(number)
    return Problem("an object is hexadecimal with its subindex", _RANGE, key, shown, remedy=remedy)


def _pdo(key: str, objects: tuple[int, ...], cycle_key: str, needed: int) -> Iterator[Problem]:
    unusable = [number for number in objects if not FIRST_OBJECT <= number <= LAST_OBJECT]
    if unusable:
        yield Problem("must be an index with its subindex, such as 0x6040_00", _RANGE, key, f"{unusable[0]:#x}")
    elif needed and not FIRST_OBJECT <= needed <= LAST_OBJECT:
        yield _no_object(cycle_key, needed)
    elif needed and needed not in objects:
        reason = f"must hold the object 0x{needed >> 8:04x}_{needed & 0xFF:02x} that the cycle uses"
        yield Problem(reason, _CONFLICT, key)


def _scales(wire: Canopen) -> Iterator[Problem]:
    """A count of CiA 402's torque and current is a thousandth of the rated current: else all currents are off."""
    permille = 1e-3 * wire.rated_current
    for name, number, scale in (
        ("command", wire.command_object, wire.command_scale),
        ("current", wire.current_object, wire.current_scale),
    ):
        if number in PER_MILLE and abs(scale / permille - 1.0) > SAME_SCALE:
            reason = (
                f"0x{number >> 8:04x}_00 counts per mille of rated_current, {wire.rated_current:g} A: each current "
                f"would be {max(scale / permille, permille / scale):.3g} times off"
            )
            key, value = f"drive.wire.{name}_scale", f"{1e3 * scale:g} mA"
            yield Problem(reason, _CONFLICT, key, value, "A", remedy=f"write {1e3 * permille:g} mA")


def _timeouts(wire: Canopen, period: float) -> Iterator[Problem]:
    if wire.heartbeat_timeout <= wire.heartbeat:
        value = f"{wire.heartbeat_timeout:g} s"
        yield Problem("must exceed drive.wire.heartbeat", _CONFLICT, "drive.wire.heartbeat_timeout", value, "s")
    if 0.0 < wire.rpdo_timeout <= period:
        reason, value = "must exceed control.period, or be 0 s: off", f"{wire.rpdo_timeout:g} s"
        yield Problem(reason, _CONFLICT, "drive.wire.rpdo_timeout", value, "s")


def _slow_bus(wire: Canopen, period: float) -> Iterator[Problem]:
    share, limit = cycle_time.bus_load(1.0 / period, wire.bitrate), wire.bus_load_limit
    if share > limit:
        reason = (
            f"SYNC and two PDOs every {period * 1e3:g} ms take {100 * share:.0f} % of the bus, the limit is "
            f"{100 * limit:.0f} %"
        )
        remedy = f"raise the bit rate, or take control.period of at least {period * share / limit * 1e3:.3g} ms"
        rate = f"{wire.bitrate / 1e3:g} kbit/s"
        yield Problem(reason, _CONFLICT, "drive.wire.bitrate", rate, "bit/s", remedy=remedy)


def slow_slcan(wire: Canopen, period: float) -> Iterator[Problem]:
    """Why a serial CAN adapter cannot carry a cycle every `period` (s); nothing on another interface."""
    if wire.interface != "slcan":
        return
    key, channel, baud = "drive.wire.channel", wire.channel, cycle_time.slcan_baud(wire.channel)
    low, high = SLCAN_BAUD
    if not low <= baud <= high:
        yield Problem(f"after @ belongs a baud rate in [{low:.0f}, {high:.0f}]", _RANGE, key, channel)
        return
    seconds, limit = cycle_time.slcan_cycle(baud, wire.bitrate), wire.bus_load_limit
    if seconds > limit * period:
        reason = (
            f"at {baud:g} baud SYNC, answer and command, {cycle_time.SLCAN_CHARACTERS} characters, "
            f"{_too_long(seconds, period, limit)}"
        )
        faster = "take a faster line (an adapter on USB runs at its own speed: write @3000000)"
        yield Problem(reason, _CONFLICT, key, channel, remedy=f"{faster}, or {_longer(seconds / limit)}")


def slow_odrive(wire: Odrive, period: float) -> Iterator[Problem]:
    """Why the line to an ODrive cannot carry a cycle every `period` (s)."""
    seconds, limit = cycle_time.odrive_cycle(wire.baud), wire.line_load_limit
    if seconds > limit * period:
        reason = (
            f"question, answer, command and state, up to {cycle_time.ODRIVE_CHARACTERS} characters, "
            f"{_too_long(seconds, period, limit)}"
        )
        remedy = f"raise the baud rate in the drive and here, or {_longer(seconds / limit)}"
        yield Problem(reason, _CONFLICT, "drive.wire.baud", f"{wire.baud:g} bit/s", "bit/s", remedy=remedy)


def _too_long(seconds: float, period: float, limit: float) -> str:
    return f"take {seconds * 1e3:.3g} ms of a period of {period * 1e3:g} ms, the limit is {100 * limit:.0f} %"


def _longer(period: float) -> str:
    return f"take control.period of at least {period * 1e3:.3g} ms"


def _odrive(file: StageFile) -> Iterator[Problem]:
    if file.axis.kind == LINEAR:
        yield Problem("an ODrive counts turns, so the axis must be rotary", _CONFLICT, "axis.kind", file.axis.kind)
    if not file.drive.delay_samples:
        reason = "over a serial line a command acts one period later at the earliest"
        yield Problem(reason, _CONFLICT, "drive.delay_samples", "0", interval=f"[1, {DELAY_LINE}]")
