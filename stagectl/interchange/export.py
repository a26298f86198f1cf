"""The simulators that a stage can be exported to, what an export gives, and what a format cannot hold."""

import importlib
import re
from collections.abc import Iterator, Mapping, Set
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.extras import require
from stagectl.interchange.round_trip import Compared
from stagectl.problem import ProblemKind
from stagectl.recording.file_lock import DataFileError
from stagectl.replacing import check_replaceable, write_text
from stagectl.units import StageError, quantities_of


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

    Raises ExportError where one cannot be written, StageError where a file is there that begins differently.
    """
    for file, text in files.items():
        check_replaceable(file, text.splitlines()[0], "is no export of this stage")
    for file, text in files.items():
        with ExportError.instead_of((OSError,), f"{file} cannot be written", file, ProblemKind.FILE):
            write_text(file, text)


class Simulator(NamedTuple):
    """One of them."""

    called: str  # what its file is
    suffix: str  # of that file
    extra: str  # of pyproject.toml, without which nothing can be written; empty: none
    place: str  # module and function that write it

    def write(self, setup: Setup, path: Path) -> ExportedModel:
        """The model to this file, run there where it can be."""
        module, function = self.place.split(":")
        exported: ExportedModel = getattr(importlib.import_module(f"{__package__}.{module}"), function)(setup, path)
        return exported

    def file(self, stage: Path, output: Path | None) -> Path:
        """Where the model of a stage file goes, once what it needs is there.

        Raises MissingExtraError, and StageError for an `output` with another suffix.
        """
        if self.extra:
            require(self.extra, f"{self.called}, which is tried at once,")
        name = stage.name.replace(".yaml", "").replace("#", "-")
        path = output or Path(f"{name.replace('-', '_') if self.suffix == '.py' else name}{self.suffix}")
        if path.suffix != self.suffix:
            raise StageError(f"{path}: {self.called} ends in {self.suffix}: take -o {path.with_suffix(self.suffix)}")
        if self.suffix == ".py" and not path.stem.isidentifier():
            meant = path.with_stem(re.sub(r"\W|^(?=\d)", "_", path.stem))
            raise StageError(f"{path}: Python cannot import a module of this name: take -o {meant}")
        return path


SIMULATORS = {
    "mujoco": Simulator("a MuJoCo model", ".xml", "mujoco", "mujoco_model:to_mujoco"),
    "fmu": Simulator("an FMU", ".fmu", "fmu", "fmu.archive:to_fmu"),
    "isaac": Simulator("a configuration of Isaac Lab", ".py", "", "isaac_lab:to_isaac"),
}


_NEUTRAL = {"current_quantum": 0.0, "current_lag": 0.0, "delay_samples": 0, "step": 0.0}  # of entries without a default


def lost(setup: Setup, held: Mapping[str, Set[str]]) -> list[str]:
    """Entries that are not neutral and not in `held`, by block: value, unit and meaning; and a residual table."""
    words = [each for block in held for each in _lost(setup, block, held[block])]
    if (table := setup.file.residual) is not None:
        words.append(f"residual: a table of {len(table.values)} values over {table.coordinate}")
    return words


def _lost(setup: Setup, block: str, held: Set[str]) -> Iterator[str]:
    part = getattr(setup.stage, block)
    quantities = quantities_of(type(part))
    for name, value in part._asdict().items():
        neutral = part._field_defaults.get(name, _NEUTRAL.get(name))
        if name not in held and value != neutral:
            quantity = quantities.get(name)
            meaning = (
                f" {quantity.unit_for(setup.file.axis.kind)}".rstrip() + f": {quantity.meaning}" if quantity else ""
            )
            yield f"{block}.{name} = {_shown(value)}{meaning}"


def _shown(value: Any) -> str:
    if hasattr(value, "_asdict"):
        return ", ".join(f"{name} {_shown(part)}" for name, part in value._asdict().items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)
