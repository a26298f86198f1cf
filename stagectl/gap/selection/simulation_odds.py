"""How probable an effect is by its simulation: by how much less it leaves than the model without it."""

import math

import numpy as np
from scipy.special import expit, gammaln

from stagectl.gap.logs.session import Array
from stagectl.gap.selection import constants, usual_sizes
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.linearised import Powers, Remains


def simulated(valued: EffectValues, without: Remains, present: Remains, powers: Powers) -> float:
    """Probability of an effect, at most: by how often one of its size is there, and by the fit of its simulation.

    Of what another law of the friction or other values of the base explain as well, nothing is its own; and a column
    that bends promises more than a simulation gives.  No friction disturbs the current, and none the difference between
    two repeats.
    """
    gain = gain_of_strokes(without, present) + powers[1] * (without.current - present.current)
    if valued.effect.time_variation:
        gain += powers[2] * (without.drift - present.drift)
    return float(expit(math.log(constants.INCLUSION * usual_sizes.as_large(valued)) + 0.5 * gain))


def gain_of_strokes(without: Remains, present: Remains) -> float:
    """Twice the log of a likelihood ratio, from the residual effort.

    How large the friction's error of form is, nobody knows: what is left counts by its ratio, as in the likelihood of a
    Gaussian error of unknown scale.  The half strokes of an experiment have one scale, or each has its own, as far as
    what is left without says so: where one of them has it all, that one does not decide alone.
    """
    floor = np.minimum(without.floor, present.floor)  # an effect that drifts is no noise
    unsure = np.sqrt(2.0 * np.maximum(present.samples, 1.0))  # standard deviation of the noise's sum of squares
    ends = np.cumsum(present.experiments)[:-1]
    each = (np.split(values, ends) for values in (without.strokes - floor, present.strokes - floor, unsure))
    return 2.0 * sum(map(_gain, *each))


def _gain(before: Array, after: Array, unsure: Array) -> float:
    """Expected log of the likelihood ratio from what is left above the noise in the half strokes (n,) of an experiment.

    The noise makes it `unsure` by so much.  In a sum over half strokes that averages out.
    """
    half, noise = 0.5 * len(before), float(np.linalg.norm(unsure))
    first, then = (1.0 + np.maximum(left, 0.0) / unsure for left in (before, after))
    whole, rest = (noise + max(float(left.sum()), 0.0) for left in (before, after))
    alike = _alike(first)
    return alike * half * math.log(whole / rest) + (1.0 - alike) * 0.5 * float(np.log(first / then).sum())


def _alike(left: Array) -> float:
    """Probability that what is `left` in each half stroke (n,), in units of the noise, has one scale.

    The scales are integrated out by Jeffreys' prior, each over the same range.
    """
    half, range_of_one = 0.5 * len(left), math.log(2.0 * math.log(constants.SCALE_RANGE))
    common = float(gammaln(half)) - half * math.log(math.pi * float(left.sum())) - range_of_one
    alone = -0.5 * float(np.log(left).sum()) - len(left) * range_of_one
    return float(expit(common - alone))
