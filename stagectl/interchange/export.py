"""The simulators that a stage can be exported to."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.extras import require
from stagectl.interchange.exported import ExportedModel
from stagectl.units import StageError


class Simulator(NamedTuple):
    """One of them."""

    called: str  # what its file is
    suffix: str  # of that file
    extra: str  # of pyproject.toml, without which nothing can be written; empty: none
    write: Callable[[Setup, Path], ExportedModel]  # the model to this file, run there where it can be

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
        return path


def _mujoco(setup: Setup, path: Path) -> ExportedModel:
    from stagectl.interchange.mujoco_export import to_mujoco

    return to_mujoco(setup, path)


def _fmu(setup: Setup, path: Path) -> ExportedModel:
    from stagectl.interchange.fmu.export import to_fmu

    return to_fmu(setup, path)


def _isaac(setup: Setup, path: Path) -> ExportedModel:
    from stagectl.interchange.isaac.export import to_isaac

    return to_isaac(setup, path)


SIMULATORS = {
    "mujoco": Simulator("a MuJoCo model", ".xml", "mujoco", _mujoco),
    "fmu": Simulator("an FMU", ".fmu", "fmu", _fmu),
    "isaac": Simulator("a configuration of Isaac Lab", ".py", "", _isaac),
}
