"""Whether the force of a record is of the same instants as its position, which a regression takes for granted.

A force that the log holds late by tau is, to first order, ``F = X p - tau d(X p)/dt``: the slope of what was fitted is
one more column, without the noise of the force.  What it takes from the inertia is in no interval.
"""

import numpy as np
from numpy.typing import NDArray

from stagectl.identification import standard_errors
from stagectl.identification.capture import Array
from stagectl.identification.result import Note, Topic
from stagectl.identification.thresholds import NORMAL_95
from stagectl.number_format import duration


def not_same_instant(regressor: Array, slopes: Array, force: Array, ends: NDArray[np.int64]) -> str:
    """A note where the `force` (m,) is late or early and the inertia is wrong by that; empty where neither is seen.

    `regressor` (m, k) has the acceleration first, `slopes` (m, k) are those of its columns.
    """
    plain = standard_errors.solved(regressor, force, ends)
    whole = standard_errors.solved(np.column_stack([regressor, -slopes @ plain.values]), force, ends)
    late, inertia, corrected = whole.values[-1], plain.values[0], whole.values[0]
    seen = abs(late) > NORMAL_95 * np.sqrt(whole.covariance[-1, -1])
    if not seen or abs(corrected - inertia) <= NORMAL_95 * np.sqrt(plain.covariance[0, 0]):
        return ""
    text = (
        f"the force is {duration(abs(late))} {'late' if late > 0.0 else 'early'} beside the position, for which a "
        f"regression has no parameter: with that, the inertia is {corrected / inertia:.3g} times as large, beyond "
        "its interval; identify with `simultaneous`, which finds the delay"
    )
    return Note(Topic.LATE, text)
