"""When a small effect is fitted to the data at all."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.selection import bristle_shape, constants, drive_alikes, linearised, material, refine, select, waves
from stagectl.gap.selection.established import Selection, _further_part, _over_its_coordinate, _with_rival

MISSING, LEFT = (1000.0, 0.0), (100.0, 0.0)  # before and after the fit


def _late(name: str, by: float = 0.0) -> Any:
    effect = SimpleNamespace(name=name, block="drive", amplitudes=[SimpleNamespace(name="time")])
    return SimpleNamespace(effect=effect, values={"time": by})


def _library(*names: str) -> linearised.Library:
    forms = [SimpleNamespace(effect=_late(name).effect, values=lambda x: {"time": x[0]}) for name in names]
    return linearised.Library(cast("Any", tuple(forms)), cast("Any", None), (0.0, 0.0))


def _searched(
    monkeypatch: pytest.MonkeyPatch, forms: Any, with_more: Any, dropped: frozenset[str] = frozenset()
) -> list[str]:
    """The effects that the search ends with, where `with_more` alone finds any, and those in `dropped` do not stand."""

    def established(_: Any, __: Any, now: Any, ___: Any) -> Any:
        standing = tuple(valued for valued in now.effects if valued.effect.name not in dropped)
        return SimpleNamespace(fitted=SimpleNamespace(effects=standing, model=None, residual_sum_of_squares=1.0))

    monkeypatch.setattr(refine, "start", lambda _: SimpleNamespace(effects=(), model=None))
    monkeypatch.setattr(drive_alikes, "on_time", lambda _, __, now: now)
    monkeypatch.setattr(drive_alikes, "nearest", lambda _, __, after: after)
    monkeypatch.setattr(bristle_shape, "beside_effects", lambda _, after: after)
    monkeypatch.setattr(select, "_with_more", with_more)
    monkeypatch.setattr(select, "_with_small", lambda *_: None)
    monkeypatch.setattr(waves, "with_wave", lambda *_: None)
    monkeypatch.setattr(select, "_with_bent", lambda *_: None)
    monkeypatch.setattr(select, "established", established)
    library = linearised.Library(forms, cast("Any", None), (0.0, 0.0))
    selected = select.select(cast("Any", None), library, lambda _: None)
    return [valued.effect.name for valued in selected.fitted.effects]


@pytest.mark.parametrize(("name", "fitted"), [("compliance", True), ("cable_spring", False)])
def test_a_resonance_between_two_places_of_its_grid_is_fitted(
    name: str, fitted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the grid its column explains a third of what is missing; its fit explains nine tenths.

    The column of an effect that does not bend explains all that its fit will.
    """
    bends = name == "compliance"
    effect = SimpleNamespace(name=name, block=EFFECTS[name].block, resonant=bends, nonlinear=bends)
    valued, after = SimpleNamespace(effect=effect), cast("Any", SimpleNamespace(effects=()))
    verdict = SimpleNamespace(of_sets=lambda: {frozenset[str](): 0.1, frozenset([name]): 0.9}, best=lambda _: None)
    at = SimpleNamespace(
        verdict=verdict, empty=0.1, explained=lambda _: 0.35, values=lambda _: [valued], excess=MISSING
    )
    monkeypatch.setattr(linearised, "linearised", lambda *_, **__: at)
    monkeypatch.setattr(linearised, "excess", lambda *_: LEFT)
    monkeypatch.setattr(linearised, "strokes", lambda _: 10)
    monkeypatch.setattr(select, "_grown", lambda *_: after)
    monkeypatch.setattr(select, "_stands_against_functions", lambda *_: True)
    library = cast("Any", SimpleNamespace(predict=lambda *_: linearised.Predicted()))
    grown = select._with_small(cast("Any", None), library, cast("Any", SimpleNamespace(effects=())), lambda: ())
    assert (grown is after) == fitted and material.explains_most(MISSING, LEFT, 10)


