"""What is named next to an unknown: an effect that is like it is as probable as two causes over one coordinate."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from stagectl.gap.inference import beside_unknown, verdict
from stagectl.gap.inference.beside_unknown import of_kin, stands
from stagectl.gap.result.diagnosis import UnknownTerm
from stagectl.gap.selection import linearised, waves
from stagectl.gap.selection.constants import INCLUSION
from stagectl.gap.selection.established import Selection

NOTHING: Any = None
FIELDLESS = np.zeros(0)


def shape(coordinate: str, block: str = "mechanics") -> UnknownTerm:
    return UnknownTerm(coordinate, FIELDLESS, FIELDLESS, 0.5, block=block)


def test_an_effect_stands_beside_an_unknown_against_the_share_that_it_leaves() -> None:
    """One of another form leaves a tenth on the average; a stand-in for an unlisted cause leaves any share."""
    assert stands(0.0, 1.0) == pytest.approx(INCLUSION / (1.0 + INCLUSION), rel=0.01)
    assert stands(0.9, 0.1) == pytest.approx((INCLUSION + math.exp(-1.0)) / (INCLUSION + math.exp(-1.0) + 0.1))
    assert stands(0.95, 0.05) > 0.9 and stands(0.7, 0.3) < 0.25
    assert stands(5.0, 0.0) == stands(5.0, -1.0) == 1.0


@pytest.mark.parametrize(
    ("name", "unknown", "kin"),
    [
        ("cogging", shape("position"), True),  # an error of form over the pitch shows over the position
        ("cogging", shape("speed"), False),
        ("cogging", shape("none"), False),
        ("friction_step", shape("time"), True),
        ("current_saturation", shape("frequency", "drive"), True),
        ("current_saturation", shape("current"), False),  # a force over the current
        ("compliance", shape("frequency", "drive"), False),
        ("compliance", shape("frequency"), False),  # impacts and resonances of every form leave something there
    ],
)
def test_an_effect_is_like_an_unknown_over_a_coordinate_of_its_own(name: str, unknown: UnknownTerm, kin: bool) -> None:
    assert of_kin(name, unknown) is kin


@pytest.mark.parametrize(
    ("predicted", "probability"),
    [
        (300.0, 1.0),  # without the cogging, a function of the position predicts no more: it is a wave of its own
        (350.0, 0.5 + 0.5 * stands(100.0, 300.0)),
        (400.0, stands(100.0, 300.0)),
        (900.0, stands(100.0, 300.0)),
    ],
)
def test_an_effect_is_one_of_two_causes_as_far_as_no_function_takes_its_place(
    monkeypatch: pytest.MonkeyPatch, predicted: float, probability: float
) -> None:
    """The cogging explains 100, and next to it a function of the position predicts all that is left, 300."""
    monkeypatch.setattr(beside_unknown, "without", lambda *_: "rest")
    monkeypatch.setattr(linearised, "excess", lambda *given: ({"now": 300.0, "rest": 400.0}[given[-1]], 0.0))
    library: Any = SimpleNamespace(
        predict=lambda _, now: SimpleNamespace(cuts=({"now": 300.0, "rest": predicted}[now], 0.0))
    )
    now: Any = "now"
    found = beside_unknown.there_beside(NOTHING, library, now, NOTHING, shape("position"))
    assert found == pytest.approx(probability)


def named_beside(
    monkeypatch: pytest.MonkeyPatch,
    shapes: dict[frozenset[str], UnknownTerm | None],
    misfit: UnknownTerm | None = None,
    wave: str = "cogging",
    has_line: bool = False,
) -> Any:
    """What is said of a `wave` and an asymmetry next to the unknown that `shapes` holds for what is named.

    `misfit` is what both leave over a coordinate where that is too little for an unknown.  `has_line`: the wave has.
    """

    def only(_: Any, selected: Any) -> Any:
        kept = [x for x in selected.fitted.effects if selected.probability[x.effect.name] >= 0.5]
        return selected._replace(fitted=SimpleNamespace(effects=kept))

    def found(_: Any, named: Any, *__: Any) -> UnknownTerm | None:
        return shapes[frozenset(x.effect.name for x in named.fitted.effects)]

    monkeypatch.setattr(verdict, "only_named", only)
    monkeypatch.setattr(beside_unknown, "unknown", found)
    monkeypatch.setattr(beside_unknown, "error_of_form", lambda *_: misfit)
    monkeypatch.setattr(beside_unknown, "there_beside", lambda *_: 0.1)
    monkeypatch.setattr(waves, "stands", lambda _, __, valued: has_line and valued.effect.name == wave)
    effects = [SimpleNamespace(effect=SimpleNamespace(name=name)) for name in (wave, "coulomb_asymmetry")]
    gains = {wave: 100.0, "coulomb_asymmetry": 1000.0}
    selected = Selection(
        cast("Any", SimpleNamespace(effects=effects)), NOTHING, dict.fromkeys(gains, 0.9), {}, gains, {}
    )
    return beside_unknown.beside_unknown(NOTHING, NOTHING, selected, NOTHING)


def test_nothing_changes_where_nothing_is_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    found = named_beside(monkeypatch, {frozenset({"cogging", "coulomb_asymmetry"}): None})
    assert found.shape is None and set(found.selected.probability.values()) == {0.9}


def test_a_name_that_falls_leaves_its_part_to_the_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cogging next to three times as much over the position; the asymmetry, of another coordinate, stays."""
    over_place, larger = shape("position"), shape("position_mod_pitch")
    both, one = frozenset({"cogging", "coulomb_asymmetry"}), frozenset({"coulomb_asymmetry"})
    found = named_beside(monkeypatch, {both: over_place, one: larger})
    assert found.selected.probability == {"cogging": 0.1, "coulomb_asymmetry": 0.9}
    assert found.shape is larger and [x.effect.name for x in found.named.fitted.effects] == ["coulomb_asymmetry"]
    assert [x.effect.name for x in found.selected.fitted.effects] == ["cogging", "coulomb_asymmetry"]


def test_what_a_form_leaves_over_its_coordinate_counts_where_it_is_no_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    """A friction over the position, of which a function of the position is left; what that leaves is an unknown."""
    both, one = frozenset({"position_friction", "coulomb_asymmetry"}), frozenset({"coulomb_asymmetry"})
    larger = shape("position")
    found = named_beside(monkeypatch, {both: None, one: larger}, shape("position"), "position_friction")
    assert found.selected.probability == {"position_friction": 0.1, "coulomb_asymmetry": 0.9}
    assert found.shape is larger


@pytest.mark.parametrize("unknown", [True, False])
def test_a_wave_stands_by_its_line_whatever_harmonics_it_leaves(unknown: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """As an unknown over the position, or as an error of its form that is too little for one."""
    left = shape("position") if unknown else None
    both = frozenset({"cogging", "coulomb_asymmetry"})
    found = named_beside(monkeypatch, {both: left}, shape("position"), has_line=True)
    assert found.shape is left and set(found.selected.probability.values()) == {0.9}
