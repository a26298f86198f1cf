"""The library without effects that are left out, and the columns of its forms."""

from __future__ import annotations

from stagectl.gap.effects.effect import Scales
from stagectl.gap.effects.library import definitions
from stagectl.gap.selection import candidates, select
from stagectl.gap.selection.candidates import EffectValues

SIZE = Scales(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1e-3)


def test_an_effect_left_out_is_not_found_under_a_wider_name() -> None:
    names = {effect.name for effect in candidates.without(definitions(SIZE), ("stribeck",))}
    assert {"stribeck", "friction_lag"}.isdisjoint(names) and "viscous_nonlinear" in names
    assert "stribeck" in {effect.name for effect in candidates.without(definitions(SIZE), ("friction_lag",))}


def test_what_is_smaller_than_a_trace_is_no_effect() -> None:
    """15 % of the typical size, of sine and cosine together; backlash is no trace at any size."""
    cogging = next(
        effect for effect in definitions(SIZE._replace(orders={"cogging": (18.0,)})) if effect.name == "cogging"
    )
    usual = cogging.amplitudes[0].typical[0]
    for share, trace in ((0.1, True), (0.12, False)):
        values = {"order": 18.0, "sine": share * usual, "cosine": -share * usual}
        assert select.is_trace(EffectValues(cogging, values)) == trace
    backlash = next(effect for effect in definitions(SIZE) if effect.name == "backlash")
    assert not select.is_trace(EffectValues(backlash, {"gap": 0.0}))
