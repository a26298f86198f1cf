"""The object dictionary of the foreign drives as a table, and the EDS file made from it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tests.zoo.plant import COUNTS, RATED_CURRENT
from tests.zoo.variants import PDO_LOST, Object, Variant

_TYPES = {"i8": 2, "i16": 3, "i32": 4, "u8": 5, "u16": 6, "u32": 7, "str": 9}


def _simple(*rows: tuple[int, str, str, str, int | str]) -> list[Object]:
    return [Object(index << 8, name, kind, access, value) for index, name, kind, access, value in rows]


def _record(index: int, name: str, *rows: tuple[int, str, str, str, int]) -> list[Object]:
    count = max(sub for sub, *_ in rows)
    first = [] if rows[0][0] == 0 else [Object(index << 8, "Highest sub-index", "u8", "const", count, True)]
    return first + [
        Object(index << 8 | sub, f"{name} {title}", kind, access, value, True)
        for sub, title, kind, access, value in rows
    ]


def _pdo(index: int, mapping: int, name: str, cob_id: int, mapped: tuple[int, ...]) -> list[Object]:
    parameters = _record(
        index, name, (1, "COB-ID", "u32", "rw", cob_id), (2, "transmission", "u8", "rw", 255),
        (3, "inhibit", "u16", "rw", 0), (5, "timer", "u16", "rw", 0),
    )  # fmt: skip
    entries = [(0, "count", "u8", "rw", len(mapped))]
    entries += [(n, f"entry {n}", "u32", "rw", entry(mapped[n - 1]) if n <= len(mapped) else 0) for n in range(1, 5)]
    return parameters + _record(mapping, f"{name} map", *entries)


WIDTHS = {0x604000: 16, 0x604100: 16, 0x606000: 8, 0x606100: 8, 0x606400: 32, 0x606C00: 32, 0x607100: 16, 0x607700: 16}
WIDTHS |= {0x234000: 32}


def entry(key: int) -> int:
    """Mapping entry of an object: index, subindex, bits."""
    return key << 8 | WIDTHS[key]


def objects(variant: Variant, node: int) -> list[Object]:
    """All entries, with the values after boot."""
    table = [
        *_communication(node),
        *_pdos(variant, node),
        *_profile(),
        *(_homing() if variant.homing not in ("", "absent") else ()),
        *variant.more,
    ]
    return [row._replace(value=variant.values.get(row.key, row.value)) for row in table]


def _communication(node: int) -> list[Object]:
    return [
        *_simple(
            (0x1000, "Device type", "u32", "ro", 0x0002_0192), (0x1001, "Error register", "u8", "ro", 0),
            (0x1005, "COB-ID SYNC", "u32", "rw", 0x80), (0x1006, "Communication cycle period", "u32", "rw", 0),
            (0x1008, "Device name", "str", "const", "Foreign servo"), (0x1009, "Hardware", "str", "const", "B"),
            (0x100A, "Software", "str", "const", "2.11"), (0x100C, "Guard time", "u16", "rw", 0),
            (0x100D, "Life time factor", "u8", "rw", 0), (0x1014, "COB-ID EMCY", "u32", "ro", 0x80 + node),
            (0x1017, "Producer heartbeat", "u16", "rw", 0),
        ),
        *_record(0x1003, "Errors", (0, "count", "u8", "rw", 0), (1, "last", "u32", "ro", 0)),
        *_record(0x1016, "Consumer heartbeat", (1, "1", "u32", "rw", 0), (2, "2", "u32", "rw", 0)),
        *_record(
            0x1018, "Identity", (1, "vendor", "u32", "const", 0x0000_02E1), (2, "product", "u32", "const", 0x0005_0402),
            (3, "revision", "u32", "const", 0x0002_000B), (4, "serial", "u32", "ro", 774_411),
        ),
        *_record(0x1029, "Error behaviour", (1, "communication", "u8", "rw", 0)),
    ]  # fmt: skip


def _pdos(variant: Variant, node: int) -> list[Object]:
    off = PDO_LOST + node
    return [
        *_pdo(0x1400, 0x1600, "RPDO 1", 0x200 + node, variant.rpdo), *_pdo(0x1401, 0x1601, "RPDO 2", 0x300 + off, ()),
        *_pdo(0x1800, 0x1A00, "TPDO 1", 0x4000_0180 + node, variant.tpdo),
        *_pdo(0x1801, 0x1A01, "TPDO 2", 0x4000_0280 + (0 if variant.extra_pdos else PDO_LOST) + node,
              (0x606400, 0x606C00) if variant.extra_pdos else ()),
    ]  # fmt: skip


def _profile() -> list[Object]:
    return [
        *_simple(
            (0x6007, "Abort connection option", "i16", "rw", 1), (0x603F, "Error code", "u16", "ro", 0),
            (0x6040, "Controlword", "u16", "rw", 0), (0x6041, "Statusword", "u16", "ro", 0),
            (0x605A, "Quick stop option", "i16", "rw", 2), (0x605B, "Shutdown option", "i16", "rw", 0),
            (0x605C, "Disable option", "i16", "rw", 1), (0x605E, "Fault reaction option", "i16", "rw", 2),
            (0x6060, "Mode", "i8", "rw", 0), (0x6061, "Mode display", "i8", "ro", 0),
            (0x6064, "Position", "i32", "ro", 0), (0x6065, "Following window", "u32", "rw", 2000),
            (0x606C, "Velocity", "i32", "ro", 0), (0x6071, "Target torque", "i16", "rw", 0),
            (0x6072, "Max torque", "u16", "rw", 1600), (0x6073, "Max current", "u16", "rw", 1600),
            (0x6075, "Rated current", "u32", "rw", round(1000 * RATED_CURRENT)),
            (0x6076, "Rated torque", "u32", "rw", 500), (0x6077, "Torque", "i16", "ro", 0),
            (0x607E, "Polarity", "u8", "rw", 0), (0x6080, "Max motor speed", "u32", "rw", 6000),
            (0x6085, "Quick stop deceleration", "u32", "rw", 100_000), (0x6087, "Torque slope", "u32", "rw", 100_000),
            (0x6502, "Supported modes", "u32", "ro", 0x0000_0200),
        ),
        *_record(0x608F, "Encoder", (1, "increments", "u32", "rw", COUNTS), (2, "revolutions", "u32", "rw", 1)),
        *_record(0x60C2, "Interpolation time", (1, "value", "u8", "rw", 1), (2, "index", "i8", "rw", -3)),
    ]  # fmt: skip


def _homing() -> list[Object]:
    return [
        *_simple(
            (0x607C, "Home offset", "i32", "rw", 0), (0x6098, "Homing method", "i8", "rw", 1),
            (0x609A, "Homing acceleration", "u32", "rw", 1000),
        ),
        *_record(0x6099, "Homing speeds", (1, "switch", "u32", "rw", 100), (2, "zero", "u32", "rw", 10)),
    ]  # fmt: skip


def eds(variant: Variant, node: int) -> str:
    """The text of its EDS file: the maker's view, which may differ from what the drive holds."""
    table = objects(replace(variant, values={}), node)
    table = [row._replace(access="ro") if row.key in variant.read_only else row for row in table]
    lines = ["[FileInfo]", "FileName=zoo.eds", "EDSVersion=4.0", "", "[DeviceInfo]", "VendorNumber=0x2E1",
             "ProductNumber=0x50402", "RevisionNumber=0x2000B", "BaudRate_1000=1", "NrOfRXPDO=2", "NrOfTXPDO=2",
             "Granularity=8", *_lists(sorted({row.key >> 8 for row in table}))]  # fmt: skip
    for row in table:
        lines += _entry(row, table)
    return "\n".join(lines) + "\n"