def test_two_that_are_missing_alike_are_found_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Either alone explains half of what is missing, so that no single effect is more probable than none."""
    names = ("position_friction", "encoder_interpolation")
    effects = [SimpleNamespace(name=name, block=EFFECTS[name].block, resonant=False, nonlinear=False) for name in names]
    added = tuple(SimpleNamespace(effect=effect) for effect in effects)
    sets = {frozenset(names): 0.9, frozenset[str](): 0.08, frozenset(names[:1]): 0.02}
    at = SimpleNamespace(
        verdict=SimpleNamespace(of_sets=lambda: sets, best=lambda item: item),
        empty=sets[frozenset()], excess=MISSING,
        explained=lambda item: 0.47 * len(item), values=lambda item: added[: len(item)],
    )  # fmt: skip
    now = cast("Any", SimpleNamespace(effects=()))
    monkeypatch.setattr(linearised, "linearised", lambda *_, **__: at)
    monkeypatch.setattr(linearised, "excess", lambda *_: LEFT)
    monkeypatch.setattr(linearised, "strokes", lambda _: 10)
    monkeypatch.setattr(select, "_grown", lambda _, __, joining, ___: SimpleNamespace(effects=joining))
    monkeypatch.setattr(select, "_stands_against_functions", lambda *_: True)
    library = cast("Any", SimpleNamespace(predict=lambda *_: linearised.Predicted()))
    grown = select._with_small(cast("Any", None), library, now, lambda: ())
    assert grown is not None and tuple(grown.effects) == added


def test_the_drive_of_the_best_set_may_explain_the_missing_current_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a cable that leaves most of what is missing in the mechanics, the whole set does not stand."""
    drive, cable = frozenset({"dead_time", "current_loop"}), frozenset({"cable_hysteresis"})
    sets = {drive | cable: 0.7, cable: 0.1, drive: 0.01, frozenset[str](): 1e-9}
    at = SimpleNamespace(verdict=SimpleNamespace(of_sets=lambda: sets), empty=1e-9)
    now = cast("Any", SimpleNamespace(effects=()))
    monkeypatch.setattr(linearised, "linearised", lambda *_, **__: at)
    monkeypatch.setattr(select, "_fitted", lambda _, __, ___, effects, *____: effects)
    monkeypatch.setattr(select, "_explain", lambda _, __, ___, fitted, *____: fitted == drive)
    monkeypatch.setattr(select, "_that_stands", lambda _, __, ___, fitted: fitted)
    library = cast("Any", SimpleNamespace(predict=lambda *_: linearised.Predicted()))
    assert cast("Any", select._with_small(cast("Any", None), library, now, lambda: ())) == drive


