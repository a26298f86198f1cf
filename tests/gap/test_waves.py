"""A fine ripple of a screw, a few per cent of what a wrong friction leaves: found by its line over the position."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.load_session import load
from stagectl.gap.result.diagnosis import DiagnosisResult
from tests.conftest import CONFIG
from tests.gap.drawn import diagnosed

PERIOD = 2.5e-3  # m, of the ripple
FRICTION = """\
  law: rolling
  coulomb: 20.3935 N
  elements: 12
  shortest: 1 um                   # chosen: rolling, presliding at 39 Hz
  longest: 30 um
"""
OTHER = "  law: dahl\n  coulomb: 27 N\n  range: 50 um\n  exponent: 1\n"
STROKES = "\n".join(
    f"  - {{type: trapezoid, distance: 200 mm, velocity: {speed} mm/s, acceleration: 0.8 m/s^2}}"  # to and fro
    for speed in (45, 85, 125)
)


def _answer(folder: Path, ripple: float) -> DiagnosisResult:
    """What is said of a machine with another friction and a `ripple` (N), by the model of `config/emps.yaml`."""
    text = (CONFIG / "emps.yaml").read_text()
    motor = f"force_constant: 35.1507 N/A\n  cogging: {{amplitude: {ripple} N, order: {2.0 * math.pi / PERIOD}}}"
    assert FRICTION in text
    plant = folder / "plant.yaml"
    other = text.replace("force_constant: 35.1507 N/A", motor).replace(FRICTION, OTHER)
    plant.write_text(other.replace("eds: drives/", f"eds: {CONFIG / 'drives'}/"))
    (folder / "strokes.yaml").write_text(f"type: sequence\nparts:\n{STROKES}\n")
    ran = sc.simulate(CONFIG / "emps.yaml", folder / "strokes.yaml", plant=plant)
    names = {"time": "time_s", "reference": "reference_m", "command": "command_A", "measured": "position_m"}
    rows = np.column_stack([ran[name] for name in names])
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=",".join(names.values()), comments="", fmt="%.10g")
    session = load([folder / "log.csv"], load_stage(CONFIG / "emps.yaml"))
    return diagnosed(session)


def test_a_fine_ripple_is_named_by_its_line(tmp_path: Path) -> None:
    named = {effect.name: effect for effect in _answer(tmp_path, 1.0).named}
    cogging = named["cogging"]
    assert 2.0 * math.pi / cogging.parameters["order"].value == pytest.approx(PERIOD, rel=0.003)
    assert dict(cogging.fields)["motor.cogging.amplitude"] == pytest.approx(1.0, abs=0.15)


def test_another_friction_alone_has_no_ripple(tmp_path: Path) -> None:
    assert not {"cogging", "cogging_map"} & {effect.name for effect in _answer(tmp_path, 0.0).named}
