"""Where the machine's base rings: found among the lines that a multisine leaves of any error."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.gap.residuals.base_modes import modes
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.model_tracking import MeasuredPath
from stagectl.gap.residuals.sensitivities import model_of, residuals_of
from stagectl.gap.residuals.thresholds import KEPT
from stagectl.gap.residuals.whitening import Whitener
from stagectl.kernels import stage
from stagectl.kernels.fields import put

SETUP = load_stage(Path(__file__).parents[2] / "config" / "ball-screw.yaml")
TONES = (1.3, 3.1, 7.3, 18.7, 41.0)  # Hz
FLAT = Whitener(np.arange(2.0), np.ones(2), np.ones(2))
BASE, RATIO = 12.7, 0.04


def _moved(p: stage.Stage, seconds: float) -> MeasuredPath:
    """The stage in open loop under a multisine of current, sampled as a log is."""
    t = SETUP.dt * np.arange(round(seconds / SETUP.dt))
    command = sum(1.5 * np.sin(2.0 * math.pi * tone * t + tone) for tone in TONES)
    rows, x, smooth = np.empty((len(t), 3)), stage.at_rest(p, 1.0), p.encoder._replace(step=0.0)
    for k, current in enumerate(np.asarray(command).tolist()):
        rows[k] = current, stage.measured(smooth, x, stage.SILENT), x.current
        x = stage.period(p, x, current, stage.SILENT, SETUP.dt, 4)
    return MeasuredPath(rows, 0.0, SETUP.dt)


def test_a_ring_is_found_where_the_base_takes_up_the_force() -> None:
    """Next to a viscous asymmetry, which leaves lines at all tones; along the path it rings at w / sqrt(1 + mu)."""
    nominal = SETUP.stage
    machine = put(put(nominal, "mechanics.base.ratio", RATIO), "mechanics.base.frequency", BASE)
    path = _moved(put(machine, "mechanics.viscous_asymmetry", 0.3), 8.0)
    counted = np.ones(len(path.rows[::KEPT]))
    counted[:100] = 0.0
    run = Run("multisine", (), (path,), path, counted, np.zeros(len(counted), dtype=np.int64))
    model = model_of(nominal, SETUP.dt)
    found = modes(model, [run], residuals_of(model, [run], FLAT), FLAT)
    assert found[0] == pytest.approx(BASE / math.sqrt(1.0 + RATIO), rel=0.025)
