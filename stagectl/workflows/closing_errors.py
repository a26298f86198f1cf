"""The tracking errors that judge a gap's closing: by motion, `compare`'s variants by name; each motion counts alike."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special  # not `stats`, which takes a second to import

from stagectl.paired_comparison import CONFIDENCE, SAME

Errors = dict[str, dict[str, dict[str, Any]]]
BEFORE, AFTER, WITHOUT = "before", "after", "without "  # variants; the last with an effect's name behind it
GROWN = 1.1  # of the error before: beyond it a motion counts as worse; chosen: as much as a new motion may differ


def smaller(errors: Errors, than: str = BEFORE, variant: str = AFTER) -> bool:
    """Whether the rms error of a variant is smaller `than` that of another, by more than repeats vary where they do.

    Paired repeat by repeat, in the logarithm.  What varies is the scatter about the mean of each motion, pooled over
    the motions: how far they differ from each other is no chance.
    """
    gains = np.log(_each(errors, than) / _each(errors, variant))
    mean, freedom = float(np.mean(gains)), gains.size - len(gains)
    scatter = float(np.sum((gains - gains.mean(axis=1, keepdims=True)) ** 2))
    if scatter <= (SAME * mean) ** 2:
        return mean > 0.0
    error = math.sqrt(scatter / freedom / gains.size)
    return float(special.stdtr(freedom, mean / error)) >= 0.5 + 0.5 * CONFIDENCE


def refusal(errors: Errors) -> str:
    """Why the last model is not kept; empty where it is."""
    for name, motion in errors.items():
        growth = motion[AFTER]["rms"]["mean"] / motion[BEFORE]["rms"]["mean"]
        if growth > GROWN:
            return f"with the last model the error of {name} was {growth:.2g} times as large: it is not kept"
    if (growth := _peak_growth(errors)) > GROWN:
        return f"with the last model the largest error of all motions was {growth:.2g} times as large: it is not kept"
    if not smaller(errors):
        return "the last model made the error no smaller than its repeats vary: it is not kept"
    return ""


def _peak_growth(errors: Errors) -> float:
    """By what the largest error of all motions grew in every repeat: a peak varies by chance more than a mean square.

    The peak of one motion may grow below it: a model that halves each rms may move a peak to where there was none.
    """
    before, after = (_each(errors, variant, "peak").max(axis=0) for variant in (BEFORE, AFTER))
    return float(np.min(after / before))


def _each(errors: Errors, variant: str, measure: str = "rms") -> NDArray[np.float64]:
    """Tracking errors (m | rad) of all motions and repeats."""
    return np.array([motion[variant][measure]["values"] for motion in errors.values()])


def level(errors: Errors, variant: str, measure: str = "rms") -> float:
    """Geometric mean of the tracking error (m | rad) over all motions, in the mean square of their repeats."""
    return float(np.sqrt(np.mean(np.exp(np.mean(np.log(_each(errors, variant, measure)), axis=0)) ** 2)))
