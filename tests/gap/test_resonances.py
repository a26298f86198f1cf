"""A resonance that is refined: its columns are tangents, however narrow it is."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from stagectl.gap import diagnose
from stagectl.gap.effects.effect import Amplitude, Shape
from stagectl.gap.effects.library import definitions
from stagectl.gap.selection import effect_parameters, refine, resonance_alikes
from stagectl.gap.selection.candidates import EffectValues
from tests.gap.drawn import drawn
from tests.gap.test_candidates import SIZE as SIZES

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


def test_a_base_on_its_feet_may_be_a_load_behind_a_spring(tmp_path: Path) -> None:
    """One encoder sees the same of both: base, and load with all friction at the motor."""
    session = drawn(tmp_path, 303730109, "base_vibration", scale=4.0, experiments="sine-5.0")
    e = diagnose.baseline(session, ())
    size = diagnose.scales_of(session, e)
    library = diagnose.candidates_of(e, size, diagnose.Options())
    base = next(form for form in library.forms if form.effect.name == "base_vibration")
    now = refine.refine(e, e.base.model, [EffectValues(base.effect, base.values(base.typical))])
    (other,) = resonance_alikes.other_resonances(e, library, now, now.effects[0])
    load = other.effects[0]
    assert load.effect.name == "compliance" and load.values["load_friction"] == pytest.approx(0.0, abs=0.05)
    assert other.residual_sum_of_squares == pytest.approx(now.residual_sum_of_squares, rel=0.01)
    ratio = load.values["load_share"] / (1.0 - load.values["load_share"])
    assert ratio == pytest.approx(now.effects[0].values["ratio"], rel=0.05)
    assert resonance_alikes.simpler(e, library, other).effects[0].effect.name == "base_vibration"
    assert resonance_alikes.simpler(e, library, now) is now
    both = now._replace(effects=(*now.effects, load))
    assert resonance_alikes.simpler(e, library, both) is both  # no model has two bases


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_share_moves_from_nothing_to_all_in_one_step(tmp_path: Path, share: float) -> None:
    """A step by a factor never comes from 0, nor to it."""
    effect = next(each for each in definitions(SIZES) if each.name == "compliance")
    values = {shape.name: shape.grid[0] for shape in effect.shapes} | {"load_share": 0.3, "load_friction": share}
    valued = EffectValues(effect, values)
    limits = dict(zip(_names(effect.amplitudes + effect.shapes), effect_parameters.limits([valued]), strict=True))
    assert limits["load_friction"] == (-share, 1.0 - share)
    shifted = effect_parameters.shifted(valued, {"compliance.load_friction": 1.0 - share + 1e-15})
    assert shifted.values["load_friction"] == 1.0
    assert limits["resonance"][1] < values["resonance"]


def _names(parameters: tuple[Amplitude | Shape, ...]) -> list[str]:
    return [p.name for p in parameters]
