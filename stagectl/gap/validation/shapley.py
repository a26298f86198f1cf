"""The gap divided among the parts of a model by what each takes of it, averaged over all orders of adding them."""

import functools
import itertools
import math
from collections.abc import Callable, Sequence

from stagectl.gap.result.diagnosis import NOISE, UNEXPLAINED, Gap


def shapley(players: Sequence[str], remaining: Callable[[frozenset[str]], float]) -> dict[str, float]:
    """What each player takes from `remaining`, averaged over the orders in which the players may be added.

    The shares sum to what all players together take.  `remaining` is called once for each subset.

    Source: L. S. Shapley, A value for n-person games, Contributions to the Theory of Games II, 1953.
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


def scaled(taken: dict[str, float], gap: Gap) -> dict[str, float]:
    """Shares of the squared gap before, in proportion to what each part has `taken`; with the rest they sum to one."""
    count, whole = sum(taken.values()), gap.before**2
    if not whole > 0.0:
        return {**dict.fromkeys(taken, 0.0), UNEXPLAINED: 0.0, NOISE: 1.0}
    scale = (whole - gap.after**2) / count if abs(count) > 0.0 else 0.0
    shares = {name: value * scale / whole for name, value in taken.items()}
    noise = min(gap.floor**2 / whole, 1.0)
    rest = 1.0 - noise - sum(shares.values())
    return {**shares, UNEXPLAINED: shares.get(UNEXPLAINED, 0.0) + rest, NOISE: noise}
