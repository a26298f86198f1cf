"""Rates and medians with 95 % intervals that hold for small numbers."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import binom

Z = 1.959963984540054  # 97.5 % of the normal distribution


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Score interval of a rate (Wilson, JASA 22, 1927, p. 209); 0 to 1 where nothing was counted."""
    if count == 0:
        return 0.0, 1.0
    p, z2 = hits / count, Z * Z
    centre = (p + z2 / (2.0 * count)) / (1.0 + z2 / count)
    half = Z / (1.0 + z2 / count) * math.sqrt(p * (1.0 - p) / count + z2 / (4.0 * count * count))
    return (0.0 if hits == 0 else centre - half), (1.0 if hits == count else centre + half)


def median(values: Sequence[float]) -> tuple[float, float, float]:
    """Median and the order statistics that hold it with at least 95 % (of fewer than six values: all there is)."""
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    n = ordered.size
    if n == 0:
        return math.nan, math.nan, math.nan
    low = max(int(binom.ppf(0.025, n, 0.5)) - 1, 0)
    return float(np.median(ordered)), float(ordered[low]), float(ordered[n - 1 - low])


def mean(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean and its normal interval."""
    each = np.asarray(values, dtype=np.float64)
    if each.size == 0:
        return math.nan, math.nan, math.nan
    centre = float(each.mean())
    half = Z * float(each.std(ddof=1)) / math.sqrt(each.size) if each.size > 1 else math.nan
    return centre, centre - half, centre + half
