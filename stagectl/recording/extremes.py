"""Fewer points with no peak lost: the lowest and the highest value of each bucket of rows."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Extremes(NamedTuple):
    """Buckets of rows, one after the other."""

    first: int  # number of the first bucket's first row
    size: int  # rows a bucket; the last one may have fewer
    low: Array  # (channels, buckets), NaN where a bucket holds nothing but NaN
    high: Array


def extremes(rows: Array, first: int, size: int) -> Extremes:
    """Lowest and highest of every `size` rows of `rows` (n, channels), whose first has the number `first`.

    NaN is skipped, so that one row without an answer hides no peak next to it.
    """
    if size == 1:
        return Extremes(first, 1, rows.T, rows.T)
    begins = np.arange(0, len(rows), size)
    return Extremes(first, size, np.fmin.reduceat(rows, begins).T, np.fmax.reduceat(rows, begins).T)
