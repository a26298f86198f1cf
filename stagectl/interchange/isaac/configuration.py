"""The Python file with the actuator's configuration: written, checked, and read back.

Isaac Lab is on no package index, so an export is checked against the table below instead of the class.  Isaac Lab
3.0.0, read on 2026-11-25: https://isaac-sim.github.io/IsaacLab/release/3.0.0/_modules/isaaclab/actuators/actuator_base_cfg.html
and .../actuator_pd_cfg.html.  Version 2.3 has the same names but for `actuator_effort_limit`, there `effort_limit`.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.interchange.export import ExportError
from stagectl.kernels import stage
from stagectl.kernels.plant import Friction, Stage

VERSION = "3.0.0"
MODULE, CLASS = "isaaclab.actuators", "DelayedPDActuatorCfg"
NUMBERS = (float, dict, type(None))
FIELDS: dict[str, tuple[type, ...]] = {  # types of each field
    "class_type": (type, str),
    "joint_names_expr": (list,),
    "actuator_effort_limit": NUMBERS,  # N m | N, at which the actuator's effort is clipped
    "actuator_velocity_limit": NUMBERS,
    "joint_effort_limit": NUMBERS,
    "joint_velocity_limit": NUMBERS,
    "stiffness": NUMBERS,  # N m/rad | N/m
    "damping": NUMBERS,  # N m s/rad | N s/m
    "armature": NUMBERS,  # kg m^2 | kg, added to the joint's inertia
    "friction": NUMBERS,  # N m | N, static
    "dynamic_friction": NUMBERS,  # N m | N
    "viscous_friction": NUMBERS,  # N m s/rad | N s/m
    "min_delay": (int,),  # physics steps
    "max_delay": (int,),
}
REQUIRED = ("joint_names_expr", "stiffness", "damping")


def check(entries: Mapping[str, Any]) -> None:
    """Whether the class takes these entries.

    Raises ExportError for a name that it does not have, a value of another type, and a required one that is missing.
    """
    for name, value in entries.items():
        if name not in FIELDS:
            raise ExportError(f"{CLASS} of Isaac Lab {VERSION} has no field {name}")
        if not isinstance(value, FIELDS[name]):
            kinds = " or ".join(kind.__name__ for kind in FIELDS[name])
            raise ExportError(f"{CLASS}.{name} = {value!r}; must be {kinds}")
    missing = [name for name in REQUIRED if name not in entries]
    if missing:
        raise ExportError(f"{CLASS} of Isaac Lab {VERSION} requires {', '.join(missing)}")


ACTUATOR = "ACTUATOR"  # names in the file
STEP, CONSTANT, BIAS = "PHYSICS_STEP", "FORCE_CONSTANT", "CONSTANT_EFFORT"
# Entries of the plant that the configuration holds; whatever else is not neutral is reported as lost.
HELD = {
    "drive": {"delay_samples", "dead_time", "current_limit"},
    "motor": {"force_constant"},
    "mechanics": {"inertia", "viscous", "bias", "pitch"},
    "friction": {"operators", "stribeck", "bristle"},
    "encoder": set[str](),
}


class Configuration(NamedTuple):
    """What the file holds."""

    step: float  # s, of the physics
    constant: float  # N m/A | N/A: effort of one ampere
    bias: float  # N m | N: constant effort on the axis
    entries: dict[str, Any]  # of the actuator's configuration


def configuration(setup: Setup) -> Configuration:
    """The stage at a physics step of its control period."""
    p = setup.stage
    late = round((p.drive.delay_samples * setup.dt + p.drive.dead_time) / setup.dt)
    limit = p.drive.current_limit * p.motor.force_constant
    entries = {
        "joint_names_expr": ["axis"],
        "stiffness": 0.0,
        "damping": 0.0,
        "actuator_effort_limit": limit if math.isfinite(limit) else None,
        "armature": p.mechanics.inertia,
        "friction": static(p.friction),
        "dynamic_friction": stage.sliding(p.friction),
        "viscous_friction": p.mechanics.viscous,
        "min_delay": late,
        "max_delay": late,
    }
    check(entries)
    return Configuration(setup.dt, p.motor.force_constant, p.mechanics.bias, entries)


def static(p: Friction) -> float:
    """Friction that breaks away (N m | N), with its Stribeck rise."""
    rolling = float(sum(p.operators.weight)) * (1.0 + p.stribeck.rise)
    return rolling + p.bristle.coulomb * (1.0 + p.bristle.stribeck.rise)


def text(found: Configuration, name: str) -> str:
    """The Python file; `name` is that of the stage."""
    entries = "".join(f"    {key}={value!r},\n" for key, value in found.entries.items())
    return (
        f'"""{name} as an actuator of Isaac Lab {VERSION}.\n\n'
        f"    actuators={{'axis': {ACTUATOR}}}    # in ArticulationCfg; `joint_names_expr` names the joint\n"
        f"    dt={STEP}    # in SimulationCfg; the delays count these steps\n\n"
        f"The joint's effort target is {CONSTANT} * current + {BIAS}.  The armature is all of the axis'\n"
        "inertia: give the joint's link next to none.\n"
        f'"""\n\nfrom {MODULE} import {CLASS}\n\n'
        f"{STEP} = {found.step!r}  # s\n"
        f"{CONSTANT} = {found.constant!r}  # N m/A | N/A\n"
        f"{BIAS} = {found.bias!r}  # N m | N\n"
        f"{ACTUATOR} = {CLASS}(\n{entries})\n"
    )


def read(path: Path) -> Configuration:
    """What a written file holds; nothing of it runs."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assigned = {
        target.id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(target := node.targets[0], ast.Name)
    }
    call = assigned[ACTUATOR]
    assert isinstance(call, ast.Call)
    entries = {str(each.arg): ast.literal_eval(each.value) for each in call.keywords}
    check(entries)
    step, constant, bias = (float(ast.literal_eval(assigned[name])) for name in (STEP, CONSTANT, BIAS))
    return Configuration(step, constant, bias, entries)


def shapes(p: Stage) -> list[str]:
    """Shapes of the friction that PhysX has in another form."""
    words = []
    if stage.sliding(p.friction) > 0.0:
        words.append(
            "friction: what moves before it breaks away; below the static friction the joint stands still, and its "
            "dynamic friction acts in full at once"
        )
    if p.friction.stribeck.rise or p.friction.bristle.stribeck.rise:
        words.append("friction.stribeck: the curve; static friction ends at once when the joint moves")
    return words
