"""Friction that drifts with temperature and wear: what to compensate now, from looks at the axis while it works.

::

    a look: identified Coulomb friction, tracking error of each leg
                        |
        FrictionWatch.see  -->  control.friction_scale, and why

A new scale is on trial until the next look at the same motion.  If the error has not become smaller then, the scale
before it comes back and the watch ends: it is not the friction that has changed.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special  # not `stats`, which takes a second to import

from stagectl.compensation.legs import runs_of
from stagectl.evaluation import latched_reference, tracking_error

Array = NDArray[np.float64]
CONFIDENCE = 0.95  # of the interval of a change; convention
SAME_MOTION = 0.05  # relative difference of the peak speed up to which legs are compared; repeats differ by < 0.01
SHORTEST_LEG = 8  # rows between two reversals; fewer have no rms error worth the name
FEWEST_LEGS = 3  # of each look: two have hardly an interval


class Look(NamedTuple):
    """What some seconds of the axis at work show."""

    coulomb: float  # N m | N
    low: float  # of its 95 % interval
    high: float
    legs: Array  # (n,) rms tracking error from one reversal to the next, of the fastest legs (m | rad of travel)
    speed: float  # of those legs (axis units/s)


class Verdict(NamedTuple):
    """What is to be compensated from the next motion on."""

    scale: float
    words: str
    ended: bool = False  # the watch can do nothing more


def legs(rows: NDArray[Any], meta: dict[str, Any]) -> tuple[Array, float]:
    """The rms tracking error (n,) of each whole leg that is as fast as the fastest (m | rad), and that speed."""
    reference = latched_reference(rows, meta)
    error = tracking_error(rows, meta)
    velocity = np.gradient(reference, meta["dt"])
    speed, last = np.abs(velocity), len(velocity) - 1
    runs = [
        run for run in runs_of(velocity, 0.0) if run.first > 0 and run.last < last
    ]  # what the record cuts is no leg
    whole = [slice(run.first, run.last + 1) for run in runs if run.last - run.first + 1 >= SHORTEST_LEG]
    fastest = max((float(speed[leg].max()) for leg in whole), default=0.0)
    fast = [leg for leg in whole if speed[leg].max() > (1.0 - SAME_MOTION) * fastest]
    return np.array([math.sqrt(float(np.mean(error[leg] ** 2))) for leg in fast]), fastest


def change(before: Array, after: Array) -> tuple[float, float]:
    """The 95 % interval of the change of the mean, relative to `before` (Welch's t)."""
    variances = [float(np.var(each, ddof=1)) / len(each) for each in (before, after)]
    total = sum(variances)
    squares = sum(v**2 / (len(each) - 1) for v, each in zip(variances, (before, after), strict=True))
    half = float(special.stdtrit(total**2 / squares, 0.5 + 0.5 * CONFIDENCE)) * math.sqrt(total) if total else 0.0
    mean = float(after.mean() - before.mean())
    return (mean - half) / float(before.mean()), (mean + half) / float(before.mean())


class FrictionWatch:
    """Follows the friction of an axis within bounds."""

    def __init__(self, coulomb: float, scale: float, within: float) -> None:
        """`coulomb` (N m | N) is the stage file's, `scale` what is compensated of it, `within` how far that may go."""
        self.scale, self._coulomb = scale, coulomb
        self._bounds = (1.0 - within, 1.0 + within)
        self._before: tuple[float, Look] | None = None  # scale and look before the one that is on trial

    def see(self, look: Look) -> Verdict:
        """What follows from a look at a motion that the present scale has compensated."""
        tried, judged = "", self._judged(look)
        if judged is not None:
            if judged.ended:
                return judged
            tried = f"{judged.words}; "
        verdict = self._followed(look)
        return verdict._replace(words=tried + verdict.words)

    def _judged(self, look: Look) -> Verdict | None:
        """Whether the scale on trial has helped; None where none is, or the motion is another."""
        if self._before is None:
            return None
        scale, before = self._before
        if (
            abs(look.speed - before.speed) > SAME_MOTION * before.speed
            or min(len(before.legs), len(look.legs)) < FEWEST_LEGS
        ):
            return Verdict(self.scale, "another motion than before: whether the last change helped is not known")
        low, high = change(before.legs, look.legs)
        self._before = None
        words = f"tracking error {100.0 * low:+.0f} to {100.0 * high:+.0f} %"
        if high < 0.0:
            return Verdict(self.scale, f"the last change helped ({words})")
        self.scale = scale
        return Verdict(
            scale,
            f"the last change did not help ({words}): back to {scale:.3g}. It is not the friction alone that has "
            "changed; next: `stagectl gap diagnose` of a recording",
            ended=True,
        )

    def _followed(self, look: Look) -> Verdict:
        """The scale that the look asks for."""
        value, low, high = (each / self._coulomb for each in (look.coulomb, look.low, look.high))
        words = f"friction {value:.3g} ({low:.3g} to {high:.3g}) of the stage file's"
        if low <= self.scale <= high:
            return Verdict(self.scale, f"{words}, compensated {self.scale:.3g}: as it should be")
        wanted = min(max(value, self._bounds[0]), self._bounds[1])
        if wanted == self.scale:
            return Verdict(
                self.scale,
                f"{words}: beyond the bound {wanted:.3g}. Next: look at the axis, then `stagectl identify` it anew",
                ended=True,
            )
        if self._before is None:
            self._before = (self.scale, look)
        words = f"{words}, compensated {self.scale:.3g} -> {wanted:.3g} from the next motion on"
        self.scale = wanted
        return Verdict(wanted, words)
