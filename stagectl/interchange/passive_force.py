"""Rolling friction of an exported stage in MuJoCo, exactly: stop operators as a passive force.

    import mujoco, NAME_friction
    model = mujoco.MjModel.from_xml_path("NAME.xml")
    NAME_friction.install(model)          # instead of the fitted bristles; once a process

Operator j holds ``s_j``, the displacement of its spring over its slip, within +- the Stribeck factor; the force on the
joint is ``- sum weight_j s_j``.  The states stand in ``data.userdata``: copies and resets of the data keep them right.
"""

from typing import Any

import mujoco
import numpy as np

WEIGHT: list[float] = []  # N m | N
SLIP: list[float] = []  # rad | m
START: list[float] = []  # states at rest, where they carry the constant effort on the axis
STRIBECK = (0.0, 1.0, 1.0)  # rise, velocity (rad/s | m/s), shape
FITTED = 1  # actuator group of the bristles that stand for these operators in the XML file


def install(model: Any) -> None:
    """Switch the bristles of `model` off and the operators on."""
    model.opt.disableactuator |= 1 << FITTED
    mujoco.set_mjcb_passive(passive)


def passive(model: Any, data: Any) -> None:
    """MuJoCo's callback: one step of the operators, for the joint's motion since the last one."""
    memory, count = data.userdata, len(WEIGHT)  # states, last position, whether there was one
    if not memory[count + 1]:
        memory[:] = *START, data.qpos[0], 1.0
    moved = data.qpos[0] - memory[count]
    rise, velocity, shape = STRIBECK
    limit = 1.0 + rise * np.exp(-((abs(data.qvel[0]) / velocity) ** shape))
    memory[:count] = np.clip(memory[:count] + moved / np.array(SLIP), -limit, limit)
    memory[count] = data.qpos[0]
    data.qfrc_passive[0] -= np.dot(WEIGHT, memory[:count])
