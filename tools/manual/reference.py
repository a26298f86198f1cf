"""The reference pages of stage and trajectory files, from the types that the loader reads."""

from file_entries import Block, stage_blocks, trajectory_blocks

UNITS = (
    "Values carry their unit: `12 mm`, `40 Hz`, `0.72 N m/A`. Any unit of the same kind is accepted. Where two units "
    "are shown, the first is for a rotary axis and the second for a linear one. On an axis with a lead, a length may "
    "replace an angle. Ranges are in the unit shown. Unknown keys are errors. `stagectl config check FILE` reports all "
    "errors at once. `stagectl config schema` prints the same rules as a JSON schema for editors."
)
STAGE = f"""# The stage file

A stage file describes one machine: mechanics, friction, drive, encoder, controller and limits. This page lists every
entry, block by block.

{UNITS}

One file can hold several axes. Shared entries are at their usual places. The entries of each axis are under `axes`, by
dotted names: see `config/xy.yaml`. Every command takes `FILE.yaml#x` as the stage file of axis x."""
TRAJECTORY = f"""# The trajectory file

A trajectory file describes one motion, or one experiment. Its entry `type` says of which kind it is; this page lists
the entries of each type.

{UNITS}"""


def pages() -> dict[str, str]:
    """Markdown by file name."""
    return {
        "reference/stage.md": _page(STAGE, stage_blocks()),
        "reference/trajectory.md": _page(TRAJECTORY, trajectory_blocks()),
    }


def _page(head: str, blocks: list[Block]) -> str:
    return "\n\n".join([head, *map(_section, _alike(blocks))]) + "\n"


def _alike(blocks: list[Block]) -> list[list[Block]]:
    """Blocks with the same entries, to be shown once; one that several choices share is listed once."""
    alike: dict[tuple[str, object], dict[str, Block]] = {}
    for block in blocks:
        alike.setdefault((block.meaning, block.rows), {}).setdefault(_title(block), block)
    return [list(group.values()) for group in alike.values()]


def _title(block: Block) -> str:
    return " ".join(f"`{part}`" for part in (block.name, block.choice) if part) or "The file"


def _section(alike: list[Block]) -> str:
    block, *others = alike
    names = [_title(other._replace(name="") if other.name == block.name else other) for other in others]
    also = [f"{', '.join(names)}: the same entries.", ""] if others else []
    rows = [
        f"| `{row.key}` | {_cell(row.takes)} | {_cell(row.interval)} | {_cell(row.default)} | {_cell(row.meaning)} |"
        for row in block.rows
    ]
    table = ["| key | takes | range | default | meaning |", "|---|---|---|---|---|", *rows]
    return "\n".join([f"## {_title(block)}", "", block.meaning, "", *also, *(table if rows else [])])


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
