"""Springs of a flexure stage, by their inverse dynamics alone: of a size no cable has, and of a law no effect has."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import stagectl as sc
from stagectl.gap.result.diagnosis import DiagnosisResult

Array = NDArray[np.float64]
MASS, VISCOUS, FORCE_CONSTANT = 0.25, 3.0, 2.0  # kg, N s/m, N/A
MODEL: dict[str, float | str] = {
    "kind": "linear", "inertia": MASS, "viscous": VISCOUS, "force_constant": FORCE_CONSTANT
}  # fmt: skip


def diagnosis(folder: Path, spring: Callable[[Array], Array]) -> DiagnosisResult:
    """What is said of one log of a stage of 4 mm stroke; `spring` is a force (N) over the position (m)."""
    rng, time = np.random.default_rng(11), np.arange(0.0, 8.0, 1e-3)
    rates, sizes = 2.0 * np.pi * np.array([0.7, 2.3, 5.9]), np.array([2.4e-3, 1.1e-3, 0.3e-3])
    position, speed, acceleration = (
        (sizes * rates**n * np.sin(np.outer(time, rates) + n * np.pi / 2.0)).sum(axis=1) for n in range(3)
    )
    force = MASS * acceleration + VISCOUS * speed + spring(position)
    current = force / FORCE_CONSTANT + 1e-3 * rng.standard_normal(len(time))
    rows = np.column_stack([time, position + 5e-9 * rng.standard_normal(len(time)), current])
    np.savetxt(folder / "flexure.csv", rows, delimiter=",", fmt="%.10g")
    columns = {"time": "1", "position": "2:m", "current": "3:A"}
    return sc.diagnose(folder / "flexure.csv", columns=columns, model=MODEL, advice=False).diagnosis


def test_a_spring_that_is_far_stiffer_than_a_cable_is_certain(tmp_path: Path) -> None:
    result = diagnosis(tmp_path, lambda x: 900.0 * x)
    (named,) = (effect for effect in result.named if not effect.parameter)
    assert (named.name, named.alternatives) == ("cable_spring", ())
    assert named.probability > 0.99
    assert named.parameters["stiffness"].value == pytest.approx(900.0, rel=0.02)


def test_a_hardening_spring_is_no_effect_of_the_library(tmp_path: Path) -> None:
    """Friction that grows with the load takes five sixths of it; a function of the position takes all."""
    result = diagnosis(tmp_path, lambda x: 3e7 * x**3)
    assert result.verdict == "unknown" and not [effect for effect in result.named if not effect.parameter]
    assert result.unknown is not None
    assert (result.unknown.coordinate, result.unknown.predicted > 0.9) == ("position", True)
    assert dict(result.shares)["repeatable but unexplained"] > 0.9
