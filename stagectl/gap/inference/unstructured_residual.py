"""What no effect explains and no coordinate of the motion orders: in a band of frequency, over the clock, in the drive.

Each is told where it repeats and is more than what an error of form leaves: of a law of friction, of an effect that was
named, or of the time shift.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.inference import basis_functions
from stagectl.gap.inference.basis_functions import TIME, Functions
from stagectl.gap.inference.coordinates import LOWEST, drawn, floor_of_means, foretold, means, scatter
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, least_squares, whitening
from stagectl.gap.residuals.gram_matrices import Grams, Products
from stagectl.gap.residuals.thresholds import BAND, KEPT
from stagectl.gap.result.diagnosis import UnknownTerm
from stagectl.gap.selection import cross_validation, null_ensemble, refine
from stagectl.gap.selection.cross_validation import folds
from stagectl.gap.selection.refine import Evidence, Fitted

STEP = 0.5  # octaves of a band
WIDTH = 3  # bands in which what rings is looked for
MOST = 0.5  # share of what is left that one coordinate, or band, must hold
ABOVE_FORM = 2.0  # times what the laws of friction and the noise leave in a band
OF_NOISE = {"drive": 0.2, TIME: 0.03}  # of the noise: less is its own scatter
OF_FORM = {"drive": 0.025, TIME: 0.05}  # of what there was: no friction blurs the drive, none changes with the clock
BANDS = "frequency"


class Left(NamedTuple):
    """What is left under a model: the mean of the repeats, with what moves beside every effect."""

    fitted: Fitted
    known: Products  # of what moves beside, and of the machines without an effect
    grams: Grams  # of these and what is left


class Freed(NamedTuple):
    """Rows of one cut, free of what moves beside every effect."""

    left: list[Array]  # (m,) of each run
    members: list[Array]  # (k, m) of each run, of the machines without an effect


def left_of(now: Fitted, known: Products) -> Left:
    """What `now` leaves, beside the columns `known`."""
    return Left(now, known, gram_matrices.fold_sums(known, means(now.residuals)))


def in_a_band(e: Evidence, rows: Freed, least: float) -> UnknownTerm | None:
    """What rings: a band that holds most of what is left, and more than `least` and than any law of friction.

    `rows` are those of the mechanics' cut.
    """
    edges, noise = edges_of(e), powers(e, _noise(e, 0))
    found = powers(e, rows.left) - noise
    form = np.max([powers(e, [one[k] for one in rows.members]) for k in range(len(rows.members[0]))], axis=0)
    at = max(range(len(found) - WIDTH + 1), key=lambda k: float(found[k : k + WIDTH].sum()))
    band = slice(at, at + WIDTH)
    held = float(found[band].sum())
    clear = held > ABOVE_FORM * float((form + noise)[band].sum()) and held > least
    if not clear or held < MOST * float(found.sum()):
        return None
    return UnknownTerm(BANDS, *_spectrum(e, edges, found, 0), min(held / float(found.sum()), 1.0))


def in_the_drive(e: Evidence, all_: Left) -> UnknownTerm | None:
    """A current that repeats and that neither the model of the drive nor a delay of the record explains."""
    whole = all_.grams.current.sum(axis=0)
    if not whole[-1, -1] > 0.0:
        return None
    floor, names = float(floor_of_means(e)[1]), all_.known.names
    own = [f"{one.effect.name}." for one in all_.fitted.effects if one.effect.block == "drive"]
    beside = [k for k, name in enumerate(names) if name == "time_shift" or name.startswith(tuple(own))]
    shift = [k for k in beside if names[k] == "time_shift"]
    first = gram_matrices.fold_sums(all_.known, means(e.base.after)).current.sum(axis=0)
    left, before = (
        least_squares.fit(whole, beside).residual_sum_of_squares - floor,
        least_squares.fit(first, shift).residual_sum_of_squares - floor,
    )
    if left < max(OF_NOISE["drive"] * floor, OF_FORM["drive"] * before):
        return None
    found = powers(e, freed(e, all_, 1).left) - powers(e, _noise(e, 1))
    return UnknownTerm(BANDS, *_spectrum(e, edges_of(e), found, 1), min(left / (left + floor), 1.0), block="drive")


def over_the_clock(e: Evidence, now: Fitted, smooth: Functions, least: float) -> UnknownTerm | None:
    """Friction or damping that has changed from run to run in another way than any effect named."""
    if smooth.clock is None:
        return None
    after, before = (gram_matrices.fold_sums(smooth.clock, left) for left in (now.residuals, e.base.after))
    (held, noise), (first, _) = _foretold(e, after), _foretold(e, before)
    if held < max(OF_NOISE[TIME] * noise, OF_FORM[TIME] * first, least):
        return None
    return UnknownTerm(TIME, *_course(e, after, smooth), min(held / max(first, held), 1.0))


def _foretold(e: Evidence, g: Grams) -> tuple[float, float]:
    """Sums of squares that a course over the clock foretells, and that it leaves."""
    before, after = foretold(
        cross_validation.partialled_out(folds(g, g.effort), g.places(refine.nuisances(e))),
        g.places(basis_functions.CLOCK),
    )
    return before - after, after


def freed(e: Evidence, all_: Left, cut: int) -> Freed:
    """What is left in the mechanics' cut (0) or the drive's (1)."""
    g, names = all_.grams, all_.known.names
    whole = (g.current if cut else g.effort).sum(axis=0)
    moving = {*refine.nuisances(e), *(one.name for one in refine.parameters(all_.fitted))}
    beside, members = g.places([name for name in names if name in moving]), g.places(null_ensemble.member_names(names))
    inverse = least_squares.inverse(whole[np.ix_(beside, beside)])
    left, others = [], []
    for part, mean in zip(all_.known.parts, means(all_.fitted.residuals), strict=True):
        columns = part.mean[cut].astype(np.float64)
        residual = part.weighted(mean[0])[cut]
        left.append(residual - (inverse @ whole[beside, -1]) @ columns[beside])
        others.append(columns[members] - (inverse @ whole[np.ix_(beside, members)]).T @ columns[beside])
    return Freed(left, others)


def _noise(e: Evidence, cut: int) -> list[Array]:
    """(r, m) of each run: what the repeats' noise leaves in the mean of one cut."""
    return [one[..., cut] for one in scatter(e)]


