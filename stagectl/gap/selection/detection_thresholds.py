"""What machines with nothing but another law of friction give an effect, and how far beyond that a gain is.

A law that is off leaves much in one experiment and little in another.  A gain is therefore judged on all data and on
each experiment alone, and the clearest of these counts: an experiment with little information takes nothing from the
others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.run_products import first_fold
from stagectl.gap.selection import null_ensemble
from stagectl.gap.selection.candidates import Form
from stagectl.gap.selection.cross_validation import (
    against,
    best_of,
    channel_of,
    channels_of,
    score_of,
    without_nuisances,
)
from stagectl.gap.selection.thresholds import BEYOND, CERTAIN, SMALLEST_GAIN


class Threshold(NamedTuple):
    """What machines without an effect give one effect."""

    limit: float  # gain beyond which it counts as found
    share: float  # largest relative drop on both folds; well beyond it an effect counts as found, too


class Clarity(NamedTuple):
    """How clear one effect is where it is clearest: on all data, or on one experiment alone."""

    doubt: float  # its limit over its gain
    share: float  # of what is left above the repeats' floor; 0 where noise or another law might give as much


class _Tried(NamedTuple):
    """One effect's columns next to those of the nuisances and of the machines without an effect, and nothing else."""

    matrices: Array  # (2, c, q + 1, q + 1) of both channels; the nuisances come first
    nuisances: int
    machines: list[int]
    own: list[list[int]]  # of each form


def thresholds(g: Grams, nuisance: Sequence[int], forms: Sequence[Form]) -> dict[str, Threshold]:
    """For every effect a limit beyond its largest gain on the machines of the null ensemble."""
    free, places = without_nuisances(channels_of(g), nuisance), [g.places(form.names) for form in forms]
    gains: dict[str, list[tuple[float, float]]] = {}
    for member in g.places(null_ensemble.member_names(g.names)):
        machine = against(free, member)
        scores = [
            score_of(machine[channel_of(form, machine)], own, form) for form, own in zip(forms, places, strict=True)
        ]
        for effect, score in best_of(scores).items():
            gains.setdefault(effect, []).append((max(score.gain, 1.0), score.worst))
    largest = {effect: np.max(pairs, axis=0).tolist() for effect, pairs in gains.items()}
    return {effect: Threshold(limit(gain), share) for effect, (gain, share) in largest.items()}


def limit(largest: float) -> float:
    """Gain beyond which an effect counts as found, where the null ensemble gives it `largest`."""
    return max(BEYOND * largest, SMALLEST_GAIN)


def clarity(g: Grams, nuisance: Sequence[int], forms: Sequence[Form]) -> Clarity:
    """How clear one effect is with the best of its `forms`, on all data and on each experiment alone.

    The effect is not in the model whose residual `g` holds.
    """
    tried = _tried(g, nuisance, forms)
    alone = [g.experiment == number for number in np.unique(g.experiment)]
    clarities = [_clarity(g, counted, tried, forms) for counted in (np.ones(len(g.stroke), dtype=bool), *alone)]
    return Clarity(min(clarity.doubt for clarity in clarities), max(clarity.share for clarity in clarities))


def _tried(g: Grams, nuisance: Sequence[int], forms: Sequence[Form]) -> _Tried:
    members, own = g.places(null_ensemble.member_names(g.names)), [g.places(form.names) for form in forms]
    places = [*nuisance, *members, *sorted({place for columns in own for place in columns}), len(g.names)]
    position = {place: k for k, place in enumerate(places)}
    return _Tried(
        np.stack([channel[:, places][:, :, places] for channel in (g.effort, g.current)]),
        len(nuisance),
        [position[member] for member in members],
        [[position[place] for place in columns] for columns in own],
    )


def _clarity(g: Grams, counted: NDArray[np.bool_], p: _Tried, forms: Sequence[Form]) -> Clarity:
    """On the half strokes (c,) that are `counted`."""
    first, channel = first_fold(g.stroke)[counted], channel_of(forms[0], p.matrices)
    sums = np.stack([[part[counted][fold].sum(axis=0) for fold in (first, ~first)] for part in p.matrices])
    free = without_nuisances(sums, range(p.nuisances))[channel]
    machines = [free, *(against(free, member) for member in p.machines)]
    scores = [[score_of(machine, own, form) for own, form in zip(p.own, forms, strict=True)] for machine in machines]
    gain, *null_gains = (max(score.gain for score in of_machine) for of_machine in scores)
    left = max(scores[0][0].before - float(g.floor[counted, channel].sum()), gain)
    least = limit(max(null_gains, default=0.0))
    certain = gain > max(least, CERTAIN * SMALLEST_GAIN)
    return Clarity(least / max(gain, 1e-300), gain / left if certain else 0.0)
