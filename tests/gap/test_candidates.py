"""The library without effects that are left out, and the columns of its forms."""

from __future__ import annotations

import math

import pytest

from stagectl.config.stage_file import load_stage
from stagectl.gap.effects.effect import Definition, Scales
from stagectl.gap.effects.library import definitions
from stagectl.gap.residuals import sensitivities
from stagectl.gap.selection import candidates, effect_parameters, established, linearised
from stagectl.gap.selection.candidates import EffectValues, in_place, joined
from tests.conftest import CONFIG

SIZE = Scales(1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1e-3)
_SPRING = {"load_share": 0.3, "resonance": 250.0, "damping": 0.03, "load_friction": 0.4}
LOADS = {"compliance": _SPRING, "backlash": {**_SPRING, "resonance": 600.0, "gap": 1e-3}}


def named(name: str) -> Definition:
    return next(effect for effect in definitions(SIZE) if effect.name == name)


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
        assert established.is_trace(EffectValues(cogging, values)) == trace
    backlash = next(effect for effect in definitions(SIZE) if effect.name == "backlash")
    assert not established.is_trace(EffectValues(backlash, {"gap": 0.0}))


def test_an_order_is_fitted_where_no_pitch_is_known_about_the_middle_of_the_travel() -> None:
    """Far from the zero of the position, another order would need another phase.  A whole order stays as it is."""
    size = SIZE._replace(centre=60.0)

    def force(name: str, order: float) -> float:
        of = {effect.name: effect for effect in definitions(size._replace(orders={"cogging": (order,)}))}
        values = {amplitude.name: 1.0 for amplitude in of[name].amplitudes}
        shapes = {shape.name: shape for shape in of[name].shapes}
        assert shapes["order"].refined != order.is_integer()
        fixed = {shape: float(place.grid[0]) for shape, place in shapes.items()}
        motor = of[name].apply(load_stage(CONFIG / "emps.yaml").stage, {**values, **fixed}).motor
        angle = motor.cogging.order * size.centre / load_stage(CONFIG / "emps.yaml").stage.mechanics.pitch
        return math.sin(math.tau * angle + motor.cogging.phase) * motor.cogging.amplitude

    for name in ("cogging", "cogging_map"):
        assert force(name, 18.4) == pytest.approx(1.0) == pytest.approx(force(name, 23.1))
        assert force(name, 18.0) != pytest.approx(1.0, abs=0.1)


def test_no_frequency_is_tried_that_no_row_tells() -> None:
    """At 50 Hz a drive train of 1 kHz is rigid: its simulation took twenty times as long as that of a rigid one.

    No refinement goes beyond what the rows tell, either: it went on to 2.5 kHz, and a log of 400 s had no answer.
    """
    slow, fast = ({each.name: each for each in definitions(SIZE._replace(dt=dt))} for dt in (20e-3, 0.5e-3))
    for name in ("compliance", "base_vibration", "backlash"):
        rings = [next(s for s in of[name].shapes if s.unit == "Hz") for of in (slow, fast)]
        grids = [ring.grid for ring in rings]
        assert max(grids[0]) <= 50.0 and set(grids[0]) <= {*grids[1], 50.0}
        assert [ring.high for ring in rings] == [50.0, 2000.0]
    assert "compliance" not in {each.name for each in definitions(SIZE._replace(dt=0.2))}


def test_a_second_resonance_may_be_another_mode_of_the_first() -> None:
    """The base of an exam's machine has two modes: its second one was named a compliance, or the first one was."""

    of = {effect.name: effect for effect in definitions(SIZE)}
    base, load, gap = (EffectValues(of[name], {}) for name in ("base_vibration", "compliance", "backlash"))
    assert candidates.of_the_structure(load, [base, gap]) == ("base_vibration",)
    assert not candidates.of_the_structure(load, [gap]) and not candidates.of_the_structure(gap, [base])


@pytest.mark.parametrize(
    ("order", "wave", "motor"), [(8.0, 24.0, True), (6.0, 4.0, True), (7.0, 24.0, False), (8.2, 24.0, False)]
)
def test_a_ball_pass_at_a_whole_order_may_be_a_harmonic_of_the_motor(order: float, wave: float, motor: bool) -> None:
    """A motor has more harmonics than the model holds: what they leave need not be friction."""
    size = SIZE._replace(orders={"ball_pass_ripple": (order,), "current_ripple": (wave,)})
    of = {effect.name: effect for effect in definitions(size)}
    values = {"sine": 0.01, "cosine": 0.0}
    ball = EffectValues(of["ball_pass_ripple"], {"order": order, **values})
    ripple = EffectValues(of["current_ripple"], {"order": wave, **values})
    assert candidates.of_the_motor(ball, [ripple]) == (("current_ripple",) if motor else ())
    assert not candidates.of_the_motor(ball, []) and not candidates.of_the_motor(ripple, [ball])


def test_a_model_has_one_load_behind_its_transmission() -> None:
    """A backlash takes the place of a compliance, with values of its own, and leaves it none beside it."""
    spring, gap = (EffectValues(named(name), values) for name, values in LOADS.items())
    assert joined([spring], [gap]) == [gap]
    assert in_place([gap]) >= {"backlash", "compliance"} and "backlash" not in in_place([spring])
    assert "backlash" in linearised.APART["compliance"]


def test_a_column_at_the_end_of_a_range_is_taken_inwards() -> None:
    """A load share of 0.95 and a tenth more of it would leave the motor no inertia."""
    model = sensitivities.model_of(load_stage(CONFIG / "ball-screw.yaml").stage, 5e-4)
    share = EffectValues(named("compliance"), {**LOADS["compliance"], "load_share": 0.95})
    gap = EffectValues(named("backlash"), {**LOADS["backlash"], "load_share": 0.95})
    for effect in (share, gap):
        moving = next(one for one in effect_parameters.directions(model, [effect]) if one.name.endswith("load_share"))
        assert moving.size < 0.0
        assert moving.change(model).stage.mechanics.transmission.load_share < 0.95
