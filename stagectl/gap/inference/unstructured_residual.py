"""What no effect explains and no coordinate of the motion orders: in a band of frequency, over the clock, in the drive.

Each is reported where it repeats and exceeds what an error of form leaves: of a friction law, of an effect that was
named, or of the time shift.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.inference import basis_functions, thresholds
from stagectl.gap.inference.basis_functions import TIME, BasisColumns
from stagectl.gap.inference.coordinates import floor_of_means, means, predicted_of, ridge_fit, scatter
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, least_squares, whitening
from stagectl.gap.residuals.gram_matrices import Grams, Products, folds, partialled_out
from stagectl.gap.residuals.half_strokes import Run, noise_of_all
from stagectl.gap.residuals.thresholds import BAND, KEPT
from stagectl.gap.result.diagnosis import UnknownTerm
from stagectl.gap.selection import constants, null_ensemble, refine
from stagectl.gap.selection.refine import Evidence, Fitted

BANDS = "frequency"
MECHANICS, DRIVE = 0, 1  # numbers of the cuts


class MeanResidual(NamedTuple):
    """The residual of a model: the mean of the repeats, with the columns of all nuisances."""

    fitted: Fitted
    known: Products  # of the nuisances, and of the machines without an effect
    grams: Grams  # of these and the residual


class FreeRows(NamedTuple):
    """Rows of one cut, free of what the nuisances can take."""

    residual: list[Array]  # (m,) of each run
    members: list[Array]  # (k, m) of each run, of the machines without an effect


def mean_residual(now: Fitted, known: Products) -> MeanResidual:
    """The residual of `now`, with the columns `known`."""
    return MeanResidual(now, known, gram_matrices.fold_sums(known, means(now.residuals)))


def in_a_band(e: Evidence, rows: FreeRows, least: float) -> UnknownTerm | None:
    """A resonance: a band that holds most of the residual, and more than `least` and than any friction law.

    `rows` are those of the mechanics' cut.
    """
    noise = _noise(e, MECHANICS)
    power = powers(e, rows.residual) - noise
    members = range(len(rows.members[0]))
    form = np.max([powers(e, [of_run[k] for of_run in rows.members]) for k in members], axis=0)
    first = max(
        range(len(power) - thresholds.BAND_COUNT + 1), key=lambda k: float(power[k : k + thresholds.BAND_COUNT].sum())
    )
    band = slice(first, first + thresholds.BAND_COUNT)
    held, whole = float(power[band].sum()), float(power.sum())
    clear = held > thresholds.BAND_ABOVE_FORM * float((form + noise)[band].sum()) and held > least
    if not clear or held < thresholds.BAND_SHARE * whole:
        return None
    return UnknownTerm(BANDS, *_spectrum(e, power, MECHANICS), min(held / whole, 1.0))


class Line(NamedTuple):
    """The highest line in the spectrum of one run's residual."""

    frequency: float  # Hz
    share: float  # of the residual
    height: float  # over the median of the octave around it, and over what friction laws reach there


def oscillation(e: Evidence, rows: FreeRows, least: float) -> UnknownTerm | None:
    """One line that holds most of the residual of every run, and more than `least`: what comes from outside.

    Noise has no line, and what the motion makes, it makes with other friction laws as well.
    """
    lines = [_line(*of_run) for of_run in zip(e.runs, rows.residual, rows.members, strict=True)]
    share, middle = min(line.share for line in lines), float(np.median([line.frequency for line in lines]))
    apart = max(abs(line.frequency - middle) for line in lines)
    power = powers(e, rows.residual)
    clear = share >= thresholds.UNKNOWN_PREDICTED and min(line.height for line in lines) >= constants.LINE
    if not clear or apart > thresholds.SAME_LINE * middle or share * float(power.sum()) < least:
        return None
    return UnknownTerm(BANDS, *_spectrum(e, power, MECHANICS), share, line=middle)


def _line(run: Run, residual: Array, members: Array) -> Line:
    """Of a run's `residual` (m,), against the `members` (k, m) of the null ensemble on its path."""
    power, *laws = np.abs(np.fft.rfft(np.vstack([residual, members]) * np.hanning(len(residual)))) ** 2
    frequency = np.fft.rfftfreq(len(residual), run.mean.dt * KEPT)
    top = int(np.argmax(np.where(frequency >= thresholds.LOWEST_FREQUENCY, power, 0.0)))
    near = np.abs(np.log2(np.maximum(frequency, 1e-9) / max(frequency[top], 1e-9))) <= 0.5
    heights = [float(one[near].max() / max(np.median(one[near]), 1e-300)) for one in (power, *laws)]
    share = power[max(top - 2, 0) : top + 3].sum() / max(power.sum(), 1e-300)  # a Hann window's line is so wide
    return Line(float(frequency[top]), float(share), heights[0] / max([1.0, *heights[1:]]))


def in_the_drive(e: Evidence, residual: MeanResidual) -> UnknownTerm | None:
    """A current that repeats and that neither the model of the drive nor a delay of the record explains."""
    after = drive_excess(e, residual)
    if not after:
        return None
    power = powers(e, free_rows(e, residual, DRIVE).residual) - _noise(e, DRIVE)
    share = min(after / (after + float(floor_of_means(e)[1])), 1.0)
    return UnknownTerm(BANDS, *_spectrum(e, power, DRIVE), share, block="drive")


