"""A stage as an actuator of Isaac Lab, tried on one joint under PhysX' rule of joint friction.

The configuration has the field names of Isaac Lab 3.0.0.  Version 2.3 has the same but for `actuator_effort_limit`,
there `effort_limit`.

Each solver iteration takes the impulse that would stop the joint.  Within the static friction it is applied; beyond it,
it is held within the dynamic friction and the viscous one at the joint's velocity::

    P_c = P - J v             |P_c| <= T_s dt:  P = P_c
                              else              P = P_c within +-(T_d + c |v|) dt

Source: PhysX Team, Articulation Joint Friction, April 28, 2025 (documentation of PhysX 5.6.1), equation (1) and the
clamp of the accumulated impulse; the delay and the effort limit are Isaac Lab's, in its explicit actuators.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.interchange.export import ExportedModel, lost, write_texts
from stagectl.interchange.round_trip import Array, compared
from stagectl.kernels import stage
from stagectl.kernels.plant import Friction, Stage

VERSION = "3.0.0"
MODULE, CLASS = "isaaclab.actuators", "DelayedPDActuatorCfg"
SIMULATOR = f"Isaac Lab {VERSION}, by PhysX' rule of joint friction,"
NOTES = (
    f"Checked against the field names of {CLASS} that Isaac Lab {VERSION} publishes.",
    "Isaac Sim did not run: the motions are those of the rule that PhysX documents.",
    "In Isaac Lab 2.3 the name of actuator_effort_limit is effort_limit.",
)
# Entries of the plant that the configuration holds; whatever else is not neutral is reported as lost.
HELD = {
    "drive": {"delay_samples", "dead_time", "current_limit"},
    "motor": {"force_constant"},
    "mechanics": {"inertia", "viscous", "bias", "pitch"},
    "friction": {"operators", "stribeck", "bristle"},
    "encoder": set[str](),
}
SOLVER_ITERATIONS = 4  # PhysX' default of position iterations; 20 change nothing, 1 the shipped axes by 2 % at most


class Configuration(NamedTuple):
    """What the file holds."""

    step: float  # s, of the physics
    constant: float  # N m/A | N/A: effort of one ampere
    bias: float  # N m | N: constant effort on the axis
    entries: dict[str, Any]  # of the actuator's configuration


def to_isaac(setup: Setup, path: Path) -> ExportedModel:
    """Write the Python file `path`, and run the parameters in it by PhysX' rule.

    Raises ExportError where it cannot be written.
    """
    p = configuration(setup)
    write_texts({path: text(p, setup.file.name)})
    variants = {path.name: compared(setup, lambda current: positions(p, current))}
    return ExportedModel(SIMULATOR, (path,), variants, [*lost(setup, HELD), *_shapes(setup.stage)], NOTES)


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
        "friction": _static(p.friction),
        "dynamic_friction": stage.sliding(p.friction),
        "viscous_friction": p.mechanics.viscous,
        "min_delay": late,
        "max_delay": late,
    }
    return Configuration(setup.dt, p.motor.force_constant, p.mechanics.bias, entries)


def _static(p: Friction) -> float:
    """Friction that breaks away (N m | N), with its Stribeck rise."""
    rolling = float(sum(p.operators.weight)) * (1.0 + p.stribeck.rise)
    return rolling + p.bristle.coulomb * (1.0 + p.bristle.stribeck.rise)


def text(found: Configuration, name: str) -> str:
    """The Python file; `name` is that of the stage."""
    entries = "".join(f"    {key}={value!r},\n" for key, value in found.entries.items())
    return (
        f'"""{name} as an actuator of Isaac Lab {VERSION}.\n\n'
        "    actuators={'axis': ACTUATOR}    # in ArticulationCfg; `joint_names_expr` names the joint\n"
        "    dt=PHYSICS_STEP    # in SimulationCfg; the delays count these steps\n\n"
        "The joint's effort target is FORCE_CONSTANT * current + CONSTANT_EFFORT.  The armature is all of the axis'\n"
        "inertia: give the joint's link next to none.\n"
        f'"""\n\nfrom {MODULE} import {CLASS}\n\n'
        f"PHYSICS_STEP = {found.step!r}  # s\n"
        f"FORCE_CONSTANT = {found.constant!r}  # N m/A | N/A\n"
        f"CONSTANT_EFFORT = {found.bias!r}  # N m | N\n"
        f"ACTUATOR = {CLASS}(\n{entries})\n"
    )


def _shapes(p: Stage) -> list[str]:
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


class Joint(NamedTuple):
    """Parameters of the joint."""

    inertia: float
    static: float  # N m | N
    dynamic: float
    viscous: float  # N m s/rad | N s/m


def positions(found: Configuration, current: Array) -> Array:
    """Positions (n,) rad | m of the joint under these commands (n,) A."""
    entries = found.entries
    p = Joint(*(entries[name] for name in ("armature", "friction", "dynamic_friction", "viscous_friction")))
    limit = math.inf if entries["actuator_effort_limit"] is None else entries["actuator_effort_limit"]
    wanted = found.constant * current + found.bias
    late = np.concatenate([np.full(entries["max_delay"], wanted[0]), wanted])[: len(wanted)]
    efforts = np.clip(late, -limit, limit)
    position, velocity, reached = 0.0, 0.0, np.empty(len(current))
    for k, effort in enumerate(efforts.tolist()):
        reached[k] = position
        velocity = step(p, velocity, effort, found.step)
        position += found.step * velocity
    return reached


def step(p: Joint, velocity: float, effort: float, dt: float) -> float:
    """The velocity (rad/s | m/s) after a step under an effort (N m | N)."""
    velocity += dt * effort / p.inertia
    impulse = 0.0
    for _ in range(SOLVER_ITERATIONS):
        stopping = impulse - p.inertia * velocity
        if abs(stopping) > p.static * dt:
            most = (p.dynamic + p.viscous * abs(velocity)) * dt
            stopping = min(max(stopping, -most), most)
        velocity += (stopping - impulse) / p.inertia
        impulse = stopping
    return velocity
