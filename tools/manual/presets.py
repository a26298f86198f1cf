"""The page of the drives, from the table of presets."""

from __future__ import annotations

from stagectl.drives.canopen.presets import PRESETS, Preset

HEAD = """# Drives

A drive must offer **cyclic synchronous torque mode** (CiA 402, mode 10), a position latched at SYNC, and mappable PDOs.
Its EDS or DCF file says where the objects are; the stage file says which one takes the current, and what a count is.
`stagectl drive probe` reads that from the drive, finds its family below, and prints the lines; `--write` keeps them:

```sh
stagectl drive probe config/ball-screw.yaml
stagectl drive presets
```

Nothing is written to the drive, no state is changed. The EDS that the stage file names is compared with what the drive
says of itself. Exit code 1: something must be looked at first.

!!! warning "Read, never assumed"
    Option codes (0x605A, 0x605E, 0x6007) differ by maker: they are read back at each start, and shown in words. The
    unit of the stop ramp 0x6085 differs, too: `drive.wire.deceleration_scale` says what one count of it is. In a wrong
    unit, a stop does not stop.

| preset | family | vendor | rated current from | standing |
|---|---|---|---|---|
"""
ODRIVE = """
## Not CiA 402

An ODrive speaks its own protocol over a serial line (`kind: odrive`): see `config/odrive.yaml`. CANopen over slcan is
`interface: slcan` with a serial port as `channel`.
"""


def pages() -> dict[str, str]:
    """Markdown by file name."""
    table = "".join(f"{_row(one)}\n" for one in PRESETS)
    return {"drives.md": HEAD + table + "".join(_section(one) for one in PRESETS) + ODRIVE}


def _row(one: Preset) -> str:
    vendor = "any" if one.vendor is None else f"0x{one.vendor:04X}"
    rated = f"0x{one.rated >> 8:04X}:{one.rated & 0xFF:02X}"
    return f"| [`{one.name}`](#{one.name}) | {one.family} | {vendor} | {rated} | {one.standing} |"


def _section(one: Preset) -> str:
    lines = [f"\n## {one.family} {{ #{one.name} }}\n", f"*{one.standing[0].upper()}{one.standing[1:]}.*\n"]
    lines += [
        f"* Command 0x{one.command_object >> 8:04X}, measured current 0x{one.current_object >> 8:04X}, "
        f"per mille of the {one.rated_words}."
    ]
    lines += [f"* {note}" for note in one.notes]
    lines += ["", "Sources: " + "; ".join(one.documents) + ".", ""]
    return "\n".join(lines)
