r"""States of stop operators along a sampled motion: columns of a regression, compiled.

Between two samples the motion may turn round; how far it went beyond the outermost sample is taken from the parabola
through the three samples at the turn, so that the shortest element sees the whole travel::

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
    stretched = state + move
    if stretched > 1.0:
        return 1.0
    if stretched < -1.0:
        return -1.0
    return stretched


@kernel
def strains(rate: Any, states: Any, position: Any, out: Any) -> None:
    """States of elements of `rate` (j,) = 1/slip along `position` (n + 3,): ``out[:, k]`` is at ``position[k + 2]``.

    `states` (j,), at first those at ``position[1]``, change **in place** and go on into the next part of the motion.
    """
    for k in range(len(position) - 3):
        last = position[k + 1] - position[k]
        move = position[k + 2] - position[k + 1]
        coming = position[k + 3] - position[k + 2]
        # The turn lies between the two samples: seen from the first, or from the second.
        first = beyond(last, move) if abs(last) > abs(move) else 0.0
        second = beyond(move, coming) if abs(move) <= abs(coming) else 0.0
        turns = first != 0.0 or second != 0.0
        for j in range(len(rate)):
            state = states[j]
            if turns:
                state = stretch(state, first * rate[j])
                state = stretch(state, (move - first + second) * rate[j])
                state = stretch(state, -second * rate[j])
            else:
                state = stretch(state, move * rate[j])
            states[j] = state
            out[j, k] = state