@pytest.mark.parametrize(
    ("name", "refined", "fitted"), [("compliance", 0.9, True), ("compliance", 0.1, False), ("cable_spring", 0.9, False)]
)
def test_a_resonance_is_judged_where_its_fit_has_found_it(
    name: str, refined: float, fitted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fit that explains half is kept where the evidence has it first with the refined values on the grid."""
    bends = name == "compliance"
    effect = SimpleNamespace(name=name, block=EFFECTS[name].block, resonant=bends, nonlinear=bends)
    valued = SimpleNamespace(effect=effect)
    now, after = (cast("Any", SimpleNamespace(effects=effects)) for effects in ((), (valued,)))

    def at(*arguments: Any, **_: Any) -> Any:
        odds = refined if valued in arguments else 0.9
        sets = dict(sorted({frozenset[str](): 1 - odds, frozenset([name]): odds}.items(), key=lambda pair: -pair[1]))
        verdict = SimpleNamespace(of_sets=lambda: sets, best=lambda _: None)
        return SimpleNamespace(
            verdict=verdict, empty=0.1, explained=lambda _: 0.35, values=lambda _: [valued], excess=MISSING
        )

    monkeypatch.setattr(linearised, "linearised", at)
    monkeypatch.setattr(linearised, "excess", lambda *_: (500.0, 0.0))
    monkeypatch.setattr(linearised, "strokes", lambda _: 10)
    monkeypatch.setattr(select, "_grown", lambda *_: after)
    monkeypatch.setattr(select, "_stands_against_functions", lambda *_: True)
    library = cast("Any", SimpleNamespace(predict=lambda *_: linearised.Predicted()))
    assert (select._with_small(cast("Any", None), library, now, lambda: ()) is after) == fitted


@pytest.mark.parametrize(("present", "expected"), [("current_loop", "dead_time"), ("dead_time", "dead_time")])
def test_what_makes_a_drive_late_is_decided_again_when_more_is_known(
    present: str, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lag that stood for a dead time while friction was missing leaves more than that once the friction is there."""
    left = {"current_loop": 300.0, "dead_time": 200.0}
    effects = {name: _late(name) for name in (*left, "lead_friction")}
    model = SimpleNamespace(shift=0.0, _replace=lambda **_: None)

    def fitted(_: Any, __: Any, kept: Any, **___: Any) -> Any:
        return SimpleNamespace(model=model, effects=kept, residual_sum_of_squares=left[kept[-1].effect.name])

    monkeypatch.setattr(refine, "refine", fitted)
    now = SimpleNamespace(
        model=model, effects=(effects[present], effects["lead_friction"]), residual_sum_of_squares=left[present]
    )
    library = _library(*left)
    after = drive_alikes.on_time(cast("Any", None), library, cast("Any", now))
    assert {valued.effect.name for valued in after.effects} == {expected, "lead_friction"}


@pytest.mark.parametrize(("name", "single"), [("voltage_saturation", True), ("cable_spring", False)])
def test_what_clips_a_current_is_simulated_for_each_repeat(
    name: str, single: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It clips the noise of the repeat too: around their mean, three clipped repeats look like three limits."""
    monkeypatch.setattr(refine, "equipped", lambda *_: None)
    monkeypatch.setattr(sensitivities, "residuals_of", lambda *_: True)
    monkeypatch.setattr(sensitivities, "residuals_about", lambda *_: False)
    e = SimpleNamespace(runs=(), base=SimpleNamespace(noise=None), deviations=())
    valued = SimpleNamespace(effect=SimpleNamespace(name=name, time_variation=None))
    assert refine.residuals(cast("Any", e), cast("Any", None), [cast("Any", valued)]) is single


@pytest.mark.parametrize(
    ("missing", "share", "left", "predicted_after", "stands"),
    [
        (800.0, 1.2, 100.0, 0.0, True),
        (800.0, 1.2, 100.0, 500.0, False),
        (1200.0, 0.9, 780.0, 640.0, True),
        (1200.0, 0.9, 780.0, 500.0, False),
    ],
)
def test_mechanics_stand_where_no_function_predicts_more_or_as_much_as_before(
    missing: float, share: float, left: float, predicted_after: float, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An eighth of the misfit is left, next to functions that explain all of it: noise alone is no rival.

    Friction that warms up explains little where a Stribeck curve is missing, too; a spring takes from a function.
    """
    valued = SimpleNamespace(effect=SimpleNamespace(name="cable_spring", block="mechanics", time_variation=None))
    before, after = SimpleNamespace(effects=(), left=missing), SimpleNamespace(effects=(valued,), left=left)
    monkeypatch.setattr(linearised, "excess", lambda _, __, fitted: (fitted.left, 0.0))
    of = {missing: linearised.Predicted((700.0, 0.0), share), left: linearised.Predicted((predicted_after, 0.0))}
    library = cast("Any", SimpleNamespace(predict=lambda _, fitted: of[fitted.left]))
    e, fits = cast("Any", SimpleNamespace(beside=None)), (cast("Any", before), cast("Any", after))
    assert select._stands_against_functions(e, library, *fits) is stands


@pytest.mark.parametrize(
    ("left", "drifts", "stands"), [(340.0, False, True), (600.0, False, False), (600.0, True, True)]
)
def test_next_to_a_function_an_effect_explains_most_of_what_it_leaves(
    left: float, drifts: bool, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Less may be the function's own error of form: but that repeats, and what runs on the clock does not."""
    variation = object() if drifts else None
    valued = SimpleNamespace(effect=SimpleNamespace(name="stribeck", block="mechanics", time_variation=variation))
    before, after = SimpleNamespace(effects=(), left=800.0), SimpleNamespace(effects=(valued,), left=left)
    monkeypatch.setattr(linearised, "excess", lambda _, __, fitted: (fitted.left, 0.0))
    library = cast("Any", SimpleNamespace(predict=lambda *_: linearised.Predicted()))
    e, fits = cast("Any", SimpleNamespace(beside=object())), (cast("Any", before), cast("Any", after))
    assert select._stands_against_functions(e, library, *fits) is stands


@pytest.mark.parametrize(
    ("missing", "left", "left_over", "taken"),
    [
        (9e4, 2e4, "", True),
        (9e4, 5e4, "", True),
        (9e4, 6e4, "", False),
        (6e4, 1e4, "", False),
        (6e4, 1e4, "band", True),
        (9e4, 2e4, "function", False),
    ],
)
@pytest.mark.parametrize("beside", [False, True])
def test_what_bends_is_fitted_where_a_band_or_more_than_the_noise_is_missing(
    missing: float, left: float, left_over: str, taken: bool, beside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A backlash took 71 % of what was missing in an exam; around the model without it, its column promised nothing.

    Where a function of one coordinate predicts that, or stands in the model, nothing oscillates.
    """
    gap = SimpleNamespace(effect=SimpleNamespace(name="backlash", resonant=True, nonlinear=True), values={})
    now: Any = SimpleNamespace(model=None, effects=(), left=missing, residual_sum_of_squares=missing)
    e: Any = SimpleNamespace(beside=object() if beside else None)

    def refined(_: Any, __: Any, effects: Any, rival: float) -> Any:
        assert rival == missing
        return SimpleNamespace(effects=effects, left=left, residual_sum_of_squares=left)

    # That less of a current is missing says nothing of mechanics.
    monkeypatch.setattr(linearised, "excess", lambda _, __, fitted: (fitted.left, 500.0 if fitted is now else 0.0))
    monkeypatch.setattr(refine, "floor", lambda _: 7e4)
    monkeypatch.setattr(refine, "refine", refined)
    monkeypatch.setattr(select, "vanishes", lambda _: False)
    monkeypatch.setattr(select, "_that_stands", lambda _, __, ___, after: after)
    predicted = linearised.Predicted((missing * (left_over == "function"), 0.0))
    library: Any = SimpleNamespace(predict=lambda *_: predicted, unordered=lambda *_: left_over == "band")
    after = select._with_bent(e, library, now, lambda: [cast("Any", gap)])
    assert (after is not None) is (taken and not beside)


@pytest.mark.parametrize(("rise", "kept"), [(-0.9, False), (5.0, False), (4.9, True), (0.0, True)])
def test_the_search_goes_on_without_an_effect_at_an_end_of_its_range(
    rise: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would explain more with a value that no machine has: another cause of the library comes next."""
    amplitude = SimpleNamespace(name="rise", low=-0.9, high=5.0)
    effects = {n: SimpleNamespace(name=n, amplitudes=[amplitude]) for n in ("thermal_viscous", "stribeck")}
    sizes = {"thermal_viscous": rise, "stribeck": 0.1}
    found = {n: SimpleNamespace(effect=effect, values={"rise": sizes[n]}) for n, effect in effects.items()}
    forms = tuple(SimpleNamespace(effect=effect) for effect in effects.values())

    def with_more(_: Any, library: Any, now: Any, __: Any) -> Any:
        return None if now.effects else SimpleNamespace(effects=(found[library.forms[0].effect.name],))

    assert _searched(monkeypatch, forms, with_more) == ["thermal_viscous" if kept else "stribeck"]


@pytest.mark.parametrize(("hidden", "found"), [("ball_pass_ripple", True), ("", False)])
def test_what_a_dropped_effect_stood_for_is_looked_for_once_more(
    monkeypatch: pytest.MonkeyPatch, hidden: str, found: bool
) -> None:
    """Of a voltage limit, warming and a ripple, drive effects took all in an exam, and none of them stood."""
    names = ("voltage_saturation", "current_loop", "ball_pass_ripple")
    effects = {name: SimpleNamespace(name=name, amplitudes=()) for name in names}
    forms = tuple(SimpleNamespace(effect=effect) for effect in effects.values())
    searches: list[tuple[str, ...]] = []
    offered: list[set[str]] = []

    def with_more(_: Any, library: Any, now: Any, ___: Any) -> Any:
        present = tuple(valued.effect.name for valued in now.effects)
        searches.append(present)
        offered.append({form.effect.name for form in library.forms})
        more = {(): names[:2], names[:1]: (names[0], hidden) if hidden else ()}.get(present, ())
        return (
            SimpleNamespace(effects=tuple(SimpleNamespace(effect=effects[n], values={}) for n in more))
            if more
            else None
        )

    selected = _searched(monkeypatch, forms, with_more, frozenset(["current_loop"]))
    assert selected == ([names[0], hidden] if found else [names[0]])
    assert len(searches) == (4 if found else 3)  # once more, and no further
    assert offered == [set(names)] * 2 + [set(names) - {"current_loop"}] * (len(searches) - 2)


@pytest.mark.parametrize(
    ("gone", "stay", "replaced", "again"),
    [
        ("a", "", "", {"b", "c"}),  # the same search would find it again
        ("ab", "", "", {"c"}),
        ("a", "b", "", {"b", "c"}),
        ("ab", "c", "", {"a", "b", "c"}),  # one of the two may have gone because of the other
        ("a", "c", "c", {"a", "b", "c"}),  # next to the other effect it may stand
    ],
)
def test_a_second_search_is_made_without_what_it_would_find_again(
    gone: str, stay: str, replaced: str, again: set[str]
) -> None:
    """Of a machine without effects a search took nine minutes, half of them for the same once more."""

    def fitted(names: str) -> Any:
        return SimpleNamespace(effects=[SimpleNamespace(effect=SimpleNamespace(name=name)) for name in names])

    forms: Any = tuple(SimpleNamespace(effect=SimpleNamespace(name=name)) for name in "abc")
    whole, found = fitted(gone + stay.replace(replaced, "")), SimpleNamespace(fitted=fitted(stay))
    library = linearised.Library(forms, cast("Any", None), (0.0, 0.0))
    others = select._other_than(library, set(gone), cast("Any", found), fitted(""), whole)
    assert {form.effect.name for form in others.forms} == again


def test_without_a_place_for_what_bends_the_others_of_its_set_are_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        refine, "refine", lambda _, __, effects, rival: SimpleNamespace(effects=effects, residual_sum_of_squares=1.0)
    )
    cable, base = (
        SimpleNamespace(
            effect=SimpleNamespace(name=name, resonant=name == "base_vibration", nonlinear=False), values={}
        )
        for name in ("cable_spring", "base_vibration")
    )
    now: Any = SimpleNamespace(model=None, effects=(), residual_sum_of_squares=2.0)
    given: Any = [cable, base]
    grown = select._grown(cast("Any", None), now, given, ())
    assert grown is not None and [valued.effect for valued in grown.effects] == [cable.effect]
    assert select._grown(cast("Any", None), now, given[1:], ()) is None


def test_an_effect_that_a_later_fit_drives_to_an_end_of_its_range_leaves_the_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else the search would find the same fit again, for ever."""
    amplitude = SimpleNamespace(name="size", low=-0.9, high=0.9)
    effects = {name: SimpleNamespace(name=name, amplitudes=[amplitude]) for name in ("coulomb_asymmetry", "dead_time")}

    def fitted(**sizes: float) -> Any:
        found = [SimpleNamespace(effect=effects[name], values={"size": size}) for name, size in sizes.items()]
        return SimpleNamespace(effects=tuple(found), model=None)

    def with_more(_: Any, library: Any, now: Any, __: Any) -> Any:
        present = {valued.effect.name for valued in now.effects}
        if present == {"coulomb_asymmetry"}:
            return fitted(coulomb_asymmetry=0.9, dead_time=0.1)
        known = {form.effect.name for form in library.forms}
        first = "coulomb_asymmetry" if "coulomb_asymmetry" in known else "dead_time"
        return None if present else fitted(**{first: 0.1})

    monkeypatch.setattr(bristle_shape, "refined", lambda _, __, kept: SimpleNamespace(effects=tuple(kept), model=None))
    forms = tuple(SimpleNamespace(effect=effect) for effect in effects.values())
    assert _searched(monkeypatch, forms, with_more) == ["dead_time"]


@pytest.mark.parametrize(("time", "expected"), [(-1e-3, False), (2e-3, True), (1e-3, False)])
def test_a_drive_without_a_delay_is_at_no_end(time: float, expected: bool) -> None:
    effect = SimpleNamespace(name="dead_time", amplitudes=[SimpleNamespace(name="time", low=-1e-3, high=2e-3)])
    assert material.at_bound(cast("Any", SimpleNamespace(effect=effect, values={"time": time}))) == expected


@pytest.mark.parametrize(("share", "alone"), [(0.9, True), (1.1, False)])
def test_one_effect_that_explains_nearly_all_of_what_several_do_is_taken_alone(
    monkeypatch: pytest.MonkeyPatch, share: float, alone: bool
) -> None:
    """`share`: of what it may leave."""
    now, together = (SimpleNamespace(residual_sum_of_squares=left) for left in (1100.0, 100.0))
    fits = {"large": SimpleNamespace(residual_sum_of_squares=100.0 + share * constants.ONE_OF_MANY * 1000.0)}
    fits["small"] = SimpleNamespace(residual_sum_of_squares=900.0)
    monkeypatch.setattr(select, "_grown", lambda e, now, added, starts: fits.get(added[0]))
    given: Any = (None, now, ["small", "large", "diverged"], [], together)
    assert select._first_of(*given) is (fits["large"] if alone else together)


@pytest.mark.parametrize(("gap", "taken"), [(1e-8, "compliance"), (2e-5, "backlash")])
def test_a_gap_of_nothing_behind_a_spring_is_a_spring(monkeypatch: pytest.MonkeyPatch, gap: float, taken: str) -> None:
    """A backlash whose gap closes in the fit is a compliance, and explains what that explains."""

    def start(name: str, **values: float) -> Any:
        sizes = [SimpleNamespace(name=next(iter(values)), typical=(1e-5,))]
        effect = SimpleNamespace(name=name, resonant=True, nonlinear=name == "backlash", amplitudes=sizes)
        return SimpleNamespace(effect=effect, values=values)

    def refined(_: Any, __: Any, effects: Any, **___: float) -> Any:
        left = {"compliance": 72625.0, "backlash": 72624.0}[effects[-1].effect.name]
        return SimpleNamespace(effects=effects, residual_sum_of_squares=left)

    monkeypatch.setattr(refine, "refine", refined)
    starts: Any = [start("compliance", share=0.4), start("backlash", gap=gap)]
    now: Any = SimpleNamespace(model=None, effects=(), residual_sum_of_squares=80063.0)
    grown: Any = select._grown(cast("Any", None), now, starts[:1], starts)
    assert grown.effects[-1].effect.name == taken


@pytest.mark.parametrize(("current", "material_one"), [(-200.0, True), (4000.0, False)])
def test_the_current_shows_a_slower_loop_whatever_is_missing_in_the_mechanics(
    monkeypatch: pytest.MonkeyPatch, current: float, material_one: bool
) -> None:
    """Next to a ball pass of a screw it explains a fifth of all that is missing, and all of what the current lacks."""
    loop = _late("current_loop", 2e-4)
    whole, shifted = (
        SimpleNamespace(effects=effects, model=None, residuals=None, residual_sum_of_squares=left)
        for effects, left in (((loop,), 194e3), ((), 222e3))
    )
    cuts = {id(whole): (1658.0, current), id(shifted): (2105.0, 7865.0)}
    monkeypatch.setattr(material, "without", lambda *_: shifted)
    monkeypatch.setattr(refine, "refine", lambda *_: shifted)
    monkeypatch.setattr(gram_matrices, "noise", lambda *_: np.array([73e3]))
    monkeypatch.setattr(linearised, "excess", lambda _, __, fitted: cuts[id(fitted)])
    monkeypatch.setattr(linearised, "strokes", lambda _: 66)
    nothing: Any = None
    assert material.is_material(nothing, _library(), cast("Any", whole), loop) is material_one


@pytest.mark.parametrize(("block", "material_one"), [("mechanics", False), ("drive", True)])
def test_mechanics_do_not_explain_what_a_current_lacks(
    monkeypatch: pytest.MonkeyPatch, block: str, material_one: bool
) -> None:
    """A base that moves was kept, as the current lacked 1 instead of 110 with it; of the effort it took nothing."""
    effect = SimpleNamespace(name="base_vibration", block=block, resonant=True, nonlinear=False)
    valued, rest, now = SimpleNamespace(effect=effect), object(), object()
    cuts = {id(rest): (86462.0, 110.0), id(now): (86450.0, -1.0)}
    monkeypatch.setattr(material, "without", lambda *_: rest)
    monkeypatch.setattr(linearised, "excess", lambda _, __, fitted: cuts[id(fitted)])
    monkeypatch.setattr(linearised, "strokes", lambda _: 66)
    nothing: Any = None
    assert material.is_material(nothing, _library(), cast("Any", now), cast("Any", valued)) is material_one


@pytest.mark.parametrize(
    ("name", "order", "gain", "dropped"),
    [
        ("base_vibration", 0.0, 13e3, "base_vibration"),  # the second mode of a base that was fitted as a load
        ("base_vibration", 0.0, 300e3, ""),
        ("current_ripple", 2.0, 17e3, "current_ripple"),  # the lead's second harmonic
        ("current_ripple", 24.0, 17e3, ""),
        ("current_ripple", 5.0, 17e3, "current_ripple"),  # a sideband of a ball pass that drifts
        ("current_ripple", 5.0, 70e3, ""),
        ("cable_spring", 0.0, 13e3, ""),
    ],
)
def test_what_may_be_a_further_part_of_an_effect_is_no_other_one(
    name: str, order: float, gain: float, dropped: str
) -> None:
    def valued(name: str, **values: float) -> Any:
        resonant = name in ("base_vibration", "compliance")
        return SimpleNamespace(effect=SimpleNamespace(name=name, resonant=resonant), values=values)

    names = {"compliance": 0.0, "lead_friction": 1.0, "ball_pass_ripple": 5.22, name: order}
    effects = tuple(valued(each, order=of_pitch) for each, of_pitch in names.items())
    gains = {"compliance": 850e3, "lead_friction": 292e3, "ball_pass_ripple": 200e3, name: gain}
    fitted: Any = SimpleNamespace(effects=effects)
    assert _further_part(Selection(fitted, (0.0, 0.0), {}, {}, gains, {})) == dropped


@pytest.mark.parametrize(("left", "dearer", "taken"), [(413.0, 0, True), (840.0, 0, False), (413.0, 8, False)])
@pytest.mark.parametrize("comparable", [True, False])
def test_a_rival_whose_own_fit_explains_more_takes_the_place(
    monkeypatch: pytest.MonkeyPatch, left: float, dearer: int, taken: bool, comparable: bool
) -> None:
    """A Stribeck friction of the exam was called viscous friction that bends: with itself as an alternative, or not.

    One that needs many values more has to explain more.
    """
    names, values = ("viscous_nonlinear", "stribeck"), dict.fromkeys(("rise", "velocity"), 1.0)
    bent, stribeck = (SimpleNamespace(effect=SimpleNamespace(name=name), values=values) for name in names)
    stribeck.values = {**values, **dict.fromkeys(range(dearer), 1.0)}
    now: Any = SimpleNamespace(model=None, effects=(bent,))
    rivals: Any = {"viscous_nonlinear": {"stribeck": stribeck} if comparable else {}}
    kin: Any = {"viscous_nonlinear": [stribeck]}
    selection = Selection(now, (860.0, 0.0), {"viscous_nonlinear": 0.77}, {}, {}, rivals)
    monkeypatch.setattr(refine, "refine", lambda _, __, effects: SimpleNamespace(effects=tuple(effects)))
    monkeypatch.setattr(bristle_shape, "beside_effects", lambda _, after: after)
    monkeypatch.setattr(linearised, "excess", lambda *_: (left, 0.0))
    monkeypatch.setattr(linearised, "strokes", lambda _: 66)
    nothing: Any = None
    found = _with_rival(nothing, nothing, selection, kin)
    assert (found is not None) is taken
    assert found is None or [valued.effect.name for valued in found.effects] == ["stribeck"]


@pytest.mark.parametrize(("left", "tried"), [(13.0, ["stribeck", "friction_lag"]), (9.0, [])])
def test_what_leaves_much_is_compared_with_all_others_over_its_coordinate(left: float, tried: list[str]) -> None:
    """Of a set with another effect, of another coordinate or block, and of what is there already, nothing is tried."""
    singles = ("cogging", "stribeck", "viscous_asymmetry", "friction_lag", "stribeck", "current_gain")
    sets = [
        SimpleNamespace(effects=frozenset(names)) for names in (("stribeck", "dwell"), *((one,) for one in singles))
    ]
    at: Any = SimpleNamespace(
        verdict=SimpleNamespace(sets=sets), values=lambda item: [(*item.effects, sets.index(item))]
    )
    shown = {"coordinate": "speed", "block": "mechanics"}
    effects = [SimpleNamespace(name=name, **shown) for name in ("viscous_nonlinear", "viscous_asymmetry")]
    bent, other = (cast("Any", SimpleNamespace(effect=effect)) for effect in effects)
    now: Any = SimpleNamespace(effects=(bent, other))
    selection = Selection(now, (left, 0.0), {}, {}, {"viscous_nonlinear": 100.0}, {})
    found: Any = _over_its_coordinate(selection, at, bent)
    assert sorted(found) == sorted(zip(tried, (2, 4), strict=False))


@pytest.mark.parametrize(("rival", "steps"), [(math.inf, 4), (80.0, 4), (20.0, 2), (-1000.0, 1)])
def test_a_fit_ends_where_no_further_step_brings_it_to_its_rival(
    rival: float, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sums of squares of 100, 90 and 85: eleven more steps of 10 come to -20, ten more of 5 to no less than 35."""
    left = iter([90.0, 85.0, 84.0, 83.9])
    taken: list[float] = []

    def step(_: Any, now: Any) -> Any:
        taken.append(next(left))
        after = SimpleNamespace(effects=(), residual_sum_of_squares=taken[-1])
        return after, now.residual_sum_of_squares - taken[-1], 0.0

    monkeypatch.setattr(refine, "at_values", lambda *_: SimpleNamespace(effects=(), residual_sum_of_squares=100.0))
    monkeypatch.setattr(refine, "step", step)
    refine.refine(cast("Any", None), cast("Any", None), (), rival=rival)
    assert len(taken) == steps


def test_every_late_drive_is_tried_anew_from_every_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each begins where it answers as late as what the model has and the time shift together: a fit may be stuck."""
    tried: list[tuple[str, float]] = []

    def fitted(_: Any, __: Any, kept: Any, **___: Any) -> Any:
        tried.append((kept[-1].effect.name, kept[-1].values["time"]))
        return SimpleNamespace(model=None, effects=kept, residual_sum_of_squares=300.0)

    monkeypatch.setattr(refine, "refine", fitted)
    model = SimpleNamespace(shift=1e-4, _replace=lambda **_: None)
    now = SimpleNamespace(model=model, effects=(_late("dead_time", 3e-4),), residual_sum_of_squares=200.0)
    library = _library("current_loop", "dead_time")
    assert drive_alikes.on_time(cast("Any", None), library, cast("Any", now)) is now
    assert {name for name, _ in tried} == {"current_loop", "dead_time"}
    assert [time for _, time in tried] == pytest.approx([4e-4] * len(tried))


@pytest.mark.parametrize(
    ("before", "after", "stands"), [(300.0, 180.0, True), (300.0, 190.0, False), (90.0, 80.0, False)]
)
def test_a_later_drive_explains_most_of_what_is_above_the_noise(
    before: float, after: float, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The noise is 100; where no more than that is left, there is nothing to explain."""
    monkeypatch.setattr(gram_matrices, "noise", lambda *_: np.array([60.0, 40.0]))
    library, fits = _library(), [SimpleNamespace(residual_sum_of_squares=x, residuals=None) for x in (before, after)]
    assert material.stands(library, *cast("Any", fits)) is stands
    if stands:
        assert after <= material.most_that_stands(library, cast("Any", fits[0]))


@pytest.mark.parametrize(("left", "alike"), [(250.0, True), (120.0, False)])
def test_another_late_drive_is_alike_where_neither_explains_what_the_other_leaves(
    left: float, alike: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A dead time leaves 300 of 1000 in the place of a lag that leaves `left`; the noise is 100."""
    monkeypatch.setattr(gram_matrices, "noise", lambda *_: np.array([60.0, 40.0]))

    def fitted(_: Any, __: Any, kept: Any, **___: Any) -> Any:
        size = 300.0 if kept else 1000.0
        return SimpleNamespace(model=model, effects=kept, residuals=None, residual_sum_of_squares=size)

    monkeypatch.setattr(refine, "refine", fitted)
    model = SimpleNamespace(shift=0.0, _replace=lambda **_: None)
    lag = _late("current_loop", 2e-4)
    now = SimpleNamespace(model=model, effects=(lag,), residuals=None, residual_sum_of_squares=left)
    names = ("current_loop", "dead_time", "stribeck")
    found = drive_alikes.without_unlike(cast("Any", None), _library(*names), cast("Any", now), lag)
    assert ("dead_time" in {form.effect.name for form in found.forms}) is alike


def test_a_set_that_leaves_what_a_function_predicts_is_tried_with_one_effect_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Effects that explain the same share the probability of the pairs: the first of these that stands is taken."""
    sets = {("a",): 0.4, ("a", "b"): 0.25, ("a", "c"): 0.2, ("d",): 0.1, (): 0.03, ("a", "e"): 0.02}
    verdict = SimpleNamespace(
        of_sets=lambda: {frozenset(names): p for names, p in sets.items()}, best=lambda item: item
    )
    effects = {name: SimpleNamespace(name=name, block="mechanics", resonant=False, nonlinear=False) for name in "abcde"}
    valued = {name: SimpleNamespace(effect=effect) for name, effect in effects.items()}
    at = SimpleNamespace(verdict=verdict, values=lambda item: [valued[name] for name in sorted(item)])
    monkeypatch.setattr(linearised, "linearised", lambda *_: at)
    monkeypatch.setattr(select, "_grown", lambda e, now, added, starts: [one.effect.name for one in added] or None)
    monkeypatch.setattr(select, "_first_of", lambda e, now, added, starts, together: together)
    tried: list[Any] = []

    def stands(e: Any, library: Any, now: Any, after: Any) -> Any:
        tried.append(after)
        return after if after == right else None

    monkeypatch.setattr(select, "_that_stands", stands)
    nothing = cast("Any", None)
    for right, expected in ((["a", "c"], 3), (["a"], 1)):
        tried.clear()
        assert select._with_more(nothing, nothing, nothing, lambda: ()) == right and len(tried) == expected
    right = ["a", "e"]  # whose odds against the best set are 1 to 20
    tried.clear()
    assert select._with_more(nothing, nothing, nothing, lambda: ()) is None and tried == [["a"], ["a", "b"], ["a", "c"]]
