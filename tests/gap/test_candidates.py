"""The library without effects that are left out, and the columns of its forms."""

from __future__ import annotations

from stagectl.gap.effects.effect import Scales
from stagectl.gap.effects.library import definitions
from stagectl.gap.selection import candidates


def test_an_effect_left_out_is_not_found_under_a_wider_name() -> None:
    size = Scales(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1e-3)
    names = {effect.name for effect in candidates.without(definitions(size), ("stribeck",))}
    assert {"stribeck", "friction_lag"}.isdisjoint(names) and "viscous_nonlinear" in names
    assert "stribeck" in {effect.name for effect in candidates.without(definitions(size), ("friction_lag",))}
