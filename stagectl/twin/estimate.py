"""What a window of the twin's blocks shows: the residual of each cut, the drifts with intervals, the effects by name.

Blocks are summed over a window of a minute, not forgotten exponentially: recursive least squares would give the same
values, yet its intervals assume that rows are independent.  Here groups of whole blocks are the independent pieces:

    theta = W^-1 z      cov = W^-1 (sum_g s_g s_g' n/(n - k) + D power^2) W^-1      s_g = z_g - G_g theta
    W = G + D power           D: 1/prior^2, so that what the motion does not determine stays at zero, as wide as before

Source: K.-Y. Liang, S. L. Zeger, Biometrika 73(1), 1986 (clusters).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.effect import Data
from stagectl.gap.effects.library import look_alikes
from stagectl.gap.logs.session import Array
from stagectl.twin import thresholds
from stagectl.twin.candidates import FORM, TwinCandidate
from stagectl.twin.live_model import NormalEquations, Twin, TwinBlock


class ParameterDrift(NamedTuple):
    """How far the machine is from the model in one candidate, in units of its scale."""

    candidate: TwinCandidate
    size: float
    error: float  # standard

    @property
    def determined(self) -> bool:
        """Whether the motion determined it: the error is well below what was thought possible before."""
        return self.error < thresholds.DETERMINED * self.candidate.prior

    @property
    def significant(self) -> bool:
        """Whether it is large enough to matter, and sure."""
        return abs(self.size) > max(self.candidate.material, thresholds.NAME_SIGMA * self.error)

    @property
    def value(self) -> float:
        """The parameter as it is now (SI)."""
        return self.candidate.nominal + self.size * self.candidate.scale


class NamedDrift(NamedTuple):
    """An effect that is there, and what explains these data as well."""

    drift: ParameterDrift
    alternatives: tuple[str, ...]


class CutFit(NamedTuple):
    """One cut, solved."""

    drifts: tuple[ParameterDrift, ...]
    named: tuple[NamedDrift, ...]
    after: float  # root mean square of the residual, with the named effects


class TwinStatus(NamedTuple):
    """What the twin sees now."""

    time: float  # s of the run
    covered: float  # s of data in the window
    controller: float | None  # A, largest difference of the command; None: not known
    drive: float | None  # A rms; None: no measured current
    mechanics: float  # N m | N, rms
    lateness: float  # s rms
    drive_fit: CutFit | None
    mechanics_fit: CutFit | None  # None: too little motion

    @property
    def fits(self) -> list[CutFit]:
        """The cuts that could be solved, drive first."""
        return [fit for fit in (self.drive_fit, self.mechanics_fit) if fit is not None]

    @property
    def named(self) -> tuple[NamedDrift, ...]:
        """All effects that are there, drive first."""
        return tuple(named for fit in self.fits for named in fit.named)


def status_of(p: Twin, blocks: Sequence[TwinBlock]) -> TwinStatus:
    """The window of `blocks` (one at least), newest last."""
    informative = [block for block in blocks if block.informative]
    differences = [block.controller for block in blocks if block.controller is not None]
    drives = [block.drive for block in blocks if block.drive is not None]
    counted = [block.drive for block in informative if block.drive is not None]
    enough = len(informative) >= thresholds.FEWEST_BLOCKS
    rows = sum(block.rows for block in blocks)
    return TwinStatus(
        blocks[-1].time,
        rows * p.dt,
        max(differences) if len(differences) == len(blocks) else None,
        _rms(drives) if drives else None,
        _rms([block.mechanics for block in blocks]),
        math.sqrt(sum(block.lateness**2 * block.rows for block in blocks) / rows),
        fit(p.drive, counted) if enough and len(counted) == len(informative) else None,
        fit(p.mechanics, [block.mechanics for block in informative]) if enough else None,
    )


def fit(candidates: Sequence[TwinCandidate], blocks: Sequence[NormalEquations]) -> CutFit:
    """Drifts of all candidates but the force constant, which is their common scale; and the names."""
    free = [k for k, candidate in enumerate(candidates) if candidate.name != "force_constant"]
    named, rest = _names(candidates, blocks)
    count = sum(block.rows for block in blocks)
    return CutFit(drifts(candidates, blocks, free), named, math.sqrt(max(rest, 0.0) / count))


def drifts(
    candidates: Sequence[TwinCandidate], blocks: Sequence[NormalEquations], chosen: list[int]
) -> tuple[ParameterDrift, ...]:
    """The `chosen` candidates with their values and errors."""
    values, cov = solved(candidates, blocks, chosen)
    entries = zip(chosen, values, np.diag(cov), strict=True)
    return tuple(ParameterDrift(candidates[k], float(size), math.sqrt(variance)) for k, size, variance in entries)


def solved(
    candidates: Sequence[TwinCandidate], blocks: Sequence[NormalEquations], chosen: list[int]
) -> tuple[Array, Array]:
    """Values (k,) and covariance (k, k) of the `chosen` candidates."""
    at = np.ix_(chosen, chosen)
    grams = np.array([block.gram[at] for block in blocks])
    crosses = np.array([block.cross[chosen] for block in blocks])
    power = _residual_power(chosen, blocks) / sum(block.rows for block in blocks)
    prior = power * np.diag([candidates[k].prior ** -2 for k in chosen])
    inverse = np.linalg.inv(grams.sum(axis=0) + prior + 1e-30 * np.eye(len(chosen)))
    values = inverse @ crosses.sum(axis=0)
    scores = crosses - grams @ values
    groups = min(thresholds.CLUSTERS, len(blocks))
    summed = np.array([part.sum(axis=0) for part in np.array_split(scores, groups)])
    spread = summed.T @ summed * groups / max(groups - len(chosen), 1)
    return values, inverse @ (spread + power * prior) @ inverse


def _names(
    candidates: Sequence[TwinCandidate], blocks: Sequence[NormalEquations]
) -> tuple[tuple[NamedDrift, ...], float]:
    """Candidates one by one, the best first, while they explain something; and the power (sum of squares) left."""
    gram, cross = sum_of(blocks)
    power = sum(block.power for block in blocks)
    chosen = [k for k, candidate in enumerate(candidates) if candidate.name in FORM]  # another friction law
    total = _explained(gram, cross, list(range(len(candidates))))
    alternatives: dict[int, tuple[str, ...]] = {}
    while gains := _gains(gram, cross, chosen):
        best = max(gains, key=lambda k: gains[k])
        least = thresholds.NEGLIGIBLE_SHARE * (total - _explained(gram, cross, chosen))
        if gains[best] <= least or not drifts(candidates, blocks, [*chosen, best])[-1].significant:
            break
        alternatives[best] = _alternatives(candidates, gains, best)
        chosen.append(best)
    if not chosen:
        return (), power
    pairs = zip(chosen, drifts(candidates, blocks, chosen), strict=True)
    named = tuple(NamedDrift(drift, alternatives[k]) for k, drift in pairs if k in alternatives and drift.significant)
    return named, power - _explained(gram, cross, chosen)


def _gains(gram: Array, cross: Array, chosen: list[int]) -> dict[int, float]:
    """What each further column explains; none that the `chosen` ones make up."""
    before = _explained(gram, cross, chosen)
    rest = (
        k for k in range(len(cross)) if k not in chosen and _own_power(gram, chosen, k) > thresholds.DEPENDENT_POWER
    )
    return {k: _explained(gram, cross, [*chosen, k]) - before for k in rest}


def _alternatives(candidates: Sequence[TwinCandidate], gains: dict[int, float], best: int) -> tuple[str, ...]:
    others = (
        candidates[k].name
        for k, gain in gains.items()
        if k != best and gain >= thresholds.ALTERNATIVE_GAIN * gains[best]
    )
    return tuple(dict.fromkeys([*others, *look_alikes(candidates[best].name, Data.ALL | Data.IN_OPERATION)]))


def _own_power(gram: Array, chosen: list[int], k: int) -> float:
    """Share of column `k` that the `chosen` ones do not make up: scaling all efforts is scaling Kt."""
    return 1.0 - _explained(gram, gram[k], chosen) / max(float(gram[k, k]), 1e-300)


def _explained(gram: Array, cross: Array, chosen: list[int]) -> float:
    """Sum of squares that the `chosen` columns take from the target."""
    if not chosen:
        return 0.0
    part = gram[np.ix_(chosen, chosen)]
    ridge = 1e-9 * np.diag(np.diag(part)) + 1e-30 * np.eye(len(chosen))
    return float(cross[chosen] @ np.linalg.solve(part + ridge, cross[chosen]))


def _residual_power(chosen: list[int], blocks: Sequence[NormalEquations]) -> float:
    """Sum of squares that the `chosen` columns do not explain; never zero, as no figure is exact."""
    power = sum(block.power for block in blocks)
    return max(power - _explained(*sum_of(blocks), chosen), 1e-9 * power, 1e-30)


def sum_of(blocks: Sequence[NormalEquations]) -> tuple[Array, Array]:
    """Gram matrix (k, k) and cross products (k,) of all `blocks`."""
    return np.sum([block.gram for block in blocks], axis=0), np.sum([block.cross for block in blocks], axis=0)


def _rms(blocks: Sequence[NormalEquations]) -> float:
    return math.sqrt(sum(block.power for block in blocks) / sum(block.rows for block in blocks))
