"""Paired comparison of variants: repeats in a balanced random order, differences with intervals, and a verdict.

The repeats of a comparison are blocks: each runs every variant once, in an order that a Latin square balances, and
under the same noise where the noise can be chosen.  The figures of one block are subtracted before anything is
averaged, which removes what all its runs share (noise, temperature, wear)::

    d_r = x_other,r - x_r        mean(d) +- t(0.975, n - 1) s(d)/sqrt(n)

Several differences at once are tested by Holm's step-down rule: their adjusted probabilities keep the chance of even
one false verdict below 5 %.  The intervals are not adjusted.
Source: D. C. Montgomery, Design and Analysis of Experiments, chapters 2 and 4; S. Holm, Scand. J. Statistics 6, 1979.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special  # not `stats`, which takes a second to import

from stagectl.number_format import length

Array = NDArray[np.float64]
CONFIDENCE = 0.95  # of intervals and verdicts; convention
SAME = 1e-12  # relative spread of repeats below which nothing has varied; rounding


class Figures(NamedTuple):
    """Tracking errors of each repeat of one variant."""

    name: str
    peak: Array  # (r,) m or rad of travel, over the steady window
    rms: Array  # (r,)

    @classmethod
    def of(cls, name: str, errors: Sequence[Mapping[str, float]]) -> Figures:
        """Those of the tracking errors of its repeats, each with peak and rms."""
        return cls(name, *(np.array([error[measure] for error in errors]) for measure in ("peak", "rms")))

    def as_json(self) -> dict[str, dict[str, Any]]:
        """Mean and values of each measure as JSON values."""
        measures = {"peak": self.peak, "rms": self.rms}
        return {name: {"mean": float(np.mean(x)), "values": x.tolist()} for name, x in measures.items()}


class Difference(NamedTuple):
    """How much lower a variant's figure is than another's, paired repeat by repeat; positive is better."""

    name: str
    other: str
    mean: float
    low: float  # of the 95 % interval; NaN where the repeats do not vary
    high: float
    probability: float  # of such a difference by chance, before Holm; NaN likewise
    adjusted: float  # after Holm
    agree: int  # repeats whose difference has the sign of the mean
    repeats: int

    @property
    def certain(self) -> bool:
        """Whether chance is ruled out at 95 %, all verdicts together."""
        return self.adjusted <= 1.0 - CONFIDENCE


def order(names: list[str], repeats: int, seed: int) -> list[list[str]]:
    """Order of the runs (repeats, variants): in every len(names) repeats each variant has every place once."""
    source, blocks = random.Random(seed), list[list[str]]()
    while len(blocks) < repeats:
        first = source.sample(names, len(names))
        turns = source.sample(range(len(names)), len(names))
        blocks += [first[turn:] + first[:turn] for turn in turns]
    return blocks[:repeats]


def identical(figures: list[Figures]) -> bool:
    """Whether nothing has varied from repeat to repeat, in any variant."""
    return all(_same(variant.peak) and _same(variant.rms) for variant in figures)


def _same(values: Array) -> bool:
    return bool(np.ptp(values) <= SAME * np.max(np.abs(values), initial=0.0))


def differences(figures: list[Figures], other: Figures, measure: str = "peak") -> list[Difference]:
    """Each of `figures` against `other`, in `measure` (peak or rms); Holm's rule over all of them."""
    return _holm([_difference(variant, other, measure) for variant in figures if variant.name != other.name])


def _difference(variant: Figures, other: Figures, measure: str) -> Difference:
    d: Array = getattr(other, measure) - getattr(variant, measure)
    n, mean = len(d), float(np.mean(d))
    agree = int(np.sum(np.sign(d) == np.sign(mean)))
    scale = max(float(np.max(np.abs(getattr(x, measure)))) for x in (variant, other))
    spread = float(np.std(d, ddof=1)) if n > 1 else 0.0
    if n < 2 or spread <= SAME * scale:
        nan = math.nan
        return Difference(variant.name, other.name, mean, nan, nan, nan, nan, agree, n)
    error = spread / math.sqrt(n)
    half = float(special.stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE)) * error
    chance = float(2.0 * special.stdtr(n - 1, -abs(mean) / error))
    return Difference(variant.name, other.name, mean, mean - half, mean + half, chance, chance, agree, n)


