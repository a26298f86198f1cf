"""How far the gap closes, recomputed from the withheld runs: without noise, of the machine and of the nominal model.

    G^2 = mean (simulated - measured)^2 over the rows of all held-out captures
    closure = 1 - G_after^2 / G_before^2, factor = G_before / G_after

The withheld runs hold no noise, so that no floor is taken off.  The nominal model's run is the exam's own: its plant
with the values of nominal.yaml.  Rows before the axis has travelled `ZONE` are left out: no model can know the friction
that an earlier motion left.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pacsv

from stagectl_studies.machine.battery import UM
from stagectl_studies.machine.machine import Floats

ZONE = 60.0 * UM  # rad

Arrays = Mapping[str, Floats]


def column(path: Path, name: str) -> Floats:
    """One column of a CSV, (n,)."""
    return np.asarray(pacsv.read_csv(path).column(name).to_numpy(), dtype=np.float64)


def known_rows(position: Floats) -> slice:
    """Rows from where the axis has travelled `ZONE`."""
    gone = np.maximum.accumulate(position) - np.minimum.accumulate(position)
    beyond = np.flatnonzero(gone > ZONE)
    return slice(int(beyond[0]) if beyond.size else 0, None)


def held_out(truth: Mapping[str, Any], arrays: Arrays) -> list[str]:
    """Names of the held-out captures."""
    return [file for file in truth["noise_free"] if f"nominal/{first(file)}" in arrays]


def first(file: str) -> str:
    """The first repeat of a capture: ``held-micro-2.csv`` -> ``held-micro-1.csv``."""
    return f"{file.rsplit('-', 1)[0]}-1.csv"


def left(truth: Mapping[str, Any], arrays: Arrays, simulated: Mapping[str, Floats]) -> float:
    """Root mean square over all held-out captures of `simulated` (by file) less the withheld run, rad."""
    total, count = 0.0, 0
    for file in held_out(truth, arrays):
        clean = arrays[f"position/{truth['noise_free'][file]}"]
        rows = known_rows(clean)
        difference = (simulated[file] - clean)[rows]
        squares = float(np.sum(difference * difference))  # not @: BLAS adds in another order with more threads
        total, count = total + squares, count + difference.size
    return float(np.sqrt(total / max(count, 1)))


def predicted(folder: Path, files: list[str]) -> dict[str, Floats] | None:
    """Predicted positions by file, rad; None where one is missing or is no prediction."""
    try:
        positions = {file: column(folder / file, "position_rad") for file in files}
    except (OSError, KeyError, ValueError):
        return None
    return positions if all(np.isfinite(position).all() for position in positions.values()) else None


def gaps(truth: Mapping[str, Any], arrays: Arrays, folder: Path, captures: Path) -> dict[str, float | None]:
    """Gap before and after and the repeats' floor (rad), closure and factor; without predictions nothing closes."""
    files = held_out(truth, arrays)
    before = left(truth, arrays, {file: arrays[f"nominal/{first(file)}"] for file in files})
    simulated = predicted(folder, files)
    whole = {file: arrays[f"position/{truth['noise_free'][file]}"].size for file in files}
    fits = simulated is not None and all(simulated[file].size == whole[file] for file in files)
    after = left(truth, arrays, simulated) if simulated is not None and fits else before
    floor = left(truth, arrays, {file: column(captures / file, "position_rad") for file in files})
    closure = 1.0 - (after / before) ** 2 if before > 0.0 else None
    return {"before": before, "after": after, "floor": floor, "closure": closure}
