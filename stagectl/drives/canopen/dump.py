"""All objects of a drive that its EDS knows, read over SDO: what it is set to, for a file next to the stage file.

Nothing is written to the drive.  A refused object is reported with its abort code, and the next one is read.
"""

from __future__ import annotations

import configparser
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.drives.bus.frames import Bus
from stagectl.drives.canopen.library import SdoAbortedError, SdoCommunicationError, canopen
from stagectl.drives.canopen.network import Network, Partner, load_eds
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, DriveError

_ANSWER_TIME = 0.5  # s for one answer
_SILENT = 3  # objects in a row without an answer: nobody is there
Progress = Callable[[int, int], None]


class Entry(NamedTuple):
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
        """Whether it is not as the EDS says that it leaves the factory."""
        return self.value is not None and self.default is not None and self.value != self.default


def dump(wire: Canopen, bus: Bus, progress: Progress = lambda *_: None, clock: Clock = WALL) -> list[Entry]:
    """Read all readable objects of the node of `wire`.

    Raises DriveError where it does not answer.
    """
    od = load_eds(wire.eds, wire.node)
    network = Network(bus, clock)
    node = Partner(wire.node, od)
    network[wire.node] = node
    node.sdo.RESPONSE_TIMEOUT = _ANSWER_TIME
    variables = list(_variables(od))
    found: list[Entry] = []
    for number, variable in enumerate(variables):
        found.append(_entry(node, variable))
        progress(number + 1, len(variables))
        if len(found) >= _SILENT and all(one.problem == _NO_ANSWER for one in found[-_SILENT:]):
            raise DriveError(
                f"node {wire.node} on {wire.interface} {wire.channel} does not answer: check its power, its id and the "
                "bit rate; `stagectl doctor` looks at the bus"
            )
    return found


_NO_ANSWER = "no answer"


def _variables(od: canopen.ObjectDictionary) -> Iterator[Any]:
    """All that has a value and may be read, by index and subindex."""
    for index in sorted(od):
        entry = od[index]
        members = [entry] if isinstance(entry, canopen.objectdictionary.ODVariable) else list(entry.values())
        yield from (one for one in members if one.access_type != "wo")


def _entry(node: Partner, variable: Any) -> Entry:
    about = variable.index, variable.subindex, _name(variable), variable.access_type
    default = _plain(variable.default)
    try:
        raw = node.sdo.upload(variable.index, variable.subindex)
    except SdoAbortedError as error:
        return Entry(*about, None, default, str(error))
    except SdoCommunicationError:
        return Entry(*about, None, default, _NO_ANSWER)
    try:
        return Entry(*about, _plain(variable.decode_raw(bytes(raw))), default, "")
    except (ValueError, UnicodeDecodeError) as error:
        return Entry(*about, bytes(raw).hex(), default, f"not as its EDS says: {error}")


def _name(variable: Any) -> str:
    parent = variable.parent
    return variable.name if isinstance(parent, canopen.ObjectDictionary) else f"{parent.name}: {variable.name}"


def _plain(value: Any) -> int | float | str | None:
    """A value that fits JSON."""
    if isinstance(value, bytes | bytearray):
        return bytes(value).hex()
    return value if isinstance(value, int | float | str) or value is None else str(value)


def write_dcf(entries: list[Entry], eds: str, node: int, path: Path) -> None:
    """The EDS with the values that were read, as a DCF (CiA 306): what other tools write back into a drive.

    Raises DriveError where the EDS cannot be read.
    """
    lines = configparser.RawConfigParser(interpolation=None)
    lines.optionxform = str  # type: ignore[method-assign,assignment]  # keys keep their case
    try:
        lines.read_string(Path(eds).read_text(encoding="utf-8-sig", errors="replace"))
    except (OSError, configparser.Error) as error:
        raise DriveError(f"eds = {eds}: {error}") from error
    sections = {name.upper(): name for name in lines.sections()}
    for one in entries:
        plain = f"{one.number:04X}"
        name = sections.get(f"{plain}SUB{one.subindex:X}") or sections.get(plain)
        if name is not None and one.value is not None and not one.problem:
            lines.set(name, "ParameterValue", str(one.value))
    if not lines.has_section("DeviceComissioning"):  # spelled like this in CiA 306
        lines.add_section("DeviceComissioning")
    lines.set("DeviceComissioning", "NodeID", str(node))
    text = io.StringIO()
    lines.write(text, space_around_delimiters=False)
    path.write_text(text.getvalue(), encoding="utf-8")
