r"""The state of a stop operator along a sampled motion: a column of a regression, compiled.

Between two samples the motion may turn round; how far it went beyond the outermost sample is taken from the parabola
through the three samples at the turn, so that a short element sees the whole travel::

        x      __             turn `beyond` the outermost sample
        |    o    o
        |  /        \
        +-------------> t
"""

from __future__ import annotations

from typing import Any

from stagectl.kernels.jit import kernel


@kernel
def beyond(before: float, after: float) -> float:
    """Travel past a sample at which the motion turns: `before` and `after` are the moves to it and from it.

    ``(before + after)^2 / (8 |after - before|)`` in the direction of `before`; 0 where the motion does not turn.
    """
    if before * after >= 0.0:
        return 0.0
    both = before + after
    far = both * both / (8.0 * abs(after - before))
    return far if before > 0.0 else -far


@kernel
def stretch(state: float, move: float) -> float:
    """State in [-1, 1] of one element after `move`, in units of its slip."""
    return min(max(state + move, -1.0), 1.0)


@kernel
def strain(rate: float, position: Any, out: Any) -> None:
    """Fill `out` (n,) with the state of an element of `rate` = 1/slip along ``position[2:-1]`` (n,), from rest."""
    state = 0.0
    for k in range(len(out)):
        last = position[k + 1] - position[k]
        move = position[k + 2] - position[k + 1]
        coming = position[k + 3] - position[k + 2]
        # The turn lies between the two samples: seen from the first, or from the second.
        first = beyond(last, move) if abs(last) > abs(move) else 0.0
        second = beyond(move, coming) if abs(move) <= abs(coming) else 0.0
        state = stretch(state, first * rate)
        state = stretch(state, (move - first + second) * rate)
        state = stretch(state, -second * rate)
        out[k] = state
