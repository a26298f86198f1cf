"""The tracking errors that judge a gap's closing, and how much of the squared error each effect took.

Errors are by motion, `compare`'s variants by name; each motion counts alike.  The shares are Shapley's value, by which
overlapping effects share to 100 %.

Players are the effects in the feedforward, and the rest of the new model: its parameters, and what does not add up.
The tracking error is linear in the feedforward, so player j changes it by a trace d_j whatever the others do.  With
the error b before and a after (a + d_j without effect j)::

    share of j ~ <d_j, b + a>        of the rest: d = b - a - sum of d_j        sum of all: <b - a, b + a> = b^2 - a^2

That is the mean of two gains: j alone against none, and all against all without j.
Products are of different repeats, so that noise does not count as an error.  Each motion counts by its ratio to b^2.
Source: L. S. Shapley, A value for n-person games, 1953; of a quadratic game each pair shares its product evenly.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special  # not `stats`, which takes a second to import

from stagectl.evaluation import tracking_error
from stagectl.paired_comparison import CONFIDENCE, SAME
from stagectl.recording.hdf5 import open_recording
from stagectl.workflows.trials import every_period

Array = NDArray[np.float64]
Errors = dict[str, dict[str, dict[str, Any]]]
BEFORE, AFTER, WITHOUT = "before", "after", "without "  # variants; the last with an effect's name behind it
GROWN = 1.1  # of the error before: beyond it a motion counts as worse; chosen: as much as a new motion may differ
REST = "rest of the model"  # the player that is no effect


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


def _each(errors: Errors, variant: str, measure: str = "rms") -> Array:
    """Tracking errors (m | rad) of all motions and repeats."""
    return np.array([motion[variant][measure]["values"] for motion in errors.values()])


def level(errors: Errors, variant: str, measure: str = "rms") -> float:
    """Geometric mean of the tracking error (m | rad) over all motions, in the mean square of their repeats."""
    return float(np.sqrt(np.mean(np.exp(np.mean(np.log(_each(errors, variant, measure)), axis=0)) ** 2)))


class Share(NamedTuple):
    """Of the squared error that went; negative where the error grew."""

    share: float
    interval: tuple[float, float] | None  # 95 %, from the repeats; None with fewer than three


def shares(errors: Errors, effects: tuple[str, ...], dropped: tuple[str, ...] = ()) -> dict[str, Share]:
    """The share of each effect and of the `REST`, from the recordings of `errors`; they sum to 1.

    Those that are `dropped` from the feedforward have none.  Empty where no error went.
    """
    motions = [{name: traces(row["recordings"]) for name, row in motion.items()} for motion in errors.values()]
    return shares_of(motions, effects, dropped)


def shares_of(
    motions: list[dict[str, Array]], effects: tuple[str, ...], dropped: tuple[str, ...] = ()
) -> dict[str, Share]:
    """The same from error traces (repeats, n) of each variant, a mapping a motion."""
    products = np.sum([_products(_without(traces, dropped), effects) for traces in motions], axis=0)
    gains = _between_repeats(products)
    if gains.sum() <= 0.0:
        return {}
    value, repeats = gains / gains.sum(), products.shape[1]
    half = [math.inf] * len(value) if repeats < 3 else _half_width(products).tolist()
    return {
        name: Share(share, (share - wide, share + wide) if math.isfinite(wide) else None)
        for name, share, wide in zip((*effects, REST), value.tolist(), half, strict=True)
    }


def _without(traces: dict[str, Array], dropped: tuple[str, ...]) -> dict[str, Array]:
    """Error traces of one motion as they are without these effects, whose changes add up."""
    change = sum((traces[f"{WITHOUT}{name}"] - traces[AFTER] for name in dropped), np.zeros_like(traces[AFTER]))
    return {name: trace if name == BEFORE else trace + change for name, trace in traces.items()}


def _products(traces: dict[str, Array], effects: tuple[str, ...]) -> Array:
    """<d_j, b + a> / <b, b> of one motion: player j, repeat of d_j, repeat of b + a."""
    before, after = traces[BEFORE], traces[AFTER]
    changes = [traces[f"{WITHOUT}{name}"] - after for name in effects]
    changes.append(before - after - sum(changes))
    products: Array = np.stack(changes) @ (before + after).T
    return products / float(np.mean(np.sum(before**2, axis=1)))


def _between_repeats(products: Array) -> Array:
    """The mean product of each player over all pairs of different repeats; of a single repeat its own."""
    repeats = products.shape[1]
    if repeats == 1:
        return products[:, 0, 0]
    own = np.trace(products, axis1=1, axis2=2)
    mean: Array = (products.sum(axis=(1, 2)) - own) / (repeats * (repeats - 1))
    return mean


def _half_width(products: Array) -> Array:
    """Of the 95 % interval of each share: the jackknife over the repeats."""
    repeats = products.shape[1]
    left = [_between_repeats(np.delete(np.delete(products, k, 1), k, 2)) for k in range(repeats)]
    values = np.array([gains / gains.sum() for gains in left])
    error = np.sqrt((repeats - 1) ** 2 / repeats * np.var(values, axis=0, ddof=1))
    half: Array = special.stdtrit(repeats - 1, 0.5 + 0.5 * CONFIDENCE) * error
    return half


def traces(recordings: list[str]) -> Array:
    """Tracking errors (repeats, n) over the steady window, in travel; late periods lie between their neighbours."""
    rows = []
    for path in recordings:
        recording = open_recording(Path(path))
        meta, error = recording.meta, tracking_error(recording.samples, recording.meta)
        first, last = (round(time / meta["dt"]) for time in meta["steady"])
        rows.append(every_period(recording.column("time"), error, (first, last), meta["dt"]))
    return np.stack(rows)


def foretold(machine: Errors, simulated: Errors) -> dict[str, float]:
    """Tracking error (m | rad rms) before, as measured, and after, as foretold: geometric means over the motions.

    foretold error(t) = error on the machine with the old controller(t) + simulated(new - old controller)(t)

    Both controllers are simulated on the new model.  What that model does not know, noise among it, is in the measured
    error already: it acts through the same loop under either controller, so that it stays.  A simulation alone knows
    none of it and foretells an error that no machine reaches.
    """
    each: dict[str, list[float]] = {BEFORE: [], AFTER: []}
    for name, motion in machine.items():
        old, new = (np.mean(traces(simulated[name][variant]["recordings"]), axis=0) for variant in (BEFORE, AFTER))
        measured = traces(motion[BEFORE]["recordings"])
        for variant, errors in ((BEFORE, measured), (AFTER, measured + (new - old))):
            each[variant].append(float(np.mean(errors**2)))
    return {variant: float(np.exp(0.5 * np.mean(np.log(squares)))) for variant, squares in each.items()}
