"""Who the drive is (CiA 301, 0x1018), compared with the stage file and the EDS as CiA 302 does when a network boots."""

from __future__ import annotations

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.object_access import ObjectAccess
from stagectl.drives.canopen.protection import NOT_OFFERED
from stagectl.drives.drive import DriveError, Identity

_NAMES = {
    cia402.DEVICE_NAME: "device name",
    cia402.HARDWARE_VERSION: "hardware version",
    cia402.SOFTWARE_VERSION: "software version",
}
_SHOWN = {"serial": "serial number"}


def identify(objects: ObjectAccess, description: dict[str, str]) -> None:
    """Describe the drive.  Raises DriveError where it is another one than stage file or EDS say."""
    for subindex, name in enumerate(Identity._fields, start=1):
        value = objects.offered(cia402.IDENTITY, subindex)
        description[_SHOWN.get(name, name)] = NOT_OFFERED if value is None else f"0x{value:08X}"
        _compare(objects, name, subindex, value)
    for index, name in _NAMES.items():
        description[name] = str(objects.offered(index) or NOT_OFFERED)


def _compare(objects: ObjectAccess, name: str, subindex: int, value: int | None) -> None:
    stated = getattr(objects.settings.identity, name)
    eds = objects.node.object_dictionary.device_information
    written = {"vendor": eds.vendor_number, "product": eds.product_number}.get(name) or None  # 0: it does not say
    if stated is not None and value != stated:
        _refuse(objects, name, subindex, value, f"drive.wire.identity.{name} = 0x{stated:08X}", "the stage file")
    if stated is None and None not in (written, value) and value != written:
        _refuse(objects, name, subindex, value, f"0x{written:08X}", f"its EDS, {objects.settings.eds}")


def _refuse(objects: ObjectAccess, name: str, subindex: int, value: int | None, wanted: str, source: str) -> None:
    node = objects.settings.node
    shown = "not reported" if value is None else f"0x{value:08X}"
    raise DriveError(
        f"node {node}: {name} (0x1018:{subindex:02X}) is {shown}; {source} says {wanted}. Probable cause: another drive"
        f" stands in its place. Check its settings; then state drive.wire.identity.{name}: {shown}",
        place=f"drive.wire.identity.{name}",
        node=node,
        object_key=cia402.IDENTITY << 8 | subindex,
        value=value,
    )
