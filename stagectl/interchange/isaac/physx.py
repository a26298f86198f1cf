"""A stage as a configuration of Isaac Lab, tried on one joint under PhysX' rule of joint friction.

Each solver iteration takes the impulse that would stop the joint.  Within the static friction it is applied; beyond it,
it is held within the dynamic friction and the viscous one at the joint's velocity::

    P_c = P - J v             |P_c| <= T_s dt:  P = P_c
                              else              P = P_c within +-(T_d + c |v|) dt

Source: PhysX Team, Articulation Joint Friction, April 28, 2025 (documentation of PhysX 5.6.1), equation (1) and the
clamp of the accumulated impulse; the delay and the effort limit are Isaac Lab's, in its explicit actuators.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.interchange.constants import SOLVER_ITERATIONS
from stagectl.interchange.export import ExportedModel, lost, write_texts
from stagectl.interchange.isaac import configuration
from stagectl.interchange.isaac.configuration import Configuration, read
from stagectl.interchange.round_trip import Array, Simulated, compared

SIMULATOR = f"Isaac Lab {configuration.VERSION}, by PhysX' rule of joint friction,"
NOTES = (
    f"Checked against the field names of {configuration.CLASS} that Isaac Lab {configuration.VERSION} publishes.",
    "Isaac Sim did not run: the motions are those of the rule that PhysX documents.",
    "In Isaac Lab 2.3 the name of actuator_effort_limit is effort_limit.",
)


def to_isaac(setup: Setup, path: Path) -> ExportedModel:
    """Write the Python file `path`, and run the parameters in it by PhysX' rule.

    Raises ExportError where it cannot be written.
    """
    write_texts({path: configuration.text(configuration.configuration(setup), setup.file.name)})
    variants = {path.name: compared(setup, simulated(path))}
    losses = [*lost(setup, configuration.HELD), *configuration.shapes(setup.stage)]
    return ExportedModel(SIMULATOR, (path,), variants, losses, NOTES)


class Joint(NamedTuple):
    """Parameters of the joint."""

    inertia: float
    static: float  # N m | N
    dynamic: float
    viscous: float  # N m s/rad | N s/m


def simulated(path: Path) -> Simulated:
    """What runs commands through the configuration of the file `path`."""
    return lambda current: _positions(read(path), current)


def _positions(found: Configuration, current: Array) -> Array:
    entries = found.entries
    p = Joint(
        entries["armature"], entries["friction"], entries["dynamic_friction"], entries["viscous_friction"]
    )  # fmt: skip
    limit = math.inf if entries["actuator_effort_limit"] is None else entries["actuator_effort_limit"]
    wanted = found.constant * current + found.bias
    late = np.concatenate([np.full(entries["max_delay"], wanted[0]), wanted])[: len(wanted)]
    efforts = np.clip(late, -limit, limit)
    position, velocity, positions = 0.0, 0.0, np.empty(len(current))
    for k, effort in enumerate(efforts.tolist()):
        positions[k] = position
        velocity = step(p, velocity, effort, found.step)
        position += found.step * velocity
    return positions


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
