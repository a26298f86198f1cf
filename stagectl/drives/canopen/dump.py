"""All objects of a drive that its EDS lists, read over SDO: how the drive is set, as JSON or as a DCF.

Nothing is written to the drive.  An object that it refuses is listed with the abort code, and the next one is read.
"""

import configparser
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.drives.bus.frames import Bus
from stagectl.drives.canopen.library import SdoAbortedError, SdoCommunicationError, canopen
from stagectl.drives.canopen.network import PumpedNode, load_eds
from stagectl.drives.drive import Canopen, DriveError
from stagectl.drives.limits import PROBE_ANSWER_TIME, SILENT_OBJECTS
from stagectl.replacing import check_ending, check_file_to_be, check_replaceable, write_text

Progress = Callable[[int, int], None]


class ObjectValue(NamedTuple):
    """One object."""

    number: int  # the object's index
    subindex: int
    name: str
    access: str
    value: int | float | str | None  # None: it was not read
    default: int | float | str | None  # of the EDS
    problem: str  # why it was not read

    @property
    def changed(self) -> bool:
        """Whether it differs from the default of the EDS."""
        return self.value is not None and self.default is not None and self.value != self.default


def dump(wire: Canopen, bus: Bus, progress: Progress = lambda *_: None) -> list[ObjectValue]:
    """Read all readable objects of the node of `wire`.  Raises DriveError where it does not answer."""
    od = load_eds(wire.eds, wire.node)
    node = PumpedNode(wire.node, od, bus)
    node.sdo.RESPONSE_TIMEOUT = PROBE_ANSWER_TIME
    variables = list(_variables(od))
    values: list[ObjectValue] = []
    for number, variable in enumerate(variables):
        values.append(_entry(node, variable))
        progress(number + 1, len(variables))
        if len(values) >= SILENT_OBJECTS and all(value.problem == _NO_ANSWER for value in values[-SILENT_OBJECTS:]):
            raise DriveError(
                f"node {wire.node} on {wire.interface} {wire.channel} does not answer: check its power, its id and the "
                "bit rate; `stagectl doctor` looks at the bus",
                place=wire.channel,
                node=wire.node,
            )
    return values


_NO_ANSWER = "no answer"


def _variables(od: canopen.ObjectDictionary) -> Iterator[Any]:
    """All that has a value and may be read, by index and subindex."""
    for index in sorted(od):
        entry = od[index]
        members = [entry] if isinstance(entry, canopen.objectdictionary.ODVariable) else list(entry.values())
        yield from (variable for variable in members if variable.access_type != "wo")


def _entry(node: PumpedNode, variable: Any) -> ObjectValue:
    about = variable.index, variable.subindex, _name(variable), variable.access_type
    default = _plain(variable.default)
    try:
        raw = node.sdo.upload(variable.index, variable.subindex)
    except SdoAbortedError as error:
        return ObjectValue(*about, None, default, str(error))
    except SdoCommunicationError:
        return ObjectValue(*about, None, default, _NO_ANSWER)
    try:
        return ObjectValue(*about, _plain(variable.decode_raw(bytes(raw))), default, "")
    except (ValueError, UnicodeDecodeError) as error:
        return ObjectValue(*about, bytes(raw).hex(), default, f"not as its EDS says: {error}")


def _name(variable: Any) -> str:
    parent = variable.parent
    return variable.name if isinstance(parent, canopen.ObjectDictionary) else f"{parent.name}: {variable.name}"


def _plain(value: Any) -> int | float | str | None:
    """A value that fits JSON."""
    if isinstance(value, bytes | bytearray):
        return bytes(value).hex()
    return value if isinstance(value, int | float | str) or value is None else str(value)


DCF = "; written by stagectl"  # the first line of ours; a comment in CiA 306


def check_dcf(path: Path) -> None:
    """Raises StageError where `path` is no name of a DCF, or a file that is none of ours is there."""
    check_ending(path, ".dcf", "a DCF")
    check_replaceable(path, DCF)
    check_file_to_be(path)


def write_dcf(entries: list[ObjectValue], eds: str, node: int, path: Path) -> None:
    """The EDS with the values that were read, as a DCF (CiA 306): what other tools write back into a drive.

    Raises DriveError where the EDS cannot be read, StageError where another file than a DCF of ours is there.
    """
    check_dcf(path)
    dcf = configparser.RawConfigParser(interpolation=None)
    dcf.optionxform = str  # type: ignore[method-assign,assignment]  # keys keep their case
    try:
        dcf.read_string(Path(eds).read_text(encoding="utf-8-sig", errors="replace"))
    except (OSError, configparser.Error) as error:
        raise DriveError(f"eds = {eds}: {error}", place=eds) from error
    sections = {name.upper(): name for name in dcf.sections()}
    for entry in entries:
        index = f"{entry.number:04X}"
        name = sections.get(f"{index}SUB{entry.subindex:X}") or sections.get(index)
        if name is not None and entry.value is not None and not entry.problem:
            dcf.set(name, "ParameterValue", str(entry.value))
    if not dcf.has_section("DeviceComissioning"):  # spelled like this in CiA 306
        dcf.add_section("DeviceComissioning")
    dcf.set("DeviceComissioning", "NodeID", str(node))
    text = io.StringIO(f"{DCF}\n")
    text.seek(0, io.SEEK_END)
    dcf.write(text, space_around_delimiters=False)
    write_text(path, text.getvalue())
