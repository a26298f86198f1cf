"""An effect that only one experiment carries is not found again without it."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.gap.effects.effect import Amplitude, Definition
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.selection.candidates import Form
from stagectl.gap.selection.swap_tests import inclusion

CLUSTERS, EXPERIMENTS = 60, 5


def _grams(carried_by: int, seen_in: int = EXPERIMENTS) -> Grams:
    """Residuals with a column of unit amplitude in the first `carried_by` experiments, and noise in all.

    The column is there in the first `seen_in` experiments.
    """
    source = np.random.default_rng(2)
    squares = []
    for k in range(CLUSTERS):
        column = source.standard_normal(50) * (k % EXPERIMENTS < seen_in)
        residual = source.standard_normal(50) + (column if k % EXPERIMENTS < carried_by else 0.0)
        z = np.stack([np.ones(50), column, residual])
        squares.append(z @ z.T)
    each = np.arange(CLUSTERS)
    floor = np.full((CLUSTERS, 2), [45.0, 0.0])  # a tenth of the noise is no noise of repeats
    nothing = np.zeros((CLUSTERS, 3, 3))
    return Grams(
        ("constant", "effect.size"), np.array(squares), nothing, floor, each % EXPERIMENTS, each // EXPERIMENTS
    )


@pytest.mark.parametrize(("carried_by", "low", "high"), [(5, 1.0, 1.0), (1, 0.5, 0.8), (0, 0.0, 0.05)])
def test_inclusion_over_experiments(carried_by: int, low: float, high: float) -> None:
    effect = Definition("effect", "mechanics", "none", (Amplitude("size", "", (1.0,)),), (), lambda p, _: p)
    form = Form(effect, {}, (1.0,), ("effect.size",))
    assert low <= inclusion(_grams(carried_by), [0], [form], 0.1, 20) <= high


def test_an_experiment_that_excites_it_alone_is_not_missed() -> None:
    """A limit that one motion reaches: the other motions say nothing against it."""
    effect = Definition("effect", "mechanics", "none", (Amplitude("size", "", (1.0,)),), (), lambda p, _: p)
    form = Form(effect, {}, (1.0,), ("effect.size",))
    assert inclusion(_grams(1, seen_in=1), [0], [form], 0.1, 20) > 0.95


def test_the_base_may_differ_with_and_without_the_effect() -> None:
    """A nuisance that the effect had moved leaves a large constant; it is partialled out and does not count."""
    effect = Definition("effect", "mechanics", "none", (Amplitude("size", "", (1.0,)),), (), lambda p, _: p)
    form = Form(effect, {}, (1.0,), ("effect.size",))
    g = _grams(EXPERIMENTS)
    moved = g.effort.copy()
    shift = np.array([30.0, 0.0])  # of the residual along the constant, in each half stroke
    moved[:, :2, 2] += g.effort[:, :2, :2] @ shift
    moved[:, 2, :2] = moved[:, :2, 2]
    moved[:, 2, 2] += 2.0 * g.effort[:, 2, :2] @ shift + shift @ (g.effort[:, :2, :2] @ shift).T
    assert inclusion(g._replace(effort=moved), [0], [form], 0.1, 20) == inclusion(g, [0], [form], 0.1, 20) == 1.0
