"""The exported MuJoCo model, run by MuJoCo: how near it is for what it can hold, and that it says what it cannot."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from stagectl.cli import records
from stagectl.config.stage_file import Setup, load_stage
from stagectl.interchange import export, mujoco_model
from stagectl.interchange.export import lost
from stagectl.interchange.mujoco_model import bristles, gaussian, to_mujoco
from stagectl.kernels import friction, stage
from stagectl.kernels.effects import Harmonic
from stagectl.kernels.friction_bristle import Bristle
from tests.conftest import CONFIG, Command

AXES = ["ball-screw.yaml", "linear-slider.yaml", "emps.yaml", "xy.yaml#y"]
NO_OPERATORS = friction.bundle([0.0], [1.0])


def with_bristle(setup: Setup, bristle: Bristle, **changes: Any) -> Setup:
    """The stage with this bristle as its friction, and blocks changed."""
    rubbing = setup.stage.friction._replace(operators=NO_OPERATORS, stribeck=friction.Stribeck(), bristle=bristle)
    blocks = {name: getattr(setup.stage, name)._replace(**entries) for name, entries in changes.items()}
    return setup._replace(stage=setup.stage._replace(friction=rubbing, **blocks))


@pytest.mark.parametrize("name", AXES)
def test_stop_operators_by_the_passive_force(name: str, tmp_path: Path) -> None:
    """The model with its friction file: 0.1 % of each motion, presliding included; without it, similar only."""
    exported = to_mujoco(load_stage(CONFIG / name), tmp_path / "model.xml")
    alone, exact = exported.worst().values()
    assert exact[0] <= 1e-3
    assert alone[0] > 10.0 * exact[0]


@pytest.mark.parametrize("rise", [0.0, 0.3])
@pytest.mark.parametrize("coulomb", [0.4, 1.0])
def test_lugre_by_the_model_alone(ball_screw: Setup, tmp_path: Path, coulomb: float, rise: float) -> None:
    """2 % of what the friction changes; within the rolling zone 2 % of the motion itself."""
    bristle = Bristle(coulomb, coulomb / 1e-3, damping=1.0, stribeck=friction.Stribeck(rise, 0.5, 2.0))
    exported = to_mujoco(with_bristle(ball_screw, bristle), tmp_path / "model.xml")
    (motions,) = exported.variants.values()
    assert [file.name for file in exported.files] == ["model.xml"]
    assert max(motion.of_friction for motion in motions) <= 0.02
    assert motions[0].of_motion <= 0.02


@pytest.mark.parametrize("seed", range(6))
def test_lugre_of_any_size(ball_screw: Setup, tmp_path: Path, seed: int) -> None:
    """Drawn limits, rolling lengths, dampings and Stribeck curves: 2 % of what the friction changes."""
    rng = np.random.default_rng(seed)
    coulomb, length, velocity = (float(10.0 ** rng.uniform(*ends)) for ends in ((-0.7, 0.4), (-4, -2), (-1.5, 0.3)))
    damping, rise = float(rng.choice([0.0, 0.1, 1.0, 5.0])), float(rng.choice([0.0, 0.3, 1.0]))
    bristle = Bristle(coulomb, coulomb / length, damping=damping, stribeck=friction.Stribeck(rise, velocity, 2.0))
    (motions,) = to_mujoco(with_bristle(ball_screw, bristle), tmp_path / "model.xml").variants.values()
    assert max(motion.of_friction for motion in motions) <= 0.02


def test_delay_bias_cogging_and_limit_are_held(ball_screw: Setup, tmp_path: Path) -> None:
    """Each changes the motion by more than is left of its difference."""
    bristle = Bristle(1.0, 1e3)
    plain = with_bristle(ball_screw, bristle)
    changes: list[dict[str, Any]] = [
        {"drive": {"delay_samples": 4, "dead_time": 0.4e-3}},
        {"mechanics": {"bias": 0.3}},
        {"motor": {"cogging": Harmonic(0.1, 7.0, 0.5)}},
        {"drive": {"current_limit": 1.5}},
    ]
    for change in changes:
        changed = with_bristle(ball_screw, bristle, **change)
        (motions,) = to_mujoco(changed, tmp_path / "model.xml").variants.values()
        (before,) = to_mujoco(plain, tmp_path / "model.xml").variants.values()
        effect = max(float(np.sqrt(np.mean((a.ours - b.ours) ** 2))) for a, b in zip(motions, before, strict=True))
        assert max(motion.difference for motion in motions) < 0.1 * effect, change


@pytest.mark.parametrize("shape", [0.5, 1.0, 3.0])
def test_a_stribeck_curve_of_another_shape_is_fitted(shape: float) -> None:
    """Nearer over its speeds than the Gaussian of its own rise and speed; one of shape 2 stays as it is."""
    wanted, speeds = friction.Stribeck(0.5, 0.3, shape), np.linspace(0.0, 1.5, 200)
    fitted, named = gaussian(wanted), wanted._replace(shape=2.0)
    apart = [
        sum((friction.stribeck(p, v) - friction.stribeck(wanted, v)) ** 2 for v in speeds) for p in (fitted, named)
    ]
    assert fitted.shape == 2.0 and apart[0] < 0.7 * apart[1]
    assert gaussian(named) == named


def test_the_bristles_hold_what_the_operators_hold(ball_screw: Setup) -> None:
    fitted = bristles(ball_screw.stage.friction)
    assert sum(bristle.coulomb for bristle in fitted) == pytest.approx(stage.sliding(ball_screw.stage.friction))
    for move in (1e-4, 1e-3, 1e-2):
        wanted = sum(
            w * min(move / s, 1.0) for w, s in zip(*map(list, ball_screw.stage.friction.operators[:2]), strict=True)
        )
        carried = sum(b.coulomb * -math.expm1(-move * b.stiffness / b.coulomb) for b in fitted)
        assert carried == pytest.approx(wanted, rel=0.1)


def test_what_is_lost_is_said(ball_screw: Setup) -> None:
    p = ball_screw.stage._replace(
        motor=ball_screw.stage.motor._replace(ripple=Harmonic(0.02, 6.0)),
        mechanics=ball_screw.stage.mechanics._replace(viscous_asymmetry=0.01),
        friction=ball_screw.stage.friction._replace(asymmetry=0.1),
    )
    words = lost(ball_screw._replace(stage=p), mujoco_model.HELD)
    assert [line.split(" = ")[0] for line in words] == [
        "drive.current_quantum", "motor.ripple", "mechanics.viscous_asymmetry", "friction.asymmetry", "encoder.step",
    ]  # fmt: skip
    assert words[2] == "mechanics.viscous_asymmetry = 0.01: e of D (1 + e sgn v)"


def test_what_is_held_are_entries_of_the_plant(ball_screw: Setup) -> None:
    for block, held in mujoco_model.HELD.items():
        assert held <= set(getattr(ball_screw.stage, block)._fields)


def test_the_command(command: Command, tmp_path: Path) -> None:
    place, out = CONFIG / "ball-screw.yaml", tmp_path / "a.xml"
    code, out_words, err_words = command("export", place, "--to", "mujoco", "-o", out, "--json", tmp_path / "a.json")
    assert code == 0 and "not held: drive.current_quantum = 0.004 A" in out_words + err_words
    assert "current_quantum" in out.with_suffix(".mujoco.html").read_text()
    assert (tmp_path / "a_friction.py").is_file()
    mujoco.MjModel.from_xml_path(str(out))
    assert len(json.loads((tmp_path / "a.json").read_text())["files"]) == 2


def test_the_command_offers_every_simulator() -> None:
    assert set(records.SIMULATORS) == set(export.SIMULATORS)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("config.yaml", "--to", "csv"),
            "is a stage file, and --to csv takes recordings; a stage file goes --to mujoco, fmu, isaac",
        ),
        (("a.h5", "--to", "mujoco"), "--to mujoco takes one stage file: stagectl export STAGE.yaml --to mujoco"),
        (("a.yaml", "b.yaml", "--to", "mujoco"), "--to mujoco takes one stage file"),
        (("a.yaml", "--to", "mujoco", "-o", "a.txt"), "a MuJoCo model ends in .xml: take -o a.xml"),
    ],
)
def test_what_does_not_go_together(command: Command, words: tuple[str, ...], said: str) -> None:
    code, _, error = command("export", *words)
    assert code != 0 and said in error