def _lists(indices: list[int]) -> list[str]:
    mandatory = [index for index in indices if index in (0x1000, 0x1001, 0x1018)]
    rest = [index for index in indices if index not in mandatory]
    lines = []
    for title, group in (("MandatoryObjects", mandatory), ("OptionalObjects", rest), ("ManufacturerObjects", [])):
        lines += ["", f"[{title}]", f"SupportedObjects={len(group)}"]
        lines += [f"{n}=0x{index:04X}" for n, index in enumerate(group, 1)]
    return lines


def _entry(row: Object, table: list[Object]) -> list[str]:
    index, sub = row.key >> 8, row.key & 0xFF
    lines = _heading(row, table) if row.record and sub == 0 else []
    title = f"{index:04X}sub{sub:X}" if row.record else f"{index:04X}"
    return [
        *lines,
        "",
        f"[{title}]",
        f"ParameterName={row.name}",
        "ObjectType=0x7",
        f"DataType=0x{_TYPES[row.type]:04X}",
        f"AccessType={row.access}",
        f"DefaultValue={row.value}",
        f"PDOMapping={int(row.key in WIDTHS)}",
    ]


def _heading(row: Object, table: list[Object]) -> list[str]:
    index = row.key >> 8
    count = sum(1 for other in table if other.key >> 8 == index)
    return ["", f"[{index:04X}]", f"ParameterName=Object {index:04X}", "ObjectType=0x9", f"SubNumber={count}"]


def write_eds(path: Path, variant: Variant, node: int) -> Path:
    """The EDS file at `path`."""
    path.write_text(eds(variant, node))
    return path
