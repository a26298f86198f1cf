"""Probabilities, alternatives and values of effects, from fits with known figures."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from stagectl_studies.effect_pictures.scenes import SIZES

from stagectl.config.stage_file import Setup
from stagectl.gap.effects.effect import Amplitude, Shape
from stagectl.gap.effects.library import definitions
from stagectl.gap.inference import verdict
from stagectl.gap.result.diagnosis import FoundEffect, Value
from stagectl.gap.selection.candidates import EffectValues


def selected_with(name: str, odds: dict[str, float], present: tuple[str, ...] = ()) -> Any:
    """An effect next to those `present`; `odds` of the comparable others in its place."""
    effects = tuple(SimpleNamespace(effect=SimpleNamespace(name=other)) for other in (name, *present))
    rivals = {name: dict.fromkeys(odds)}
    return SimpleNamespace(fitted=SimpleNamespace(effects=effects), alternatives={name: odds}, rivals=rivals)


def test_what_holds_an_effect_as_a_special_case_is_no_rival() -> None:
    selected = selected_with("stribeck", {"friction_lag": 1.0, "dwell": 0.4})
    assert verdict._alternatives("stribeck", selected) == ("dwell",)


def test_alternatives_begin_with_what_no_data_separate() -> None:
    assert verdict._alternatives("dead_time", selected_with("dead_time", {"current_loop": 0.3})) == (
        "jitter",
        "current_loop",
    )
    assert verdict._alternatives("coulomb_asymmetry", selected_with("coulomb_asymmetry", {})) == ("bias",)


def test_an_effect_that_is_in_the_model_is_no_alternative_to_another() -> None:
    assert verdict._alternatives("cogging", selected_with("cogging", {"dwell": 0.5}, ("dwell",))) == ()


def test_a_friction_that_lags_is_a_stribeck_friction_too() -> None:
    values = {"rise": Value(0.1, 0.0, 0.2, ""), "lag": Value(1e-3, 0.0, 2e-3, "s")}
    lagging = FoundEffect("friction_lag", ("stribeck", "dwell"), 0.9, 0.0, values)
    curve, same = verdict._split(lagging)
    assert same is lagging
    assert (curve.name, set(curve.parameters), curve.alternatives) == ("stribeck", {"rise"}, ("dwell",))


@pytest.mark.parametrize(("name", "value"), [("dead_time", "time"), ("current_loop", "lag")])
@pytest.mark.parametrize(("size", "kept"), [(3e-4, False), (5e-4, True)])
def test_a_short_mean_delay_belongs_to_the_jitter(name: str, value: str, size: float, kept: bool) -> None:
    delay = FoundEffect(name, (), 0.9, 0.0, {value: Value(size, 0.0, 1.0, "s")})
    jitter = FoundEffect("jitter", (), 0.98, 0.0, {"rms": Value(1e-4, 0.0, 0.0, "s")})
    effects = verdict.with_signatures([delay], [jitter])
    assert effects == ([delay, jitter] if kept else [jitter])
    assert verdict.with_signatures([delay], []) == [delay]


@pytest.mark.parametrize(("shift", "kept"), [(6e-5, False), (-6e-5, False), (2e-4, True), (-2e-4, True)])
def test_a_jitter_is_late_on_average(shift: float, kept: bool) -> None:
    jitter = FoundEffect("jitter", (), 0.98, 0.0, {"rms": Value(1.6e-4, 0.0, 0.0, "s")})
    moved = FoundEffect("time_shift", (), 0.94, 0.0, {"time_shift": Value(shift, -1.0, 1.0, "s")}, parameter=True)
    other = FoundEffect("inertia", (), 1.0, 0.5, {"inertia": Value(1e-5, 0.0, 1.0, "kg m^2")}, parameter=True)
    assert verdict.beyond_jitter([moved, other], [jitter]) == ([moved, other] if kept else [other])
    assert verdict.beyond_jitter([moved, other], []) == [moved, other]


def test_an_interval_ends_where_a_value_cannot_lie() -> None:
    """A belt of 2.3 Hz, give or take 3: no frequency is negative, and no share of the load either."""
    effect = SimpleNamespace(
        name="compliance",
        amplitudes=(Amplitude("load_share", "", (0.3,), 0.0, 0.95),),
        shapes=(Shape("resonance", "Hz", (8.0,), True, 2.0, 2500.0),),
    )
    fitted: Any = SimpleNamespace(effect=effect, values={"load_share": 0.1, "resonance": 2.3})
    deviation = {"compliance.load_share": 0.16, "compliance.resonance": 1.5}
    found = verdict._values(fitted, deviation, "rotary")
    assert found["load_share"].low == 0.0 and found["resonance"].low == 2.0
    assert found["resonance"].high == pytest.approx(2.3 + 1.96 * 1.5, rel=1e-3)


def test_models_with_an_alternative_in_the_place_of_an_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("cogging", "dwell", "bias")
    named = {name: SimpleNamespace(effect=SimpleNamespace(name=name), values={}) for name in names}
    fitted = SimpleNamespace(model=None, effects=(named["cogging"], named["dwell"]))
    rivals = {"cogging": {"bias": named["bias"], "dwell": named["dwell"]}}
    selected: Any = SimpleNamespace(fitted=fitted, rivals=rivals)

    def refine(e: object, model: object, effects: list[Any], steps: int) -> Any:
        return SimpleNamespace(equipped=SimpleNamespace(stage=[part.effect.name for part in effects]))

    monkeypatch.setattr("stagectl.gap.selection.refine.refine", refine)
    effect = FoundEffect("cogging", ("current_gain", "bias"), 0.9, 0.0, {})
    nothing: Any = None
    assert verdict.rivals(nothing, selected, effect) == {"bias": ["dwell", "bias"]}


@pytest.mark.parametrize(
    ("name", "flag", "place"),
    [
        ("current_saturation", {"continuous": 0.0}, "current_limit"),
        ("current_saturation", {"continuous": 1.0}, "continuous_current"),
        ("voltage_saturation", {}, "voltage_limit"),
    ],
)
def test_a_limit_is_told_as_the_drive_has_it(name: str, flag: dict[str, float], place: str, ball_screw: Setup) -> None:
    """In A or V, with the interval of its depth; one that is reached is not above the most that was asked for."""
    effect = next(one for one in definitions(SIZES) if one.name == name)
    most, unit = (SIZES.voltage, "V") if name == "voltage_saturation" else (SIZES.current, "A")
    fitted = EffectValues(effect, {"depth": 0.1, **flag})
    depth = {"depth": Value(0.1, 0.0, 0.25, "")}
    ((told, value),) = verdict.with_limit(depth, fitted, ball_screw.stage).items()
    assert (told, value.unit) == (place, unit)
    assert (value.value, value.low, value.high) == pytest.approx((0.9 * most, 0.75 * most, most))
    assert verdict.with_limit({}, fitted, ball_screw.stage) == {}


def test_the_gap_of_a_backlash_comes_first(ball_screw: Setup) -> None:
    values = {name: Value(x, x, x, "") for name, x in (("load_share", 0.3), ("resonance", 300.0), ("gap", 5e-6))}
    session: Any = SimpleNamespace(stage=ball_screw.stage, kind="rotary")
    assert list(verdict._in_order(values, session)) == ["gap", "load_share", "resonance"]
