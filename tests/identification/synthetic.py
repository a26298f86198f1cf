"""A motion whose force is known in closed form: 20 mm of a ball screw with plain Coulomb friction."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stagectl.trajectories import Multisine

Array = NDArray[np.float64]
DT, ROWS = 0.5e-3, 20000
J, D, TC, KT = 0.011, 0.13, 0.9, 0.72  # near the stage file's, not its own


def motion(seed: int = 3) -> dict[str, Array]:
    """Columns of a recording, with 0.045 A of noise on the current and the encoder's steps."""
    time = np.arange(ROWS) * DT
    x, v, a = Multisine(10.0, 0.2, 2.0, base=5.0, periods=2.0).at(time)
    noise = np.random.default_rng(seed).normal(0.0, 0.045, ROWS)
    current = (J * a + D * v + TC * np.tanh(v / 0.05)) / KT + noise
    step = 2.0 * math.pi / 2**20
    columns = {"time": time, "reference": x, "measured": step * np.round(x / step), "measured_current": current}
    return {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}


def write_csv(path: Path, columns: dict[str, Array], header: str = "time_s,position_rad,current_A") -> Path:
    """Time, position and current as a log; an empty `header` writes none."""
    table = np.column_stack([columns[name] for name in ("time", "measured", "measured_current")])
    np.savetxt(path, table, delimiter=",", fmt="%.12g", header=header, comments="")
    if not header:
        path.write_text(path.read_text().lstrip("\n"))
    return path
