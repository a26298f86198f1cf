"""The reference pages of stage and trajectory files, from the types that the loader reads."""

from file_entries import Block, stage_blocks, trajectory_blocks

UNITS = (
    "Values carry their unit: `12 mm`, `40 Hz`, `0.72 N m/A`. Any unit of the same kind is accepted. Where two units "
    "are shown, the first is for a rotary axis and the second for a linear one. On an axis with a lead, a length may "
    "replace an angle. Ranges are in the unit shown. Unknown keys are errors. `stagectl config check FILE` reports all "
    "errors at once. `stagectl config schema` prints the same rules as a JSON schema for editors."
)


def pages() -> dict[str, str]:
    """Markdown by file name."""
    several = (
        "One file can hold several axes. Shared entries are at their usual places. The entries of each axis are under "
        "`axes`, by dotted names: see `config/xy.yaml`. Every command takes `FILE.yaml#x` as the stage file of axis x."
    )
    stage = ["# The stage file", "One machine, from its mechanics to its bus.", UNITS, several]
    trajectory = ["# The trajectory file", "One motion or experiment; `type` says which.", UNITS]
    return {
        "reference/stage.md": "\n\n".join([*stage, *map(_block, _merged(stage_blocks()))]) + "\n",
        "reference/trajectory.md": "\n\n".join([*trajectory, *map(_block, trajectory_blocks())]) + "\n",
    }


def _merged(blocks: list[Block]) -> list[Block]:
    """A block that several choices share stands once."""
    distinct: dict[tuple[str, str, object], Block] = {}
    for block in blocks:
        distinct.setdefault((block.name, block.choice, block.rows), block)
    return list(distinct.values())


def _block(block: Block) -> str:
    title = " ".join(f"`{part}`" for part in (block.name, block.choice) if part) or "The file"
    rows = [
        f"| `{row.key}` | {_cell(row.takes)} | {_cell(row.interval)} | {_cell(row.default)} | {_cell(row.meaning)} |"
        for row in block.rows
    ]
    table = ["| key | takes | range | default | meaning |", "|---|---|---|---|---|", *rows]
    return "\n".join([f"## {title}", "", block.meaning, "", *(table if rows else [])])


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
