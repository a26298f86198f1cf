"""A stage as a MuJoCo model, tried there at once."""

import importlib.util
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.interchange import mujoco_model
from stagectl.interchange.export import ExportedModel, lost, write_texts
from stagectl.interchange.mujoco_model import GAUSSIAN
from stagectl.interchange.round_trip import Array, Simulated, compared


def to_mujoco(setup: Setup, path: Path) -> ExportedModel:
    """Write the MJCF file `path` and, for stop operators, the passive force beside it; run both in MuJoCo.

    Raises ExportError where a file cannot be written.
    """
    friction = path.with_name(f"{path.stem.replace('-', '_')}_friction.py")
    exact = mujoco_model.operators(setup.stage)
    files = {path: mujoco_model.model(setup)} | ({friction: mujoco_model.callback(setup.stage)} if exact else {})
    write_texts(files)
    variants = {path.name: compared(setup, simulated(setup, path))}
    if exact:
        variants[f"{path.name} with {friction.name}"] = compared(setup, simulated(setup, path, friction))
    losses = [*lost(setup, mujoco_model.HELD), *_shapes(setup)]
    return ExportedModel(f"MuJoCo {mujoco.__version__}", tuple(files), variants, losses)


def _shapes(setup: Setup) -> list[str]:
    """Shapes of the friction that the file has in another form."""
    p, words = setup.stage.friction, []
    if mujoco_model.operators(setup.stage):
        words.append(
            "friction: stop operators, which the XML file alone has as fitted bristles; the Python file has them"
        )
    for stribeck in (p.stribeck, p.bristle.stribeck):
        if stribeck.rise and stribeck.shape != GAUSSIAN:
            words.append(f"friction.stribeck.shape = {stribeck.shape:g}: the XML file has a fitted Gaussian, shape 2")
    if p.bristle.coulomb and p.bristle.exponent != 1.0:
        words.append(f"friction.exponent = {p.bristle.exponent:g}: in the XML file the approach is exponential, 1")
    return words


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
