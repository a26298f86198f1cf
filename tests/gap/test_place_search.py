"""Where the fit of an effect begins whose columns bend."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from stagectl.gap.effects.effect import Amplitude, Definition, Shape
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.selection import linearised, place_search, refine, starting_places, thresholds
from stagectl.gap.selection.candidates import Form


@pytest.mark.parametrize(
    ("excess", "unordered", "searches"), [(200.0, False, True), (190.0, False, False), (190.0, True, True)]
)
def test_the_place_where_a_fit_begins_is_looked_for_where_most_is_missing(
    monkeypatch: pytest.MonkeyPatch, excess: float, unordered: bool, searches: bool
) -> None:
    """It runs on the short run that holds what is missing; of its places that one counts which leaves least on both.

    They come in that order, without those that diverge; of what hits stops come all.  They are looked for where more is
    left than the noise may scatter by, 1.96 times 100 here, or where the loop shows that something is missing.
    """
    effects = [SimpleNamespace(name=name, resonant=True, nonlinear=name == "c") for name in ("a", "b", "c")]
    forms = [SimpleNamespace(effect=effect) for effect in effects for _ in range(2)]
    runs = [SimpleNamespace(rows=rows, weight=np.ones(2)) for rows in (100, 1000)]
    left = [[np.full((2, 2), size)] for size in (3.0, 2.0)]
    base = SimpleNamespace(before=left, after=left, products=SimpleNamespace(parts=left, _replace=SimpleNamespace))
    base._replace = lambda **parts: SimpleNamespace(**{**vars(base), **parts})
    products = SimpleNamespace(parts=left, _replace=SimpleNamespace)
    library: Any = SimpleNamespace(forms=forms, products=products, unordered=lambda *_: unordered)
    library._replace = lambda **parts: SimpleNamespace(forms=forms, **parts)
    now: Any = SimpleNamespace(effects=(), residuals=left, _replace=SimpleNamespace)
    searched: list[tuple[int, int, int]] = []

    def places(e: Any, library: Any, now: Any, grid: Any) -> Any:
        searched.append((len(e.runs), len(library.products.parts), len(now.residuals)))
        return [SimpleNamespace(effect=grid[0].effect, place=place) for place in range(3)]

    # Three half strokes of the first run, and two of the second: what its repeats differ by is mostly a drift.
    strokes, floor = np.array([80.0, 80.0, 80.0, 900.0, 900.0]), np.array([10.0, 10.0, 10.0, 1000.0, 1000.0])
    remains = linearised.Remains(strokes, floor, np.ones(5), (3, 2), 0.0, excess=(excess, 1e6))
    on_all = {"a": [5.0, 4.0, 6.0], "b": [math.inf] * 3, "c": [2.0, 3.0, math.inf]}
    monkeypatch.setattr(place_search, "places", places)
    monkeypatch.setattr(place_search, "left_by", lambda *_: lambda place: on_all[place.effect.name][place.place])
    monkeypatch.setattr(linearised, "remains", lambda *_: remains)
    monkeypatch.setattr(linearised, "scatter", lambda *_: 100.0)
    e = refine.Evidence(cast("Any", runs), cast("Any", base), left)
    found: list[Any] = starting_places.starting_places(e, library, now)
    assert [(valued.effect.name, valued.place) for valued in found] == (
        [("c", 0), ("c", 1), ("a", 1)] if searches else []
    )
    assert searched == [(1, 1, 1)] * (3 if searches else 0)


def test_a_search_finds_the_deepest_of_many_minima(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a gap of 0.004 that leaves 100 + 3000 times the squared distance, with ripples of 40 around that."""
    true = {"gap": 0.004, "share": 0.17}
    seen: list[dict[str, float]] = []

    def left(place: Any) -> float:
        seen.append(dict(place.values))
        off = [math.log(place.values["gap"] / true["gap"]), 3.0 * (place.values["share"] - true["share"])]
        return 100.0 + math.fsum(3000.0 * x * x + 40.0 * (1.0 - math.cos(20.0 * x)) for x in off)

    gap = Amplitude("gap", "", (0.001, 0.05), 0.0, 1.0)
    share = Shape("share", "", (0.9, 0.4), True, 0.0, 1.0, share=True)
    effect = Definition("backlash", "mechanics", "", (gap,), (share,), lambda p, _: p)
    grid = [Form(effect, {"share": x}, (size,), ()) for x in share.grid for size in gap.typical]
    monkeypatch.setattr(place_search, "left_by", lambda *_: left)
    nothing = cast("Any", None)
    found = place_search.places(nothing, nothing, nothing, grid)
    assert found[0].values["gap"] == pytest.approx(true["gap"], rel=0.15)
    assert found[0].values["share"] == pytest.approx(true["share"], abs=0.05)
    assert left(found[0]) <= left(found[1])
    for form in grid:
        assert any(place == pytest.approx(form.values(form.typical)) for place in seen)
    wider = thresholds.SEARCH_WIDER
    assert all(0.001 / wider <= place["gap"] <= 0.05 * wider * 1.001 and 0.0 <= place["share"] <= 1.0 for place in seen)


@pytest.mark.parametrize(("low", "high"), [(20.0, 20.0), (0.0, 0.0), (0.0, 1.0), (2.0, 50.0)])
def test_an_axis_may_hold_one_value_or_begin_at_none(low: float, high: float) -> None:
    """Rows of 30 Hz tell one frequency of a drive train; a machine without friction has no rolling zone."""
    axis = place_search._axis("resonance", (low, high), (low, high))
    assert [axis.value(axis.along(value)) for value in (low, high)] == pytest.approx([low, high])


@pytest.mark.parametrize("repeats", [2, 4, 8])
def test_the_excess_of_noise_scatters_as_it_is_said_to(repeats: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of white noise of unit size: over what its mean leaves above what repeats differ by, in 2,000 sessions."""
    random, samples = np.random.default_rng(repeats), 50
    noise = random.standard_normal((2000, repeats, samples))
    apart = np.sum((noise - noise.mean(axis=1, keepdims=True)) ** 2, axis=(1, 2)) * repeats / (repeats - 1)
    excess = np.sum(noise**2, axis=(1, 2)) - apart
    monkeypatch.setattr(gram_matrices, "noise", lambda *_: np.array([apart.mean(), 1e9]))
    e: Any = SimpleNamespace(deviations=[[None] * repeats] * 3)
    given: Any = SimpleNamespace(products=None, residuals=None)
    assert linearised.scatter(e, given, given) == pytest.approx(excess.std(), rel=0.1)