def drive_excess(e: Evidence, residual: MeanResidual) -> float:
    """Sum of squares of the current that repeats, and that neither the drive's model nor a delay explains.

    0 where it is no more than noise and an error of form leave.
    """
    gram = residual.grams.current.sum(axis=0)
    if not gram[-1, -1] > 0.0:
        return 0.0
    floor, names = float(floor_of_means(e)[1]), residual.known.names
    own = [f"{named.effect.name}." for named in residual.fitted.effects if named.effect.block == "drive"]
    nuisances = [k for k, name in enumerate(names) if name == "time_shift" or name.startswith(tuple(own))]
    shift = [k for k in nuisances if names[k] == "time_shift"]
    gram_before = gram_matrices.fold_sums(residual.known, means(e.base.after)).current.sum(axis=0)
    after = least_squares.fit(gram, nuisances).residual_sum_of_squares - floor
    before = least_squares.fit(gram_before, shift).residual_sum_of_squares - floor
    small = after < max(thresholds.DRIVE_OF_NOISE * floor, thresholds.DRIVE_OF_FORM * before)
    return 0.0 if small else after


def over_the_clock(e: Evidence, now: Fitted, functions: BasisColumns, least: float) -> UnknownTerm | None:
    """Friction or damping that has changed from run to run in another way than any effect named."""
    gain, share = clock_gain(e, now, functions, least)
    if functions.clock is None or not gain:
        return None
    g = gram_matrices.fold_sums(functions.clock, now.residuals)
    nuisances = g.places(refine.nuisances(e))
    clock, ridge = g.places(basis_functions.CLOCK), _predicted(e, g)[2]
    amplitudes = ridge_fit(g.effort.sum(axis=0), clock, ridge, nuisances)[len(nuisances) :]
    (side, damping), half = np.split(amplitudes, 2), 0.5 * functions.size.speed
    course = side + half * damping
    return UnknownTerm(TIME, basis_functions.knots(e.runs), course - course.mean(), share)


def clock_gain(e: Evidence, now: Fitted, functions: BasisColumns, least: float) -> tuple[float, float]:
    """Sum of squares that a course over the clock predicts of `now`, and its share of that before the fit.

    0 where it is no more than `least`, or than noise and errors of form give.
    """
    if functions.clock is None:
        return 0.0, 0.0
    grams = (gram_matrices.fold_sums(functions.clock, residuals) for residuals in (now.residuals, e.base.after))
    (gain, noise, _), (first, _, _) = (_predicted(e, g) for g in grams)
    if gain <= 0.0 or gain < max(thresholds.CLOCK_OF_NOISE * noise, thresholds.CLOCK_OF_FORM * first, least):
        return 0.0, 0.0
    return gain, min(gain / max(first, gain), 1.0)


def _predicted(e: Evidence, g: Grams) -> tuple[float, float, float]:
    """Sums of squares that a course over the clock predicts, and that it leaves; and the ridge of its fit."""
    free = partialled_out(folds(g, g.effort), g.places(refine.nuisances(e)))
    (before,), (after,), (ridge,) = predicted_of(free, g.places(basis_functions.CLOCK), [-1])
    return float(before - after), float(after), float(ridge)


def free_rows(e: Evidence, residual: MeanResidual, cut: int) -> FreeRows:
    """The residual in the `cut` of the mechanics or of the drive, without what the nuisances can take."""
    g, names = residual.grams, residual.known.names
    gram = (g.current if cut else g.effort).sum(axis=0)
    free = {*refine.nuisances(e), *(direction.name for direction in refine.parameters(residual.fitted))}
    nuisances, members = g.places([name for name in names if name in free]), g.places(null_ensemble.member_names(names))
    inverse = least_squares.inverse(gram[np.ix_(nuisances, nuisances)])
    rows = FreeRows([], [])
    for part, mean in zip(residual.known.parts, means(residual.fitted.residuals), strict=True):
        columns = part.mean[cut].astype(np.float64)
        signal = part.weighted(mean[0])[cut]
        rows.residual.append(signal - (inverse @ gram[nuisances, -1]) @ columns[nuisances])
        taken = (inverse @ gram[np.ix_(nuisances, members)]).T @ columns[nuisances]
        rows.members.append(columns[members] - taken)
    return rows


def _noise(e: Evidence, cut: int) -> Array:
    """Sum of squares (b,) that noise leaves in the means of one cut, within each band."""
    return noise_of_all(e.runs, of_means=True) * powers(e, [deviations[..., cut] for deviations in scatter(e)])


def edges_of(e: Evidence) -> Array:
    """Edges (b + 1,) Hz of the bands."""
    highest = BAND / e.runs[0].mean.dt
    return thresholds.LOWEST_FREQUENCY * 2.0 ** np.arange(
        0.0, np.log2(highest / thresholds.LOWEST_FREQUENCY), thresholds.BAND_STEP
    )


def powers(e: Evidence, rows: Sequence[Array]) -> Array:
    """Sum of squares (b,) of signals (..., m) of each run within each band."""
    edges = edges_of(e)
    total = np.zeros(len(edges) - 1)
    for run, signal in zip(e.runs, rows, strict=True):
        count = signal.shape[-1]
        power = 2.0 / count * np.sum(np.abs(np.fft.rfft(np.atleast_2d(signal))) ** 2, axis=0)
        band = np.searchsorted(edges, np.fft.rfftfreq(count, run.mean.dt * KEPT), side="right")
        total = total + np.bincount(band, power, len(edges) + 1)[1:-1]
    return total


def _spectrum(e: Evidence, power: Array, cut: int) -> tuple[Array, Array]:
    """Middle of each band (Hz), and root mean square of what is missing in it (N m | N, or A)."""
    edges = edges_of(e)
    middle = np.sqrt(edges[1:] * edges[:-1])
    gain = whitening.gains(e.base.noise, middle, e.runs[0].mean.dt)[cut]
    count = sum(float(run.weight.sum()) for run in e.runs)
    return middle, np.sqrt(np.maximum(power, 0.0) / count) / np.maximum(gain, 1e-300)
