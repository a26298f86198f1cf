"""Fair shares of a joint gain.

Source: L. S. Shapley, A value for n-person games, Contributions to the Theory of Games II, 1953.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Sequence


def shapley(players: Sequence[str], remaining: Callable[[frozenset[str]], float]) -> dict[str, float]:
    """What each player takes from `remaining`, averaged over the orders in which the players may be added.

    The shares sum to what all players together take.  `remaining` is called once for each subset.
    """
    worth = functools.cache(remaining)
    count = len(players)
    shares = {}
    for player in players:
        others = [other for other in players if other != player]
        total = 0.0
        for size in range(count):
            weight = math.factorial(size) * math.factorial(count - size - 1) / math.factorial(count)
            for members in map(frozenset, itertools.combinations(others, size)):
                total += weight * (worth(members) - worth(members | {player}))
        shares[player] = total
    return shares
