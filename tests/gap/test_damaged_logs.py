"""Damaged logs: cut, thinned, scaled, frozen, noisy, with lost rows.  None raises anything but a word on the log.

Five are tried; `STAGECTL_LONG=2000` tries as many as it says.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest

from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.session import GapError
from stagectl.gap.result.diagnosis import DiagnosisResult
from stagectl.recording.hdf5 import RecordingError
from tests.gap.drawn import diagnosed
from tests.recording import damage

COUNT = max(int(os.environ.get("STAGECTL_LONG", "5")), 5)
STAGE = "stage: {force_constant: 0.055, inertia: 2.5e-4, encoder_step: 7.67e-4}\n"
NOT_NEGATIVE = ("inertia", "viscous", "coulomb", "dead_time", "presliding", "current_limit", "resonance", "damping")


def damaged(rng: np.random.Generator) -> damage.Columns:
    """A motion with three things done to it."""
    columns = {name: column.copy() for name, column in damage.motion(float(rng.choice([100.0, 500.0, 2000.0]))).items()}
    for harm in rng.choice(HARMS, 3, replace=False):
        columns = harm(columns, rng)
    return columns


def _cut(c: damage.Columns, rng: np.random.Generator) -> damage.Columns:
    count = len(c["time"])
    begin, end = sorted(rng.integers(0, count, 2).tolist())
    return {name: column[begin : end + 20] for name, column in c.items()}


def _thinned(c: damage.Columns, rng: np.random.Generator) -> damage.Columns:
    step = int(rng.integers(2, 8))
    return {name: column[::step] for name, column in c.items()}


def _lost(c: damage.Columns, rng: np.random.Generator) -> damage.Columns:
    keep = rng.random(len(c["time"])) > 0.2
    return {name: column[keep] for name, column in c.items()}


def _scaled(c: damage.Columns, rng: np.random.Generator) -> damage.Columns:
    name = str(rng.choice([name for name in c if name != "time"]))
    return {**c, name: c[name] * 10.0 ** rng.uniform(-4, 4)}


def _noisy(c: damage.Columns, rng: np.random.Generator) -> damage.Columns:
    return {n: x if n == "time" else x + 0.05 * np.ptp(x) * rng.standard_normal(len(x)) for n, x in c.items()}


def _frozen(c: damage.Columns, rng: np.random.Generator) -> damage.Columns:
    name = str(rng.choice([name for name in c if name != "time"]))
    column = c[name].copy()
    column[len(column) // 2 :] = column[len(column) // 2] if len(column) else 0.0
    return {**c, name: column}


def _shaken(c: damage.Columns, rng: np.random.Generator) -> damage.Columns:
    step = float(np.median(np.diff(c["time"]))) if len(c["time"]) > 1 else 1e-3
    return {**c, "time": np.sort(c["time"] + 0.4 * step * rng.standard_normal(len(c["time"])))}


HARMS = np.array([_cut, _thinned, _lost, _scaled, _noisy, _frozen, _shaken], dtype=object)


def check(result: DiagnosisResult) -> None:
    """No value outside what is physical, no sentence against its figure."""
    for effect in result.effects:
        assert 0.0 <= effect.probability <= 1.0
        for name, value in effect.parameters.items():
            assert math.isfinite(value.value), f"{effect.name}.{name}"
            assert name not in NOT_NEGATIVE or value.value >= 0.0, f"{effect.name}.{name} = {value.value}"
    gap = result.gap
    if math.isfinite(gap.before):
        assert gap.after <= gap.before * 1.001
    if result.verdict == "none" and gap.floor > 0.0 and gap.before > 2.0 * gap.floor:
        assert "agrees" not in result.sentence


@pytest.mark.parametrize("seed", range(COUNT))
def test_a_damaged_log_is_refused_or_answered(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns = damaged(rng)
    damage.write(tmp_path / "a.csv", columns)
    (tmp_path / "captures.yaml").write_text("captures: [{file: a.csv}]")
    (tmp_path / "nominal.yaml").write_text(STAGE)
    try:
        session = load([tmp_path])
        result = diagnosed(session)
    except (GapError, RecordingError):
        return  # with a word on what is wrong with the log
    check(result)
