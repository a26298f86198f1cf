"""Plain least squares or instruments: the plain one is the sharper, and wrong where a controller answered to noise.

Without that, both find the same up to chance, and the plain one's variance is the smaller.  The difference of the two
then has the variance of the one less that of the other, ``V = V_instruments - V_plain``; parameters that differ by
more show that noise has gone round the loop, and only the instruments are free of it.

Source: J. A. Hausman, Specification Tests in Econometrics, Econometrica 46(6), 1978.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stagectl.identification.capture import Array
from stagectl.identification.simultaneous.delay_search import Fit
from stagectl.identification.simultaneous.intervals import NAMES, Known
from stagectl.identification.simultaneous.regressors import FREE, ONE

CHANCE = 3.0  # standard deviations; a smaller difference goes into the interval, so nothing is lost by not seeing it


class Preference(NamedTuple):
    """Whether the plain fit stands, how it differs from that by instruments, and a note that says so."""

    plain: bool
    difference: Array  # (5,) of NAMES
    note: str


def preferred(plain: tuple[Fit, Known], told: tuple[Fit, Known]) -> Preference:
    """Which of the two fits stands; an undecided difference is to be added to the interval of the plain one."""
    difference = values(plain[0]) - values(told[0])
    own, other = (np.diag(known.covariance) for _, known in (plain, told))
    variance = np.where(other > own, other - own, other)
    apart = [
        f"{name} by {abs(step) / math.sqrt(size):.2g} standard deviations"
        for name, step, size in zip(NAMES, difference, variance, strict=True)
        if name not in ("coulomb", "offset") and size > 0.0 and abs(step) > CHANCE * math.sqrt(size)
    ]
    if apart:
        return Preference(
            False,
            difference,
            "reference: used as an instrument (two-stage least squares), as without it the answer differs by more "
            f"than chance ({', '.join(apart)}): the controller answered to noise",
        )
    return Preference(
        True,
        difference,
        "reference: instruments made from it (two-stage least squares) find the same up to chance, so they are not "
        "used; the intervals hold what they find differently",
    )


def values(fit: Fit) -> Array:
    """Parameters (5,) of NAMES."""
    theta = fit.theta
    return np.array([theta[0], theta[1], theta[FREE:].sum(), theta[ONE], fit.delay])
