"""The exported MuJoCo files, run by MuJoCo itself."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.interchange.round_trip import Array, Simulated


def simulated(setup: Setup, xml: Path, callback: Path | None = None) -> Simulated:
    """What runs commands through the model of the file `xml`, with the passive force of `callback`."""

    def run(current: Array) -> Array:
        model = mujoco.MjModel.from_xml_path(str(xml))
        try:
            if callback is not None:
                _loaded(callback).install(model)
            return _positions(model, current, round(setup.dt / model.opt.timestep))
        finally:
            mujoco.set_mjcb_passive(None)

    return run


def _positions(model: Any, current: Array, steps: int) -> Array:
    data, found = mujoco.MjData(model), np.empty(len(current))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for k, command in enumerate(current):
        found[k], data.ctrl[0] = data.qpos[0], command
        mujoco.mj_step(model, data, steps)
    return found


def _loaded(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
