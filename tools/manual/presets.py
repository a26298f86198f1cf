"""The page of the drives, from the table of presets."""

from stagectl.drives.canopen.presets import PRESETS, Preset

HEAD = """# Drives

Which CANopen drives can stagectl use? A drive must offer **cyclic synchronous torque mode** (CiA 402, mode 10), latch
its position at SYNC, and let its PDOs be mapped. Its EDS or DCF file lists its objects. The stage file says which
object takes the current, and how large one count of it is. `stagectl drive probe` reads these two from the drive,
finds the family of the drive in the table below, and prints the lines for the stage file. `--write` puts them there:

```sh
stagectl drive probe config/ball-screw.yaml
stagectl drive presets
```

`probe` writes nothing to the drive and does not change its state. It compares the EDS that the stage file names with
the identity that the drive reports. Exit code 1 means that something needs your attention first.

> **Check the stop ramp.** Its unit (object 0x6085) differs from maker to maker: `drive.wire.deceleration_scale` says
> what one count of it is. With a wrong unit the drive brakes too slowly, or hardly at all. Option codes (0x605A,
> 0x605E, 0x6007) differ, too: stagectl reads them back at each start and shows them in words.

| preset | family | vendor | rated current from | status |
|---|---|---|---|---|
"""
ODRIVE = """
## Not CiA 402

An ODrive speaks its own protocol over a serial line (`kind: odrive`): see `config/odrive.yaml`. CANopen over slcan is
`interface: slcan` with a serial port as `channel`.
"""


def pages() -> dict[str, str]:
    """Markdown by file name."""
    table = "".join(f"{_row(preset)}\n" for preset in PRESETS)
    return {"drives.md": HEAD + table + "".join(_section(preset) for preset in PRESETS) + ODRIVE}


def _row(preset: Preset) -> str:
    vendor = "any" if preset.vendor is None else f"0x{preset.vendor:04X}"
    rated = f"0x{preset.rated >> 8:04X}:{preset.rated & 0xFF:02X}"
    return f"| [`{preset.name}`](#{preset.name}) | {preset.family} | {vendor} | {rated} | {preset.standing} |"


def _section(preset: Preset) -> str:
    lines = [f"\n## {preset.family} {{ #{preset.name} }}\n", f"*{preset.standing[0].upper()}{preset.standing[1:]}.*\n"]
    lines += [
        f"* Command 0x{preset.command_object >> 8:04X}, measured current 0x{preset.current_object >> 8:04X}, "
        f"per mille of the {preset.rated_words}."
    ]
    lines += [f"* {note}" for note in preset.notes]
    lines += ["", "Sources: " + "; ".join(preset.documents) + ".", ""]
    return "\n".join(lines)
