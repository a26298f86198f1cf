"""Short captures for the tests: our own simulated recordings, and folders that are changed on purpose."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import yaml
from numpy.typing import NDArray

from stagectl.api.record import MotionRecord
from stagectl.config.stage_file import load_stage
from stagectl.recording.exports import export, write_columns
from stagectl.recording.hdf5 import open_recording
from stagectl.workflows.motion import prepare
from stagectl.workflows.simulated_motion import pretend

CONFIG = Path(__file__).parents[2] / "config"
SINE = "type: sine\namplitude: 5 mm\nfrequency: 1.6 Hz\nperiods: 1\nramp: 0.5\n"
TRAPEZOID = "type: trapezoid\ndistance: 10 mm\nvelocity: 50 mm/s\nacceleration: 1 m/s^2\n"
LOGGED = {"time": "s", "reference": "rad", "command": "A", "measured": "rad", "measured_current": "A"}

Columns = dict[str, NDArray[np.float64]]


def recorded(folder: Path, text: str, repeats: int = 2, stage: str | Path = "ball-screw", **changes: Any) -> list[Path]:
    """Recordings of one trajectory, as `simulate` makes them; `without` names layers that are off."""
    folder.mkdir(parents=True, exist_ok=True)
    name = text.split("\n", 1)[0].split()[-1]
    trajectory = folder / f"{name}.yaml"
    trajectory.write_text(text)
    paths = [folder / f"{name}-{j + 1}.h5" for j in range(repeats)]
    setup = load_stage(stage if isinstance(stage, Path) else CONFIG / f"{stage}.yaml")
    for path in paths:
        pretend(prepare(setup, trajectory, changes.get("without", frozenset()), path))
    return paths


def exported(paths: list[Path], folder: Path, setpoints: bool = True) -> Path:
    """A folder of captures of them; without the setpoints of our own export, as from elsewhere."""
    export([open_recording(path) for path in paths], "folder", folder)
    if not setpoints:
        edit(folder / "captures.yaml", lambda values: [capture.pop("setpoints") for capture in values["captures"]])
    return folder


def as_csv(ran: MotionRecord, path: Path) -> Path:
    """A simulated motion as a log of another hand: five columns by name and unit."""
    header, rows = ",".join(f"{name}_{unit}" for name, unit in LOGGED.items()), [ran[name] for name in LOGGED]
    np.savetxt(path, np.column_stack(rows), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def edit(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change a YAML file in place."""
    answer = yaml.safe_load(path.read_text())
    change(answer)
    path.write_text(yaml.safe_dump(answer))


def rewrite(path: Path, change: Callable[[Columns], Columns]) -> None:
    """Change a capture's columns in place."""
    table = pyarrow.csv.read_csv(path)
    write_columns(path, change({name: table[name].to_numpy().astype(np.float64) for name in table.column_names}))
