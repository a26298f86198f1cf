"""The FMU, checked by FMPy's validation and run by its master."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
from fmpy.validation import validate_fmu

from stagectl.config.stage_file import Setup
from stagectl.interchange.round_trip import Array, Simulated


def findings(path: Path) -> list[str]:
    """What FMPy's validation finds wrong with the FMU."""
    return [str(problem) for problem in validate_fmu(str(path))]


def simulated(setup: Setup, path: Path) -> Simulated:
    """What runs commands through the FMU `path`."""

    def run(current: Array) -> Array:
        found = fmpy.simulate_fmu(
            str(path), output_interval=setup.dt, stop_time=(len(current) - 1) * setup.dt,
            input=_signals(setup, current), output=["position"],
        )  # fmt: skip
        positions: Array = found["position"]
        assert len(positions) == len(current)
        return positions

    return run


def _signals(setup: Setup, current: Array) -> np.ndarray:
    """The inputs as FMPy takes them: commands that are held from their time on."""
    signals = np.zeros(len(current), dtype=[(name, np.float64) for name in ("time", "command", "added_current")])
    signals["time"] = np.arange(len(current)) * setup.dt
    signals["command"] = current
    return signals
