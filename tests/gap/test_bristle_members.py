"""The bristle beside the stop operators: its range and exponent come out of the data, and not from a grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.gap import diagnose
from stagectl.gap.logs import load_session
from stagectl.gap.selection import refine, thresholds
from stagectl.gap.selection.refine import Evidence
from tests.gap.captured import CONFIG

KEPT = {"time": "s", "reference": "rad", "command": "A", "measured": "rad", "measured_current": "A"}
MOTIONS = ("sine-2um", "sine-0.8hz")  # within the rolling zone, and far beyond it


def fitted(law: dict[str, object], folder: Path) -> Evidence:
    """The baseline fit of the ball screw to one whose friction follows this `law`."""
    stage = sc.load_stage(CONFIG / "ball-screw.yaml")
    machine = stage.changed({"friction": law, "simulation.current_noise": 20e-3})
    header = ",".join(f"{name}_{unit}" for name, unit in KEPT.items())
    for name in MOTIONS:
        ran = sc.simulate(stage, CONFIG / "trajectories" / f"{name}.yaml", plant=machine)
        rows = np.column_stack([ran[column] for column in KEPT])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="", fmt="%.9g")
    session = load_session.load([folder / f"{name}.csv" for name in MOTIONS], stage.setup)
    return diagnose.baseline(session, ())


@pytest.mark.parametrize(("length", "exponent"), [(9e-4, 1.0), (6e-4, 1.6)])
def test_a_law_of_one_bristle_is_fitted_by_its_shape(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, length: float, exponent: float
) -> None:
    """Better than by the best of the grid; the stop operators, which could stand for a part of it, carry little."""
    law: dict[str, object] = {"law": "dahl", "coulomb": 1.0, "range": length, "exponent": exponent}
    found = fitted(law, tmp_path)
    monkeypatch.setattr(thresholds, "SHAPES_TRIED", 1)
    coarse = fitted(law, tmp_path)
    left, left_by_grid = (refine.total(e, e.base.after) for e in (found, coarse))
    carried, by_grid = (sum(e.base.model.stage.friction.operators.weight) for e in (found, coarse))
    assert left < 0.8 * left_by_grid and carried < 0.9 * by_grid


def test_stop_operators_take_no_bristle(tmp_path: Path) -> None:
    law: dict[str, object] = {"law": "stop-operators", "weight": [0.3, 0.4, 0.3], "slip": [2e-4, 1e-3, 4e-3]}
    assert fitted(law, tmp_path).base.model.stage.friction.bristle.coulomb < 0.1
