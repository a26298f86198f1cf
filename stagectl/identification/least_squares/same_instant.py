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
    found, deviation = _solved(regressor, force, ends)
    all_found, all_deviations = _solved(np.column_stack([regressor, -slopes @ found]), force, ends)
    late, inertia, corrected = all_found[-1], found[0], all_found[0]
    if abs(late) <= NORMAL_95 * all_deviations[-1] or abs(corrected - inertia) <= NORMAL_95 * deviation[0]:
        return ""
    text = (
        f"the force is {duration(abs(late))} {'late' if late > 0.0 else 'early'} beside the position, for which a "
        f"regression has no parameter: with that, the inertia is {corrected / inertia:.3g} times as large, beyond "
        "its interval; identify with `simultaneous`, which finds the delay"
    )
    return Note(Topic.LATE, text)


def _solved(columns: Array, force: Array, ends: NDArray[np.int64]) -> tuple[Array, Array]:
    """Coefficients (k,) of the `columns` (m, k) and their standard deviations."""
    length = np.linalg.norm(columns, axis=0) + 1e-300
    unit = columns / length
    scaled, *_ = np.linalg.lstsq(unit, force, rcond=None)
    variance = np.diag(standard_errors.covariance(unit, force - unit @ scaled, ends))
    return scaled / length, np.sqrt(variance) / length
