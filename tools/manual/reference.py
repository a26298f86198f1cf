"""The reference pages of stage and trajectory files, from the types that the loader reads."""

from __future__ import annotations

from stagectl.config.manual_reference import Block, stage_blocks, trajectory_blocks

UNITS = (
    "Values carry their unit: `12 mm`, `40 Hz`, `0.72 N m/A`; any unit of the same kind will do. Where two stand, "
    "the first is that of a rotary axis and the second that of a linear one; with a lead, a length may stand for an "
    "angle. Ranges are in the unit shown. Unknown keys are errors. `stagectl config check FILE` says all of them at "
    "once, `stagectl config schema` prints the same as a JSON schema for editors."
)


def pages() -> dict[str, str]:
    """Markdown by file name."""
    several = (
        "Several axes in one file: what they share stands where it always does, what is each axis' own under `axes`, "
        "by dotted names; `config/xy.yaml` is one. `FILE.yaml#x` is its axis x wherever a stage file is asked for."
    )
    stage = ["# The stage file", "One machine, from its mechanics to its bus.", UNITS, several]
    trajectory = ["# The trajectory file", "One motion or experiment; `type` says which.", UNITS]
    return {
        "reference/stage.md": "\n\n".join([*stage, *map(_block, _merged(stage_blocks()))]) + "\n",
        "reference/trajectory.md": "\n\n".join([*trajectory, *map(_block, trajectory_blocks())]) + "\n",
    }


def _merged(blocks: list[Block]) -> list[Block]:
    """A block that several choices share stands once."""
    found: dict[tuple[str, str, object], Block] = {}
    for one in blocks:
        found.setdefault((one.name, one.choice, one.rows), one)
    return list(found.values())


def _block(one: Block) -> str:
    title = " ".join(f"`{part}`" for part in (one.name, one.choice) if part) or "The file"
    rows = [
        f"| `{row.key}` | {_cell(row.takes)} | {_cell(row.interval)} | {_cell(row.default)} | {_cell(row.meaning)} |"
        for row in one.rows
    ]
    table = ["| key | takes | range | default | meaning |", "|---|---|---|---|---|", *rows]
    return "\n".join([f"## {title}", "", one.meaning, "", *(table if rows else [])])


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
