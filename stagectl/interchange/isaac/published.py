"""The configuration of Isaac Lab that an export fills, as its documentation publishes it.

The package is on no package index, so an export is checked against this table instead of the class.  Isaac Lab 3.0.0,
read on 2026-11-25: https://isaac-sim.github.io/IsaacLab/release/3.0.0/_modules/isaaclab/actuators/actuator_base_cfg.html
and .../actuator_pd_cfg.html.  Version 2.3 has the same names but for `actuator_effort_limit`, there `effort_limit`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stagectl.interchange.exported import ExportError

VERSION = "3.0.0"
MODULE, CLASS = "isaaclab.actuators", "DelayedPDActuatorCfg"
NUMBER, NUMBERS = (float,), (float, dict, type(None))
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
