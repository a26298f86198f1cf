"""Shares of overlapping effects: they sum to the whole, and each is Shapley's value over all sets of effects."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.gap.effects.library import left_out
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.workflows.closing_errors import AFTER, BEFORE, REST, WITHOUT, Share, shares_of
from tests.compensation.test_model_effects import DEFINITIONS, MOTIONS, having

SIZES = {"viscous_nonlinear": 0.3, "load_friction": 1.0, "cogging": 1.0}  # of the typical ones; the first two overlap
EFFECTS = tuple(SIZES)


def test_shares_of_a_simulated_machine_are_those_over_all_sets(ball_screw: Setup) -> None:
    stage = ball_screw.stage
    for name, times in SIZES.items():
        stage = having(stage, DEFINITIONS[name], times)
    machine = ball_screw._replace(stage=stage)

    def trace(absent: tuple[str, ...]) -> NDArray[np.float64]:
        known = machine._replace(stage=left_out(stage, absent))
        laid_out = plan(known, MOTIONS["sine of 5 mm"], known.controller.feedforward)
        return simulate(known, laid_out, known.controller.law, machine)["error"][None]

    squares = {
        frozenset(absent): float(np.sum(trace(absent) ** 2))
        for count in range(len(EFFECTS) + 1)
        for absent in itertools.combinations(EFFECTS, count)
    }
    traces = {BEFORE: trace(EFFECTS), AFTER: trace(())} | {f"{WITHOUT}{name}": trace((name,)) for name in EFFECTS}
    found = shares_of([traces], EFFECTS)
    whole = squares[frozenset(EFFECTS)] - squares[frozenset()]
    assert sum(one.share for one in found.values()) == pytest.approx(1.0, abs=1e-12)
    assert abs(found[REST].share) < 0.02
    for name in EFFECTS:
        assert found[name].share == pytest.approx(exhaustive(squares, name) / whole, abs=0.02)
    alone = sum(squares[frozenset({name})] - squares[frozenset()] for name in EFFECTS) / whole
    assert abs(alone - 1.0) > 0.1  # they overlap: what leaving each out costs does not sum to the whole


def exhaustive(squares: dict[frozenset[str], float], name: str) -> float:
    """Shapley's value of one effect, by its definition; `squares` by what is absent."""
    others, n, value = [other for other in EFFECTS if other != name], len(EFFECTS), 0.0
    for count in range(n):
        weight = math.factorial(count) * math.factorial(n - 1 - count) / math.factorial(n)
        for absent in itertools.combinations(others, count):
            value += weight * (squares[frozenset({*absent, name})] - squares[frozenset(absent)])
    return value


def noisy(seed: int, repeats: int) -> dict[str, Share]:
    """Two effects that overlap by half, in noise as large as what is left: the shares are 0.6 and 0.4 by hand.

    a = 0, d_1 = (2, 0), d_2 = (1, 1)  ->  b = (3, 1), <d_1, b> = 6, <d_2, b> = 4.
    """
    source = np.random.default_rng(seed)
    traces = {BEFORE: (3.0, 1.0), AFTER: (0.0, 0.0), f"{WITHOUT}one": (2.0, 0.0), f"{WITHOUT}two": (1.0, 1.0)}
    each = {name: np.repeat(x, 50) + source.standard_normal((repeats, 100)) for name, x in traces.items()}
    return shares_of([each], ("one", "two"))


def test_noise_is_no_error_and_the_interval_holds_what_is_true() -> None:
    tried = [noisy(seed, 4) for seed in range(400)]
    for name, true in (("one", 0.6), ("two", 0.4), (REST, 0.0)):
        assert np.mean([found[name].share for found in tried]) == pytest.approx(true, abs=0.01)
        inside = np.mean([low < true < high for found in tried if (interval := found[name].interval)
                          for low, high in (interval,)])  # fmt: skip
        assert 0.90 < inside < 0.99
    assert all(sum(one.share for one in found.values()) == pytest.approx(1.0) for found in tried)


def test_few_repeats_have_no_interval_and_no_gain_has_no_shares() -> None:
    assert all(one.interval is None for one in noisy(1, 2).values())
    grown = {BEFORE: np.ones((2, 5)), AFTER: 2.0 * np.ones((2, 5))}
    assert shares_of([grown], ()) == {}


def test_without_a_dropped_effect_the_others_share_what_is_left() -> None:
    """a = (0, 0), b = (4, 1), d_1 = (2, 0), d_2 = (1, 1), the rest (1, 0); without the second a = (1, 1)."""
    traces = {BEFORE: (4.0, 1.0), AFTER: (0.0, 0.0), f"{WITHOUT}one": (2.0, 0.0), f"{WITHOUT}two": (1.0, 1.0)}
    each = {name: np.array([x]) for name, x in traces.items()}
    whole = {name: one.share for name, one in shares_of([each], ("one", "two")).items()}
    assert whole == pytest.approx({"one": 8.0 / 17.0, "two": 5.0 / 17.0, REST: 4.0 / 17.0})
    left = {name: one.share for name, one in shares_of([each], ("one",), ("two",)).items()}
    assert left == pytest.approx({"one": 10.0 / 15.0, REST: 5.0 / 15.0})