def edges_of(e: Evidence) -> Array:
    """(b + 1,) Hz, of the bands."""
    highest = BAND / e.runs[0].mean.dt
    return LOWEST * 2.0 ** np.arange(0.0, np.log2(highest / LOWEST), STEP)


def powers(e: Evidence, rows: Sequence[Array]) -> Array:
    """(b,) sum of squares of signals (..., m) of each run within each band."""
    edges = edges_of(e)
    found = np.zeros(len(edges) - 1)
    for run, signal in zip(e.runs, rows, strict=True):
        count = signal.shape[-1]
        power = 2.0 / count * np.sum(np.abs(np.fft.rfft(np.atleast_2d(signal))) ** 2, axis=0)
        place = np.searchsorted(edges, np.fft.rfftfreq(count, run.mean.dt * KEPT), side="right")
        found = found + np.bincount(place, power, len(edges) + 1)[1:-1]
    return found


def _spectrum(e: Evidence, edges: Array, found: Array, cut: int) -> tuple[Array, Array]:
    """Middle of each band (Hz), and root mean square of what lacks in it (N m | N, or A)."""
    middle = np.sqrt(edges[1:] * edges[:-1])
    gain = whitening.gains(e.base.noise, middle, e.runs[0].mean.dt)[cut]
    count = sum(float(run.weight.sum()) for run in e.runs)
    return middle, np.sqrt(np.maximum(found, 0.0) / count) / np.maximum(gain, 1e-300)


def _course(e: Evidence, g: Grams, smooth: Functions) -> tuple[Array, Array]:
    """Session clock (s), and how far the friction at half the largest speed is off its mean (N m | N)."""
    beside = g.places(refine.nuisances(e))
    amplitude = drawn(g.effort.sum(axis=0), g.places(basis_functions.CLOCK), beside)[len(beside) :]
    side, damping = np.split(amplitude, 2)
    force = side + 0.5 * smooth.size.speed * damping
    return basis_functions.knots(e.runs), force - force.mean()
