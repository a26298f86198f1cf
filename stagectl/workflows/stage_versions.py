"""Versions of a stage file, with the pages that tell why each was left: a change of the machine's model can go back.

::

    STAGE.yaml      STAGE.versions/1/STAGE.yaml, closed.html      STAGE.versions/2/STAGE.yaml, ...
"""

import shutil
from collections.abc import Iterable
from pathlib import Path

from stagectl.config.patch import replace_file
from stagectl.config.stage_file import load_stage
from stagectl.units import StageError


def replaced(stage: Path, text: str, pages: Iterable[Path] = ()) -> Path:
    """Give the stage file a new `text`; what it was is kept with the `pages` that say why.  Returns where.

    Raises ConfigError where the stage would be refused: nothing is changed then.
    """
    before = stage.read_bytes()
    replace_file(stage, text.encode(), lambda written: load_stage(written))
    place = _folder(stage) / str(len(_versions(stage)) + 1)
    place.mkdir(parents=True)
    (place / stage.name).write_bytes(before)
    for page in pages:
        shutil.copy2(page, place / page.name)
    return place


def back(stage: Path) -> Path:
    """Put the last version back in the place of the stage file; where it stood.  Raises StageError without one."""
    versions = _versions(stage)
    if not versions:
        reason = f"{stage} has no earlier version: {_folder(stage)} is empty or not there"
        raise StageError(f"{reason}; the stage file is as it was")
    shutil.copy2(versions[-1] / stage.name, stage)
    shutil.rmtree(versions[-1])
    return versions[-1]


def first(stage: Path) -> str:
    """The text of the oldest version that is kept; of the stage file itself where there is none."""
    versions = _versions(stage)
    return ((versions[0] / stage.name) if versions else stage).read_text(encoding="utf-8")


def _folder(stage: Path) -> Path:
    return stage.with_suffix(".versions")


def _versions(stage: Path) -> list[Path]:
    """The folders of all versions, the last one last."""
    return sorted((path for path in _folder(stage).glob("*") if path.name.isdecimal()), key=lambda path: int(path.name))
