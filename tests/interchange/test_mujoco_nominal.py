"""A MuJoCo model as the nominal one of a diagnosis: read as MuJoCo runs it, and what differs from it is found."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.gap.logs import nominal_model
from stagectl.gap.logs.nominal_values import of_file
from stagectl.interchange.mujoco_nominal import nominal
from stagectl.kernels import stage
from stagectl.units import StageError
from tests.conftest import Command

Array = NDArray[np.float64]
STEP = 1e-3
DRIVE = '<motor name="elbow" joint="elbow" gear="0.5" ctrlrange="-8 8"/>'


def arm(elbow: str = 'damping="0.05" armature="0.01"', mass: float = 1.0, more: str = DRIVE) -> str:
    """Two links in the plane; the elbow moves, the shoulder stands still."""
    return f"""<mujoco>
      <option timestep="{STEP}" gravity="0 0 -9.81" integrator="implicitfast"/>
      <worldbody><body name="upper"><joint name="shoulder" type="hinge" axis="0 0 1" damping="1e6"/>
        <inertial pos="0.2 0 0" mass="2" diaginertia="0.02 0.02 0.02"/>
        <body name="lower" pos="0.4 0 0"><joint name="elbow" type="hinge" axis="0 0 1" {elbow}/>
          <inertial pos="0.1 0 0" mass="{mass}" diaginertia="0.01 0.01 0.01"/></body></body></worldbody>
      <actuator>{more}</actuator></mujoco>"""


def lugre(values: str, name: str = "rubbing") -> str:
    still = 'input="none" motorconst="0 0" resistance="1"'
    return f'<dcmotor name="{name}" joint="elbow" {still} lugre="{values}"/>'


def written(folder: Path, text: str, name: str = "arm.xml") -> str:
    (folder / name).write_text(text)
    return str(folder / name)


def moved(place: str, current: Array) -> Array:
    """Positions of the elbow in MuJoCo."""
    model = mujoco.MjModel.from_xml_path(place)
    data, found = mujoco.MjData(model), np.empty(len(current))
    for k, command in enumerate(current):
        found[k], data.ctrl[0] = data.joint("elbow").qpos[0], command
        mujoco.mj_step(model, data)
    return found


def ours(place: str, current: Array) -> Array:
    """The same by the nominal model of the diagnosis."""
    blocks = nominal(place).blocks
    p = nominal_model.read(of_file(blocks, Path(place), blocks["stage"]["kind"]))
    x, found = stage.at_rest(p), np.empty(len(current))
    for k, command in enumerate(current.tolist()):
        found[k] = x.position
        x = stage.period(p, x, command, stage.SILENT, STEP, 20)
    return found


def swing(seconds: float = 4.0, size: float = 1.0) -> Array:
    t = np.arange(0.0, seconds, STEP)
    return np.asarray(size * (np.sin(2 * np.pi * 1.1 * t) + 0.6 * np.sin(2 * np.pi * 3.1 * t)) * np.minimum(t, 1.0))


@pytest.mark.parametrize(
    ("elbow", "more", "share"),
    [
        ('damping="0.05" armature="0.01"', "", 0.005),
        ('damping="0.05" frictionloss="0.2"', "", 0.03),  # MuJoCo's creeps at standstill, ours holds
        ('damping="0.05"', lugre("200 0.5 0.15 0.2 0.3"), 0.015),
        ('damping="0.05"', lugre("200 0.5 0.15 0.15 1"), 0.015),
    ],
    ids=["viscous", "frictionloss", "lugre with stribeck", "lugre"],
)
def test_the_nominal_model_moves_as_mujoco_does(tmp_path: Path, elbow: str, more: str, share: float) -> None:
    """To a share of what friction and damping change of the motion."""
    place = written(tmp_path, arm(elbow, more=DRIVE + more))
    free = written(tmp_path, arm('armature="0.01"' if "armature" in elbow else ""), "free.xml")
    here, there = ours(place, swing()), moved(place, swing())
    effect = np.sqrt(np.mean((there - moved(free, swing())) ** 2))
    assert np.sqrt(np.mean((there - here) ** 2)) < share * effect


def test_values(tmp_path: Path) -> None:
    place = written(tmp_path, arm('damping="0.05" armature="0.01" frictionloss="0.3" stiffness="2"'))
    blocks, notes = nominal(place)
    body = blocks["stage"]
    assert (body["kind"], body["force_constant"], body["viscous"], body["bias"]) == ("rotary", 0.5, 0.05, 0.0)
    assert body["inertia"] == pytest.approx(0.01 + 0.01 + 1.0 * 0.1**2)
    assert blocks["friction"]["slip"] == pytest.approx([0.3 * STEP**2 / body["inertia"]])
    assert blocks["drive"]["current_limit_A"] == 8.0
    assert notes == ("joint elbow of the MuJoCo model: not read: its spring of 2 (SI)",)


def test_gravity_of_a_lift_is_its_constant_effort(tmp_path: Path) -> None:
    text = arm().replace('name="elbow" type="hinge" axis="0 0 1"', 'name="elbow" type="slide" axis="0 0 1"')
    body = nominal(written(tmp_path, text)).blocks["stage"]
    assert (body["kind"], body["bias"]) == ("linear", pytest.approx(-9.81))


def test_several_bristles_are_stop_operators(tmp_path: Path) -> None:
    more = DRIVE + lugre("200 0 0.1 0.1 1", "a") + lugre("50 0 0.2 0.2 1", "b")
    read = nominal(written(tmp_path, arm(more=more)))
    assert read.blocks["friction"]["weight"] == [0.1, 0.2]
    assert read.blocks["friction"]["slip"] == pytest.approx([2 * 0.1 / 200, 2 * 0.2 / 50])
    assert "bristles" in read.notes[0]


@pytest.mark.parametrize(
    ("text", "joint", "said"),
    [
        ("<mujoco><worldbody", "", ":1: it is not complete XML"),
        ("<mujoco><nonsense/></mujoco>", "", "MuJoCo does not take it"),
        (arm(more='<position name="elbow" joint="elbow" kp="10"/>'), "", "there are: none"),
        (arm(more=DRIVE + DRIVE.replace('"elbow"', '"shoulder"')), "", "there are: shoulder, elbow"),
        (arm(), "wrist", "there are: elbow"),
        (arm(), "shoulder", "the joint shoulder has 0 actuators"),
        (arm(more=DRIVE + DRIVE.replace('name="elbow"', 'name="b"')), "", "the joint elbow has 2 actuators"),
    ],
)
def test_what_is_no_axis(tmp_path: Path, text: str, joint: str, said: str) -> None:
    with pytest.raises(StageError) as error:
        nominal(written(tmp_path, text) + (f"#{joint}" if joint else ""))
    assert said in str(error.value)


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(StageError, match=r"nowhere\.xml: no such file"):
        nominal("nowhere.xml")


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """A log of an arm in MuJoCo whose forearm is heavier, and whose elbow rubs more, than in the model."""
    place = written(tmp_path, arm('damping="0.12" armature="0.01"', mass=1.8), "machine.xml")
    rng, current = np.random.default_rng(4), swing(8.0)
    position = moved(place, current) + 1e-5 * rng.standard_normal(len(current))
    rows = np.column_stack([STEP * np.arange(len(current)), current, position])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", fmt="%.9g", header="time,ctrl,qpos", comments="")
    return tmp_path / "log.csv"


COLUMNS = {"time": "time:s", "position": "qpos:rad", "command": "ctrl:A"}


def test_what_differs_from_a_mujoco_model_is_found(machine: Path, tmp_path: Path, command: Command) -> None:
    model = written(tmp_path, arm())
    columns = ",".join(f"{name}={where}" for name, where in COLUMNS.items())
    options = ("--columns", columns, "--model", f"{model}#elbow", "-o", tmp_path / "out", "--json", "-")
    code, said, err = command("gap", "diagnose", machine, *options)
    assert code == 0, err
    answer = json.loads(said)
    values = {name: found["value"] for effect in answer["effects"] for name, found in effect["parameters"].items()}
    assert answer["verdict"] == "parameters"
    assert values["inertia"] == pytest.approx(0.02 + 1.8 * 0.1**2, rel=0.02)
    assert values["viscous"] == pytest.approx(0.12, rel=0.05)
