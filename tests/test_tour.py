"""The tour and the drawing of the architecture name only what exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import stagectl
from tests.conftest import ROOT

PACKAGE = Path(stagectl.__file__).parent
ROOMS = {path.name for path in PACKAGE.iterdir() if path.is_dir()}
_PATH = re.compile(r"(?<![\w/.-])(?:stagectl/)?((?:tools|systemd|[a-z_]+)/[a-z_./0-9-]*[a-z_])")


def named(text: str) -> set[str]:
    """Paths in `text` that begin with a room of the package or a folder of the checkout."""
    paths = {match.rstrip("./") for match in _PATH.findall(text)}
    return {path for path in paths if path.split("/")[0] in ROOMS | {"tools", "systemd", "config"}}


def exists(path: str) -> bool:
    """Whether the package or the checkout has this file, module or folder."""
    places = (PACKAGE / path, PACKAGE / f"{path}.py", ROOT / path, ROOT / f"{path}.py")
    return any(place.exists() for place in places)


@pytest.mark.parametrize(
    "text",
    [stagectl.__doc__ or "", (ROOT / "docs/architecture.md").read_text(encoding="utf-8")],
    ids=["tour", "drawing"],
)
def test_what_is_named_exists(text: str) -> None:
    paths = named(text)
    assert len(paths) > 15
    assert sorted(path for path in paths if not exists(path)) == []


def test_every_room_is_in_the_table_of_the_architecture() -> None:
    table = (ROOT / "docs/architecture.md").read_text(encoding="utf-8").split("## Packages")[1].split("\n## ")[0]
    rows = set(
        re.findall(
            r"`([a-z_/]+)`", " ".join(line.split("|")[1] for line in table.splitlines() if line.startswith("| `"))
        )
    )
    modules = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__", "__main__"}
    rooms = {room for room in ROOMS if (PACKAGE / room / "__init__.py").exists()}
    assert (rooms | modules) - rows == set()
    assert rows - rooms - modules == {"tools/studies", "api"} - rooms
