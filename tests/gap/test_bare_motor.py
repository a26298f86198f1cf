"""A bare motor needs four values, and logs of different rates make one session."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stagectl.gap.logs.load_session import load
from tests.recording import damage

FOUR_LINES = """
stage:
  force_constant: 0.055
  inertia: 2.5e-4
  encoder_step: 7.67e-4
controller: {Ts: 0.0005}
"""


def test_four_lines_describe_a_bare_motor(tmp_path: Path) -> None:
    damage.write(tmp_path / "a.csv", damage.motion())
    (tmp_path / "captures.yaml").write_text("captures: [{file: a.csv}]")
    (tmp_path / "nominal.yaml").write_text(FOUR_LINES)
    session = load([tmp_path])
    assert session.kind == "rotary" and session.dt == pytest.approx(5e-4)
    assert session.stage.motor.force_constant == 0.055 and session.stage.mechanics.inertia == 2.5e-4
    assert any("viscous" in note for note in session.notes)  # a default is said


def test_logs_of_two_rates_share_the_longer_period(tmp_path: Path) -> None:
    for name, rate in (("fast", 2000.0), ("slow", 500.0)):
        damage.write(tmp_path / f"{name}.csv", damage.motion(rate))
    (tmp_path / "captures.yaml").write_text("captures: [{file: fast.csv}, {file: slow.csv}]")
    (tmp_path / "nominal.yaml").write_text(FOUR_LINES.replace("controller: {Ts: 0.0005}", ""))
    session = load([tmp_path])
    assert session.dt == pytest.approx(2e-3)
    fast, slow = session.logs
    np.testing.assert_allclose(fast.position[:2990], slow.position[:2990], atol=2e-4)
