"""What an export to another simulator gives."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from stagectl.interchange.round_trip import Compared
from stagectl.problem import ProblemKind
from stagectl.recording.file_lock import DataFileError


class ExportError(DataFileError):
    """A model that could not be written."""


class ExportedModel(NamedTuple):
    """The files, how far they are from ours there, and what they do not hold."""

    simulator: str  # that ran it: name and version
    files: tuple[Path, ...]
    variants: dict[str, list[Compared]]  # the three motions, by what was run; empty where it could not be run
    lost: list[str]
    notes: tuple[str, ...] = ()  # what else is to be known

    def worst(self) -> dict[str, tuple[float, float]]:
        """The largest difference of the three motions, by what was run: of the motion, and of the friction's effect."""
        return {
            name: (max(motion.of_motion for motion in each), max(motion.of_friction for motion in each))
            for name, each in self.variants.items()
        }


def write_texts(files: Mapping[Path, str]) -> None:
    """Write each file's text.

    Raises ExportError where one cannot be written.
    """
    for file, text in files.items():
        with ExportError.instead_of((OSError,), f"{file} cannot be written", file, ProblemKind.FILE):
            file.write_text(text, encoding="utf-8")
