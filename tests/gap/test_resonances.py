"""A resonance that is refined: its columns are tangents, however narrow it is."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from stagectl.gap import diagnose
from stagectl.gap.effects.library import definitions
from stagectl.gap.selection import refine
from stagectl.gap.selection.candidates import EffectValues
from tests.gap.drawn import drawn

RINGS, DAMPING = 75.71 / (2.0 * math.pi), 0.0115  # Hz and ratio of the drawn base; a second mode is at 21 Hz


@pytest.mark.parametrize("ratio", [0.05, 0.2])
def test_a_narrow_resonance_is_refined_from_where_the_logs_show_it(tmp_path: Path, ratio: float) -> None:
    """Changes of 5 % of its frequency, twice its width, left more than half of the misfit from any start."""
    session = drawn(tmp_path, 303730109, "base_vibration", scale=4.0, experiments="sine-5.0 steps-1mm")
    e = diagnose.baseline(session, ())
    size = diagnose.scales_of(session, e)
    base = next(effect for effect in definitions(size) if effect.name == "base_vibration")
    place = EffectValues(base, {"ratio": ratio, "frequency": base.shapes[0].grid[0], "damping": 0.03})
    fitted = refine.refine(e, e.base.model, [place])
    found = fitted.effects[0].values
    assert fitted.residual_sum_of_squares < 0.1 * refine.start(e).residual_sum_of_squares
    assert found["frequency"] == pytest.approx(RINGS, rel=0.03)
    assert found["damping"] == pytest.approx(DAMPING, rel=0.3)
