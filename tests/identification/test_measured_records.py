"""Measured records of other people's machines through `identify`, by the commands that a user types.

The stage files have wrong values on purpose: friction a third off, inertia a quarter.  UR10e: S. Mamedov, S. Mikhel,
Frontiers in Robotics and AI, 2020 (published friction).  HSM150: the catalogue's values, stored with the record.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from stagectl.cli.app import application
from tests.gap.measured import UR_GAINS, record

STAGE = """
name: {name}
axis: {{kind: rotary}}
motor: {{force_constant: {gain} N m/A}}
mechanics: {{inertia: {inertia} kg m^2, viscous: {viscous} N m s/rad}}
friction: {{law: rolling, coulomb: {coulomb} N m, elements: 12, shortest: 0.01 deg, longest: 0.5 deg}}
encoder: {{counts_per_revolution: {counts}}}
drive:
  current_lag: 0.2 ms
  current_limit: 30 A
  wire: {{kind: odrive, port: odrive, torque_constant: {gain} N m/A, baud: 4 Mbit/s}}
control: {{period: 2 ms, bandwidth: 5 Hz, margin: 20 deg}}
limits: {{travel: [-1e6 rad, 1e6 rad], speed: {speed} rad/s, acceleration: 1e4 rad/s^2, following_error: 1 deg}}
"""
JOINTS = {  # inertia kg m^2 (a guess), published viscous N m s/rad and Coulomb friction N m, and what comes out within
    1: (5.5, 21.26, 12.55, 0.10),
    2: (5.5, 20.22, 13.27, 0.10),
    3: (2.0, 10.38, 4.99, 0.18),
    4: (0.5, 3.58, 2.00, 0.18),
    6: (0.3, 3.03, 2.30, 0.15),
}
HSM = {"inertia": 1.2e-4, "viscous": 7.03e-5}
HSM_COLUMNS = "time=data[1]:s,position=data[3]:rad,current=data[6]:Nm"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages go into a folder of the test."""
    monkeypatch.chdir(tmp_path)


def identified(*arguments: object) -> dict[str, Any]:
    """The answer of a command that must succeed."""
    words = ["identify", *map(str, arguments), "--json", "-"]
    result = CliRunner().invoke(application(), words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    answer: dict[str, Any] = json.loads(result.stdout)
    return answer


def stage(**values: Any) -> Path:
    path = Path("machine.yaml")
    path.write_text(STAGE.format(**values))
    return path


@pytest.mark.parametrize("joint", JOINTS)
def test_a_joint_has_the_published_friction(joint: int) -> None:
    """The force is the published one within 15 % at three speeds; how a line splits it depends on record and day.

    Joints 3 and 4, half the difference of the torques at the same angle in opposite directions, which needs no model:
    their slopes are 0.90 and 0.80 of the published ones, the force at low speeds is higher, in each third of it.
    """
    inertia, viscous, coulomb, within = JOINTS[joint]
    wrong = {"inertia": inertia, "viscous": 0.7 * viscous, "coulomb": 1.3 * coulomb, "counts": 62832, "speed": 4}
    machine = stage(name=f"joint {joint}", gain=UR_GAINS[joint - 1], **wrong)
    log = record("ur10e_joints", f"ur-20_01_22-joint_{joint}.csv")
    gravity = ["--gravity"] if joint != 1 else []
    columns = f"time=1,position={joint + 1}:rad,current={joint + 13}"
    parameters = identified("least-squares", machine, log, "--columns", columns, *gravity)["parameters"]
    assert parameters["viscous"]["value"] == pytest.approx(viscous, rel=within)
    assert parameters["coulomb"]["value"] == pytest.approx(coulomb, rel=within)
    for speed in (0.1, 0.5, 1.0):
        force = parameters["coulomb"]["value"] + speed * parameters["viscous"]["value"]
        assert force == pytest.approx(coulomb + speed * viscous, rel=0.15)


def test_gravity_is_the_same_by_both_methods() -> None:
    """The load of joint 3 by `simultaneous`, whose intervals are wide at 94 Hz, and by `least-squares`.

    The slope is the record's own: 0.90 of the published one, from the half differences above.
    """
    log = record("ur10e_joints", "ur-20_01_22-joint_3.csv")
    machine = stage(name="joint 3", gain=8.46, inertia=2.0, viscous=7.3, coulomb=6.5, counts=62832, speed=4)
    options = ("--columns", "time=1,position=4:rad,current=16", "--gravity")
    wide, other = (identified(method, machine, log, *options) for method in ("simultaneous", "least-squares"))
    load = wide["parameters"]["gravity_sine"]
    assert load["value"] == pytest.approx(other["parameters"]["gravity_sine"]["value"], rel=0.01)
    for name, seen in (("viscous", 0.90 * 10.38), ("coulomb", 4.99)):
        assert wide["parameters"][name]["low"] < seen < wide["parameters"][name]["high"]
    coulomb, viscous = sum(wide["changes"]["friction"]["weight"]), wide["changes"]["mechanics.viscous"]
    for speed in (0.1, 0.5, 1.0):  # each is known to a fifth only, their sum is: they are written together
        assert coulomb + speed * viscous == pytest.approx(4.99 + speed * 10.38, rel=0.15)


def torque_steps() -> tuple[Path, list[Path]]:
    """The HSM150's stage file with wrong values, and its records of one direction and of the other."""
    logs = [record("hsm150", f"idf_{name}_1.mat") for name in ("neg_0.04", "pos_0.06")]
    wrong = {"inertia": 1.5e-4, "viscous": 5e-5, "coulomb": 0.02, "counts": 10000, "speed": 400}
    return stage(name="HSM150", gain=0.0458, **wrong), logs


def test_two_directions_of_torque_steps_are_one_answer() -> None:
    """The catalogue's viscous friction from the measured torque; one direction alone is refused, with the remedy."""
    machine, logs = torque_steps()
    parameters = identified("least-squares", machine, *logs, "--columns", HSM_COLUMNS)["parameters"]
    assert parameters["viscous"]["value"] == pytest.approx(HSM["viscous"], rel=0.1)
    words = ["identify", "least-squares", str(machine), str(logs[0]), "--columns", HSM_COLUMNS]
    refused = CliRunner().invoke(application(), words)
    assert refused.exit_code != 0 and "both directions together" in " ".join(str(refused.exception).split())


@pytest.mark.xfail(strict=True, raises=AssertionError, reason="9.6e-5 +- 1.6e-5 kg m^2: 20 % below the catalogue's")
def test_the_interval_of_torque_steps_holds_the_inertia_of_the_catalogue() -> None:
    machine, logs = torque_steps()
    found = identified("least-squares", machine, *logs, "--columns", HSM_COLUMNS)["parameters"]["inertia"]
    assert found["low"] <= HSM["inertia"] <= found["high"]
