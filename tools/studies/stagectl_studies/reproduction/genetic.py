"""A genetic algorithm of the textbook kind: binary strings, tournaments, one-point crossover, mutation, one elite.

The slider paper finds its parameters by one (section 3.2) and describes it no further; scipy has none.

Source: D. E. Goldberg, Genetic Algorithms in Search, Optimization, and Machine Learning, 1989.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl_studies.reproduction import chosen

Array = NDArray[np.float64]
Strings = NDArray[np.bool_]


class Found(NamedTuple):
    """The best string of the last generation."""

    x: Array  # (k,)
    cost: float
    evaluations: int


def searched(cost: Callable[[Array], float], low: Array, high: Array, seed: int) -> Found:
    """Least `cost` of the points (k,) between `low` and `high` (k,)."""
    random = np.random.default_rng(seed)
    strings = random.random((chosen.POPULATION, len(low) * chosen.BITS)) < 0.5
    costs = _costs(cost, strings, low, high)
    for _ in range(chosen.GENERATIONS - 1):
        children = _children(strings, costs, random)
        children[0] = strings[np.argmin(costs)]  # the elite
        strings, costs = children, _costs(cost, children, low, high)
    best = int(np.argmin(costs))
    return Found(_points(strings, low, high)[best], float(costs[best]), chosen.POPULATION * chosen.GENERATIONS)


def _costs(cost: Callable[[Array], float], strings: Strings, low: Array, high: Array) -> Array:
    return np.array([cost(x) for x in _points(strings, low, high)])


def _points(strings: Strings, low: Array, high: Array) -> Array:
    """Points (m, k) of strings (m, k BITS): each parameter a fraction of its range, in binary digits."""
    digits = strings.reshape(len(strings), len(low), chosen.BITS)
    share = digits @ 2.0 ** np.arange(chosen.BITS) / (2.0**chosen.BITS - 1.0)
    return np.asarray(low + share * (high - low), dtype=np.float64)


def _children(strings: Strings, costs: Array, random: np.random.Generator) -> Strings:
    """A new generation (m, n): parents by tournament, their ends exchanged, single digits turned over."""
    count, length = strings.shape
    drawn = random.integers(count, size=(count, chosen.TOURNAMENT))
    parents = strings[drawn[np.arange(count), np.argmin(costs[drawn], axis=1)]]
    cut = random.integers(1, length, size=count // 2)
    cut[random.random(count // 2) > chosen.CROSSOVER] = length  # nothing exchanged
    behind = np.arange(length) >= cut[:, None]
    first, second = parents[: count // 2], parents[count // 2 : 2 * (count // 2)]
    children = np.concatenate([np.where(behind, second, first), np.where(behind, first, second)])
    children = np.concatenate([children, parents[len(children) :]])
    return np.asarray(children ^ (random.random((count, length)) < 1.0 / length), dtype=np.bool_)
