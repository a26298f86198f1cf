"""Ways in which programs spoil their logs: each takes time, position and current, and gives them back spoilt."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Columns = dict[str, Array]
HEADER = "time_s,position_rad,current_A"


def motion(rate: float = 2000.0, counts: int = 1 << 16, seconds: float = 6.0) -> Columns:
    """Two sines, the faster one of the acceleration that a stage has, seen by an encoder of `counts` a turn."""
    time = np.arange(round(seconds * rate)) / rate
    angle = 8.0 * np.sin(2.0 * math.pi * 0.7 * time) + 0.9 * np.sin(2.0 * math.pi * 3.1 * time)
    speed = np.gradient(angle, time)
    noise = np.random.default_rng(7).normal(0.0, 0.02, len(time))
    current = 0.02 * np.gradient(speed, time) + 0.1 * speed + 0.8 * np.tanh(speed / 0.1) + noise
    step = 2.0 * math.pi / counts
    return {"time": time, "position": step * np.round(angle / step), "current": current}


def write(path: Path, columns: Columns, header: str = HEADER, end: str = "") -> Path:
    """A CSV with a header; `end` follows its last row."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", fmt="%.12g", header=header, comments="")
    path.write_text(path.read_text() + end)
    return path


def wrapped(columns: Columns, size: float) -> Columns:
    """Positions within half of `size` either way, as a counter of that range holds them."""
    x = columns["position"]
    return {**columns, "position": x - size * np.floor(x / size + 0.5)}


def spiked(columns: Columns, name: str, rows: list[int], size: float) -> Columns:
    """Single values that were misread."""
    spoilt = columns[name].copy()
    spoilt[rows] += size
    return {**columns, name: spoilt}


def rounded(columns: Columns, clock: float) -> Columns:
    """Time stamps cut to multiples of `clock` (s)."""
    return {**columns, "time": clock * np.floor(columns["time"] / clock + 1e-6)}


def jittered(columns: Columns, share: float) -> Columns:
    """Rows taken up to `share` of a period early or late, as a polling program takes them."""
    time = columns["time"]
    real = time + share * (time[1] - time[0]) * np.random.default_rng(3).uniform(-1.0, 1.0, len(time))
    return {name: real if name == "time" else np.interp(real, time, column) for name, column in columns.items()}