def _holm(differences: list[Difference]) -> list[Difference]:
    """Adjusted probabilities: the k-th smallest of m times m - k, never falling, at most 1."""
    adjusted, floor = {}, 0.0
    known = sorted((d for d in differences if math.isfinite(d.probability)), key=lambda d: d.probability)
    for k, difference in enumerate(known):
        floor = max(floor, min(1.0, (len(known) - k) * difference.probability))
        adjusted[difference.name] = floor
    return [d._replace(adjusted=adjusted.get(d.name, math.nan)) for d in differences]


def best(figures: list[Figures]) -> Figures:
    """The variant with the lowest mean peak."""
    return min(figures, key=lambda variant: float(np.mean(variant.peak)))


def verdict(figures: list[Figures], unit: str) -> list[str]:
    """The comparison in sentences: doubts first, then each variant against the first, then the best."""
    first, lowest = figures[0], best(figures)
    sentences = [_sentence(difference, figures, unit) for difference in differences(figures, first)]
    if lowest is not first and len(figures) > 2:
        sentences.append(_lowest(figures, lowest, unit))
    return [*_doubts(figures), *sentences]


def _doubts(figures: list[Figures]) -> list[str]:
    repeats = len(figures[0].peak)
    if repeats == 1:
        return ["One repeat does not show how much is chance: take --repeats 5 for intervals."]
    if identical(figures):
        return [
            f"All {repeats} repeats are identical: nothing varied from run to run, so there is no interval, and it is "
            "not known how certain the differences are on a machine.  A virtual machine repeats itself; "
            "with --simulate its noise differs between repeats, where simulation.current_noise or encoder_noise is set."
        ]
    return []


def _sentence(difference: Difference, figures: list[Figures], unit: str) -> str:
    peaks = {variant.name: float(np.mean(variant.peak)) for variant in figures}
    before, after = peaks[difference.other], peaks[difference.name]
    change = f"from {length(before, unit)} ({difference.other}) to {length(after, unit)}"
    if math.isnan(difference.adjusted):
        return f"{difference.name}: the peak error goes {change}{_share(before, after)}."
    interval = f"95 %: {length(difference.low, unit)} to {length(difference.high, unit)} less"
    everyone = "all " if difference.agree == difference.repeats else ""
    agree = f"{everyone}{difference.agree} of {difference.repeats} repeats agree"
    if not difference.certain:
        none = f"{difference.name}: no difference from {difference.other} is shown"
        return f"{none}; the peak error goes {change} ({interval}; {agree})."
    verb = "cuts" if difference.mean > 0.0 else "raises"
    if difference.mean < 0.0:
        interval = f"95 %: {length(-difference.high, unit)} to {length(-difference.low, unit)} more"
    return f"{difference.name} {verb} the peak error {change}{_share(before, after)}; {agree} ({interval})."


def _share(before: float, after: float) -> str:
    if before == 0.0:
        return ""
    if after > 2.0 * before:
        return f" ({after / before:.3g} times as much)"
    return f" ({100.0 * abs(before - after) / before:.1f} % {'less' if after < before else 'more'})"


def _lowest(figures: list[Figures], lowest: Figures, unit: str) -> str:
    against = differences(figures, lowest)
    same = [d.name for d in against if d.mean == 0.0 and math.isnan(d.adjusted)]
    near = [d.name for d in against if not math.isnan(d.adjusted) and not d.certain]
    words = f"Lowest: {lowest.name} with {length(float(np.mean(lowest.peak)), unit)}"
    words += f"; the same in every repeat: {', '.join(same)}" if same else ""
    if near:
        return f"{words}; not shown to differ from it: {', '.join(near)}."
    apart = [d for d in against if d.certain]
    return f"{words}; all others are higher, beyond chance." if len(apart) == len(against) - len(same) else f"{words}."
