"""Bristle friction in a stage file: read, simulated, compensated, exported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stagectl.config.source import ConfigError
from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.controller_check.command_check import check_command
from stagectl.gap.logs import load_session
from stagectl.kernels import stage
from stagectl.kernels.friction_bristle import Bristle
from stagectl.problem import ProblemKind
from stagectl.recording import nominal_yaml
from stagectl.trajectories import Sine
from tests.conftest import CONFIG, Run
from tests.gap.captured import SINE, exported, recorded
from tests.problems import refused

LUGRE = """
  law: lugre
  coulomb: 1.0 N m
  range: 5 um
  damping: 0.05 N m s/rad
  stribeck:
    rise: 0.2
    velocity: 20 rad/s
"""
DAHL = """
  law: dahl
  coulomb: 1.0 N m
  range: 5 um
  exponent: 1.5
"""
BESIDE = """
  law: stop-operators
  weight: [0.2 N m, 0.3 N m]
  slip: [1 um, 6 um]
  bristle: {coulomb: 0.5 N m, range: 3 um, exponent: 1.5}
"""


def with_friction(folder: Path, block: str) -> Path:
    """Stage A with another friction."""
    text = (CONFIG / "ball-screw.yaml").read_text()
    begin, end = text.index("friction:\n"), text.index("encoder:\n")
    path = folder / "stage.yaml"
    path.write_text(text[:begin] + "friction:" + block + "\n" + text[end:])
    return path


@pytest.fixture(scope="module", params=[LUGRE, DAHL], ids=["lugre", "dahl"])
def setup(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Setup:
    return load_stage(with_friction(tmp_path_factory.mktemp("bristle"), request.param))


def test_a_bristle_is_read_with_its_units(setup: Setup) -> None:
    """A range of table travel becomes an angle through the lead; the stiffness is T_c over it."""
    p = setup.stage.friction.bristle
    assert p.stiffness == pytest.approx(1.0 / (5e-6 * 2.0 * np.pi / 0.012), rel=1e-12)
    assert p.coulomb == 1.0
    assert (p.exponent, p.damping, p.stribeck.rise) in ((1.0, 0.05, 0.2), (1.5, 0.0, 0.0))
    assert stage.sliding(setup.stage.friction) == 1.0
    assert stage.stiffness(setup.stage.friction) == p.stiffness


def test_compensation_foresees_the_bristle(setup: Setup) -> None:
    """At 1.6 Hz and 5 mm: without compensation micrometres at each reversal, with the stage's own law 25 times less."""
    sine = Sine(0.005, 1.6, 1.0, 3.0)
    sine = Sine(0.005, 1.6, 2.0, 0.5)
    with_it, without = Run(setup, sine).peak(), Run(setup, sine, frozenset({"friction"})).peak()
    assert 2.0 < without < 20.0
    assert with_it < without / 25.0


def test_the_law_stands_in_the_nominal_file(setup: Setup) -> None:
    p = setup.stage.friction.bristle
    law = nominal_yaml._friction(setup.file)
    assert law["law"] in ("dahl", "lugre")
    assert {name: law[name] for name in ("coulomb", "stiffness", "exponent", "damping")} == {
        name: getattr(p, name) for name in ("coulomb", "stiffness", "exponent", "damping")
    }


def test_what_a_bristle_cannot_have_is_refused(tmp_path: Path) -> None:
    for block, kind, key in (
        (LUGRE.replace("coulomb: 1.0 N m", "coulomb: 0 N m"), ProblemKind.RANGE, "coulomb"),
        (DAHL.replace("exponent: 1.5", "exponent: 9"), ProblemKind.RANGE, "exponent"),
        (DAHL.replace("exponent", "damping"), ProblemKind.UNKNOWN, "damping"),
    ):
        with refused(ConfigError, kind=kind, key=f"friction.{key}"):
            load_stage(with_friction(tmp_path, block))


def test_stop_operators_leave_the_bristle_neutral() -> None:
    assert load_stage(CONFIG / "ball-screw.yaml").stage.friction.bristle == Bristle()


def test_a_bristle_beside_stop_operators_tracks_and_comes_back_from_a_log(tmp_path: Path) -> None:
    """The plant has both, the compensation answers both, and a diagnosis recomputes the command with both."""
    path = with_friction(tmp_path, BESIDE)
    setup, sine = load_stage(path), Sine(0.005, 1.6, 2.0, 0.5)
    assert setup.stage.friction.bristle.coulomb == 0.5 and sum(setup.stage.friction.operators.weight) == 0.5
    assert Run(setup, sine).peak() < Run(setup, sine, frozenset({"friction"})).peak() / 25.0
    session = load_session.load([exported(recorded(tmp_path / "runs", SINE, stage=path), tmp_path / "captures")])
    assert session.stage.friction.bristle == setup.stage.friction.bristle
    assert check_command(session).agrees
