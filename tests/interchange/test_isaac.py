"""The configuration of Isaac Lab: its published fields, PhysX' rule, and what it does not hold."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import make_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup, load_stage
from stagectl.interchange import isaac_lab
from stagectl.interchange.isaac_lab import Joint, step, to_isaac
from stagectl.interchange.round_trip import commands, positions
from stagectl.kernels import friction, friction_bristle
from tests.conftest import CONFIG, Command

AXES = ["ball-screw.yaml", "linear-slider.yaml", "emps.yaml", "xy.yaml#y", "odrive.yaml"]
JOINT = Joint(0.01, 1.2, 1.0, 0.14)


NUMBERS = (float, dict, type(None))
# Isaac Lab is on no package index, so the file is checked against this table instead of the class: the types of each
# field.  Isaac Lab 3.0.0, read on 2026-11-25:
# https://isaac-sim.github.io/IsaacLab/release/3.0.0/_modules/isaaclab/actuators/actuator_base_cfg.html
# and .../actuator_pd_cfg.html.
FIELDS: dict[str, tuple[type, ...]] = {
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


def standing_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """A module `isaaclab.actuators` whose class takes the published fields, and no others."""
    package, module = ModuleType("isaaclab"), ModuleType(isaac_lab.MODULE)
    optional = [(name, Any, None) for name in FIELDS if name not in REQUIRED]
    fields: list[Any] = [*((name, Any) for name in REQUIRED), *optional]
    setattr(module, isaac_lab.CLASS, make_dataclass(isaac_lab.CLASS, fields))
    monkeypatch.setitem(sys.modules, "isaaclab", package)
    monkeypatch.setitem(sys.modules, isaac_lab.MODULE, module)


def made_by(path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the file defines."""
    standing_in(monkeypatch)
    made: dict[str, Any] = {}
    exec(path.read_text(), made)
    return made


@pytest.mark.parametrize("name", AXES)
def test_the_file_makes_the_published_class(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    setup = load_stage(CONFIG / name)
    to_isaac(setup, tmp_path / "axis.py")
    made = made_by(tmp_path / "axis.py", monkeypatch)
    p, actuator = setup.stage, made["ACTUATOR"]
    assert (actuator.armature, actuator.viscous_friction) == (p.mechanics.inertia, p.mechanics.viscous)
    assert actuator.actuator_effort_limit == p.drive.current_limit * p.motor.force_constant
    assert actuator.friction == pytest.approx(actuator.dynamic_friction * (1.0 + p.friction.stribeck.rise))
    assert actuator.max_delay * made["PHYSICS_STEP"] == pytest.approx(p.drive.delay_samples * setup.dt)
    entries = isaac_lab.configuration(setup).entries
    assert {name: getattr(actuator, name) for name in entries} == entries
    assert all(isinstance(value, FIELDS[name]) for name, value in entries.items())


def test_below_static_friction_the_joint_stands_still() -> None:
    assert step(JOINT, 0.0, 1.19, 5e-4) == 0.0
    assert step(JOINT, 0.0, 1.21, 5e-4) == pytest.approx(5e-4 * 0.21 / 0.01, rel=0.05)  # then the dynamic one acts


def test_it_comes_to_the_speed_at_which_the_efforts_balance() -> None:
    velocity = 0.0
    for _ in range(4000):
        velocity = step(JOINT, velocity, 2.0, 5e-4)
    assert velocity == pytest.approx((2.0 - 1.0) / 0.14, rel=1e-6)


def test_it_coasts_to_a_stop_and_stays() -> None:
    velocity, speeds = 3.0, []
    for _ in range(200):
        velocity = step(JOINT, velocity, 0.0, 5e-4)
        speeds.append(velocity)
    assert min(speeds) == 0.0 and speeds[-1] == 0.0
    assert all(np.diff(speeds) <= 0.0)


def test_without_friction_it_is_our_axis(ball_screw: Setup) -> None:
    """Only the step of the integration is left."""
    p = ball_screw.stage
    none = p.friction._replace(operators=friction.bundle([0.0], [1.0]), bristle=friction_bristle.NEUTRAL)
    free = ball_screw._replace(stage=p._replace(friction=none, drive=p.drive._replace(current_lag=0.0)))
    for current in commands(ball_screw).values():
        here, there = positions(free, current), isaac_lab.positions(isaac_lab.configuration(free), current)
        assert np.sqrt(np.mean((there - here) ** 2)) < 0.01 * np.sqrt(np.mean(here**2))


@pytest.mark.parametrize("name", AXES)
def test_how_near_it_is(name: str, tmp_path: Path) -> None:
    """Two-sided: the figures of the documentation, and no motion at all within the rolling zone."""
    motions = to_isaac(load_stage(CONFIG / name), tmp_path / "axis.py").variants["axis.py"]
    assert motions[0].of_motion == 1.0
    assert 0.04 < motions[2].of_motion < 0.08
    assert max(motion.of_friction for motion in motions) < 0.04


def test_the_constant_effort_is_in_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    exported = to_isaac(load_stage(CONFIG / "emps.yaml"), tmp_path / "axis.py")
    assert not [words for words in exported.lost if words.startswith("mechanics.bias")]
    made = made_by(tmp_path / "axis.py", monkeypatch)
    assert made["CONSTANT_EFFORT"] == load_stage(CONFIG / "emps.yaml").stage.mechanics.bias


def test_a_current_without_limit(ball_screw: Setup, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    p = ball_screw.stage
    unlimited = ball_screw._replace(stage=p._replace(drive=p.drive._replace(current_limit=math.inf)))
    to_isaac(unlimited, tmp_path / "axis.py")
    assert made_by(tmp_path / "axis.py", monkeypatch)["ACTUATOR"].actuator_effort_limit is None


def test_the_command(command: Command, tmp_path: Path) -> None:
    out = tmp_path / "a.py"
    code, _, words = command("export", CONFIG / "ball-screw.yaml", "--to", "isaac", "-o", out, "--json", tmp_path / "j")
    told = json.loads((tmp_path / "j").read_text())
    assert code == 0 and "Isaac Sim did not run" in words
    assert [line.split(":")[0] for line in told["lost"]][-1] == "friction"
    assert not [line for line in told["lost"] if line.startswith("encoder.delay_samples")]
    assert "PhysX" in out.with_suffix(".isaac.html").read_text()
