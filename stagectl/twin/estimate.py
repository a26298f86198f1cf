"""What a window of the twin's blocks says: the residual of each cut, the drifts with intervals, the effects by name.

Blocks are summed over a window of a minute, not forgotten exponentially: recursive least squares would give the same
values, yet its intervals believe that rows are independent.  Here groups of whole blocks are the independent pieces:

    theta = W^-1 z      cov = W^-1 (sum_g s_g s_g' n/(n - k) + D power^2) W^-1      s_g = z_g - G_g theta
    W = G + D power           D: 1/prior^2, so that what the motion does not tell stays at zero with the prior's width

Source: K.-Y. Liang, S. L. Zeger, Biometrika 73(1), 1986 (clusters).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.effect import Data
from stagectl.gap.effects.library import look_alikes
from stagectl.gap.logs.session import Array
from stagectl.twin.live_model import BEND, PRESLIDING, Block, Candidate, Moments, Twin

FEWEST = 12  # telling blocks, below which nothing is estimated
_GROUPS = 16
SURE = 4.0  # standard errors beyond which something is there: a name is looked for every second, all day
_NEGLIGIBLE = 0.03  # of what all candidates explain together beyond those that are named already
_ALIKE = 0.95  # of the best one's gain, from which another candidate explains the data as well
_DEPENDENT = 1e-3  # share of a column's power, below which others make it up


class Drift(NamedTuple):
    """How far the machine is from the model in one candidate, in units of its scale."""

    candidate: Candidate
    size: float
    error: float  # standard

    @property
    def told(self) -> bool:
        """Whether the motion told it: the interval is well below what was thought possible before."""
        return self.error < 0.3 * self.candidate.prior

    @property
    def value(self) -> float:
        """The parameter as it is now (SI)."""
        return self.candidate.nominal + self.size * self.candidate.scale


class Named(NamedTuple):
    """An effect that is there, and what explains these data as well."""

    drift: Drift
    alternatives: tuple[str, ...]


class Fit(NamedTuple):
    """One cut, solved."""

    drifts: tuple[Drift, ...]
    named: tuple[Named, ...]
    before: float  # root mean square of the residual
    after: float  # of what the named effects leave


class Update(NamedTuple):
    """What the twin says now."""

    time: float  # s of the run
    covered: float  # s of data in the window
    telling: int  # blocks of it
    controller: float | None  # A, largest difference of the command; None: not known
    drive: float | None  # A rms; None: no measured current
    mechanics: float  # N m | N, rms
    lateness: float  # s rms
    drive_fit: Fit | None
    mechanics_fit: Fit | None  # None: too little motion

    @property
    def named(self) -> tuple[Named, ...]:
        """All effects that are there, drive first."""
        return tuple(one for fit in (self.drive_fit, self.mechanics_fit) if fit is not None for one in fit.named)


def update(p: Twin, blocks: Sequence[Block]) -> Update:
    """The window of `blocks` (one at least), newest last."""
    telling = [block for block in blocks if block.telling]
    parities = [block.controller for block in blocks]
    known = [value for value in parities if value is not None]
    drives = [block.drive for block in blocks if block.drive is not None]
    enough = len(telling) >= FEWEST
    counted = [block.drive for block in telling if block.drive is not None]
    rows = sum(block.rows for block in blocks)
    return Update(
        blocks[-1].time,
        rows * p.dt,
        len(telling),
        max(known) if len(known) == len(parities) else None,
        _rms(drives) if drives else None,
        _rms([block.mechanics for block in blocks]),
        math.sqrt(sum(block.lateness**2 * block.rows for block in blocks) / rows),
        fit(p.drive, counted) if enough and len(counted) == len(telling) else None,
        fit(p.mechanics, [block.mechanics for block in telling]) if enough else None,
    )


def fit(candidates: Sequence[Candidate], blocks: Sequence[Moments]) -> Fit:
    """Drifts of all candidates but the force constant, which is their common scale; and the names."""
    free = [k for k, one in enumerate(candidates) if one.name != "force_constant"]
    values, cov = solved(candidates, blocks, free)
    drifts = tuple(Drift(candidates[k], float(values[j]), math.sqrt(cov[j, j])) for j, k in enumerate(free))
    named, left = _names(candidates, blocks)
    count = sum(block.rows for block in blocks)
    return Fit(drifts, named, _rms(blocks), math.sqrt(max(left, 0.0) / count))


def solved(candidates: Sequence[Candidate], blocks: Sequence[Moments], chosen: list[int]) -> tuple[Array, Array]:
    """Values (k,) and covariance (k, k) of the `chosen` candidates."""
    at = np.ix_(chosen, chosen)
    grams = np.array([block.gram[at] for block in blocks])
    crosses = np.array([block.cross[chosen] for block in blocks])
    power = _left(chosen, blocks) / sum(block.rows for block in blocks)
    prior = power * np.diag([candidates[k].prior ** -2 for k in chosen])
    inverse = np.linalg.inv(grams.sum(axis=0) + prior + 1e-30 * np.eye(len(chosen)))
    values = inverse @ crosses.sum(axis=0)
    scores = crosses - grams @ values
    groups = min(_GROUPS, len(blocks))
    summed = np.array([part.sum(axis=0) for part in np.array_split(scores, groups)])
    spread = summed.T @ summed * groups / max(groups - len(chosen), 1)
    return values, inverse @ (spread + power * prior) @ inverse


def _names(candidates: Sequence[Candidate], blocks: Sequence[Moments]) -> tuple[tuple[Named, ...], float]:
    """Candidates one by one, the best first, while they explain something; and the power (sum of squares) left."""
    gram, cross = sum_of(blocks)
    power = sum(block.power for block in blocks)
    everything = list(range(len(candidates)))
    chosen = [k for k, one in enumerate(candidates) if one.name in (PRESLIDING, BEND)]  # another friction law
    total = _explained(gram, cross, everything)
    alternatives: dict[int, tuple[str, ...]] = {}
    while len(chosen) < len(candidates):
        had = _explained(gram, cross, chosen)
        free = [k for k in everything if k not in chosen and _own(gram, chosen, k) > _DEPENDENT]
        gains = {k: _explained(gram, cross, [*chosen, k]) - had for k in free}
        if not gains:
            break
        best = max(gains, key=lambda k: gains[k])
        if gains[best] <= _NEGLIGIBLE * (total - had) or not _stands(candidates, blocks, [*chosen, best]):
            break
        others = (candidates[k].name for k, gain in gains.items() if k != best and gain >= _ALIKE * gains[best])
        alternatives[best] = tuple(
            dict.fromkeys([*others, *look_alikes(candidates[best].name, Data.ALL | Data.IN_OPERATION)])
        )
        chosen.append(best)
    if not chosen:
        return (), power
    values, cov = solved(candidates, blocks, chosen)
    found = (Drift(candidates[k], float(v), math.sqrt(c)) for k, v, c in zip(chosen, values, np.diag(cov), strict=True))
    pairs = zip(chosen, found, strict=True)
    named = tuple(Named(drift, alternatives[k]) for k, drift in pairs if k in alternatives and there(drift))
    return named, power - _explained(gram, cross, chosen)


def _stands(candidates: Sequence[Candidate], blocks: Sequence[Moments], chosen: list[int]) -> bool:
    """Whether the last of the `chosen` is there beside the others."""
    values, cov = solved(candidates, blocks, chosen)
    return there(Drift(candidates[chosen[-1]], float(values[-1]), math.sqrt(cov[-1, -1])))


def _own(gram: Array, chosen: list[int], k: int) -> float:
    """Share of column `k` that the `chosen` ones do not make up: scaling all efforts is scaling Kt."""
    return 1.0 - _explained(gram, gram[k], chosen) / max(float(gram[k, k]), 1e-300)


def there(drift: Drift) -> bool:
    """Whether it is large enough to matter, and sure."""
    return abs(drift.size) > max(drift.candidate.material, SURE * drift.error)


def _explained(gram: Array, cross: Array, chosen: list[int]) -> float:
    """Sum of squares that the `chosen` columns take from the target."""
    if not chosen:
        return 0.0
    part = gram[np.ix_(chosen, chosen)]
    ridge = 1e-9 * np.diag(np.diag(part)) + 1e-30 * np.eye(len(chosen))
    return float(cross[chosen] @ np.linalg.solve(part + ridge, cross[chosen]))


def _left(chosen: list[int], blocks: Sequence[Moments]) -> float:
    """Sum of squares that the `chosen` columns leave; never nothing, as no figure is exact."""
    power = sum(block.power for block in blocks)
    return max(power - _explained(*sum_of(blocks), chosen), 1e-9 * power, 1e-30)


def sum_of(blocks: Sequence[Moments]) -> tuple[Array, Array]:
    """Gram matrix (k, k) and cross products (k,) of all `blocks`."""
    return np.sum([block.gram for block in blocks], axis=0), np.sum([block.cross for block in blocks], axis=0)


def _rms(blocks: Sequence[Moments]) -> float:
    return math.sqrt(sum(block.power for block in blocks) / sum(block.rows for block in blocks))
