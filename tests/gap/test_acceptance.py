"""What the search may add: kin must exceed an error of form, and a special case wins over its wider form."""

from __future__ import annotations

from stagectl.gap.effects.effect import Amplitude, Definition
from stagectl.gap.selection.candidates import EffectValues, Form
from stagectl.gap.selection.cross_validation import Score
from stagectl.gap.selection.refine import Fitted
from stagectl.gap.selection.search import simplest, stands_out


def _effect(name: str) -> Definition:
    return Definition(name, "mechanics", "none", (Amplitude("size", "", (1.0,)),), (), lambda p, _: p)


def _score(name: str, gain: float, worst: float = 0.0) -> Score:
    return Score(Form(_effect(name), {}, (1.0,), (f"{name}.size",)), gain, worst, (1.0,), 100.0)


def _fitted(name: str, left: float) -> Fitted:
    return Fitted(None, (EffectValues(_effect(name), {}),), [], left)  # type: ignore[arg-type]


def test_kin_must_explain_more_than_an_error_of_form() -> None:
    """A quarter of what the relative explained; others need not."""
    gains = {"cogging": 1000.0}
    assert not stands_out(_score("current_ripple", 249.0), gains)
    assert stands_out(_score("current_ripple", 251.0), gains)
    assert stands_out(_score("cable_spring", 1.0), gains)


def test_a_wider_form_replaces_what_it_holds_where_it_explains_much() -> None:
    gains = {"stribeck": 1000.0}
    assert not stands_out(_score("friction_lag", 100.0, 0.29), gains)
    assert stands_out(_score("friction_lag", 100.0, 0.31), gains)


def test_a_special_case_that_leaves_little_more_wins() -> None:
    wide = _fitted("friction_lag", 100.0)
    assert simplest([wide, _fitted("stribeck", 110.0)], 20.0).effects[-1].effect.name == "stribeck"  # 90 of 80
    assert simplest([wide, _fitted("stribeck", 140.0)], 20.0) is wide  # 120 of 80
