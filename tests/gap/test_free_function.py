"""A function that is free beside every fit takes what it can explain, and nothing else."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from stagectl.gap import conclusions_that_hold
from stagectl.gap.inference import search_beside
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.model_tracking import MeasuredPath
from stagectl.gap.selection import linearised, refine, select
from stagectl.gap.selection.free_function import FreeFunction

ROWS, REPEATS, NAMES = 60, 2, ("beside.a", "beside.b")
DEVIATION, POWER = 0.5, 0.25


def _beside(source: np.random.Generator) -> tuple[list[Run], FreeFunction]:
    path = MeasuredPath(np.zeros((ROWS, 3)), 0.0, 5e-4)
    cluster = np.repeat(np.arange(4), ROWS // 4)
    runs = [Run("sine", (), (path,) * REPEATS, path, source.random(ROWS), cluster) for _ in range(2)]
    columns = [{name: [source.standard_normal((ROWS, 2))] for name in NAMES} for _ in runs]
    return runs, FreeFunction(columns, gram_matrices.products(runs, columns), DEVIATION, POWER)


@pytest.mark.parametrize("chosen", [(True, True), (True, False), (False, True)])
def test_it_explains_what_least_squares_with_its_prior_do(chosen: tuple[bool, bool]) -> None:
    source = np.random.default_rng(1)
    runs, beside = _beside(source)
    residuals = [[source.standard_normal((ROWS, 2)) for _ in range(REPEATS)] for _ in runs]
    kept = [k for k in range(2) if chosen[k]]
    weight = [np.repeat(runs[k].weight, 2) for k in kept for _ in range(REPEATS)]
    x = np.concatenate([np.column_stack([beside.columns[k][name][0].ravel() for name in NAMES])
                        for k in kept for _ in range(REPEATS)])  # fmt: skip
    r = np.concatenate([residual.ravel() for k in kept for residual in residuals[k]])
    whole = np.concatenate(weight)
    x, r = x * whole[:, None], r * whole
    size = np.linalg.solve(x.T @ x + np.eye(2) / (POWER * DEVIATION**2), x.T @ r)
    left = float(np.sum((r - x @ size) ** 2) + size @ size / (POWER * DEVIATION**2))
    assert beside.on(np.array(chosen)).explained([residuals[k] for k in kept]) == pytest.approx(r @ r - left, rel=1e-6)


@pytest.mark.parametrize(
    ("share", "first", "beside", "expected"),
    [
        (0.9, (), ("drift",), ("drift",)),  # hidden until the function is there
        (0.9, ("cogging",), ("cogging", "drift"), ("cogging", "drift")),
        (0.9, ("cogging",), ("drift",), ("cogging",)),  # what the function takes as well stands without it
        (0.9, (), (), ()),
        (0.0, (), ("drift",), ()),  # no function predicts anything: nothing is looked for beside one
    ],
)
def test_the_search_beside_an_unknown_adds_effects_and_takes_none(
    share: float, first: tuple[str, ...], beside: tuple[str, ...], expected: tuple[str, ...], monkeypatch: Any
) -> None:
    def selected(names: tuple[str, ...]) -> Any:
        effects = tuple(SimpleNamespace(effect=SimpleNamespace(name=name)) for name in names)
        return SimpleNamespace(fitted=SimpleNamespace(effects=effects, model=None))

    function = SimpleNamespace(basis=SimpleNamespace(coordinate="position"))
    monkeypatch.setattr(select, "select", lambda *_: selected(first))
    monkeypatch.setattr(select, "select_from", lambda *_: selected(beside))
    monkeypatch.setattr(refine, "refine", lambda *_: None)
    monkeypatch.setattr(search_beside, "_likeliest", lambda *_: function)
    monkeypatch.setattr(search_beside, "_beside", lambda *_: ("evidence beside", "library beside"))
    library = cast("Any", SimpleNamespace(predict=lambda *_: linearised.Predicted((1.0, 0.0), share)))
    found, *others = search_beside.searched(cast("Any", "evidence"), library, cast("Any", None), lambda _: None)
    names = tuple(valued.effect.name for valued in found.selected.fitted.effects)
    assert names == expected
    assert (found.evidence == "evidence beside") == (names != first) == bool(others)


@pytest.mark.parametrize(("borne_out", "effects"), [(True, ("cogging", "drift")), (False, ("cogging",))])
def test_what_is_not_borne_out_next_to_a_function_leaves_what_stands_without_it(
    borne_out: bool, effects: tuple[str, ...], monkeypatch: Any
) -> None:
    beside, without = (
        search_beside.Searched(cast("Any", name), cast("Any", None), cast("Any", names), frozenset({"cogging"}))
        for name, names in (("beside", ("cogging", "drift")), ("alone", ("cogging",)))
    )

    def settled(found: Any, *_: Any) -> Any:
        more = frozenset({"drift"}) if found is beside and borne_out else frozenset[str]()
        return found.evidence, SimpleNamespace(beside=more, effects=found.selected)

    monkeypatch.setattr(search_beside, "searched", lambda *_: [beside, without])
    monkeypatch.setattr(conclusions_that_hold, "_borne_out", settled)
    _, selected = conclusions_that_hold.standing(*cast("Any", ("evidence", None, None, None)))
    assert cast("Any", selected).effects == effects
