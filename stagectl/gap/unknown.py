"""The shape of what no effect explains: in which coordinate it repeats, and its force there as a data-based term.

It is reported where it is large, repeats, and can be foretold on data that it was not fitted on.  A function that
foretells as much on machines with nothing but another law of friction is form error, and stays silent.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap import columns, coordinates, null, refine, search, smoothers
from stagectl.gap.coordinates import foretold, gathered, means, smooth
from stagectl.gap.found import Shape
from stagectl.gap.grams import Grams
from stagectl.gap.library import Scales
from stagectl.gap.refine import Evidence, Fitted
from stagectl.gap.scores import against, hands
from stagectl.gap.session import Array
from stagectl.gap.smoothers import ALL, EVEN, INERTIAL, LOOP, ODD, Smoother
from stagectl.kernels import effects, jit

LARGE = 0.1  # of what the base refit left to be closed
FORETOLD = 0.5  # of what is left, on data that the function has not seen
FORM = 0.95  # quantile of the ensemble of friction laws
ROWS = 241  # of a table
# Coordinate of a shape: that of the stage model's table, and the parts that it can hold.
TABLES = {
    "speed": ("velocity", (EVEN, ODD)),
    "displacement_since_reversal": ("displacement_since_reversal", (EVEN, ODD)),
    "position": ("position", (EVEN,)),
    "position_mod_pitch": ("position_mod_pitch", (EVEN,)),
    "current": ("current", (EVEN,)),
}
PLAIN = ((EVEN,), (ODD,), (EVEN, ODD))
BOTH = ((EVEN, ODD, INERTIAL), (EVEN, ODD, LOOP))  # of two coordinates at once, where one does not do
OF_TWO = ("speed", "position")


class Foretold(NamedTuple):
    """What one function foretells of what is left."""

    smoother: Smoother
    parts: tuple[str, ...]
    gain: float  # of the sum of squares
    share: float  # of what is left above the repeats' floor
    limit: float  # gain that the ensemble of friction laws gives it


def unknown(e: Evidence, now: Fitted, library: search.Library, size: Scales) -> Shape | None:
    """The effort that is left under `now` over the coordinate that orders it best; None where it has no shape.

    `library` holds the columns of the null ensemble.
    """
    floor = float(coordinates.floor_of_means(e)[0])
    least = LARGE * (_squares(e, means(e.base.after)) - floor)
    if _squares(e, means(now.left)) - floor <= max(least, 0.0):
        return None
    motions = [smoothers.motion(run, size) for run in e.runs]
    tried = smoothers.smoothers(size, motions)
    ground = smoothers.Ground(now.equipped, e.base.noise)
    known = [{**a, **b} for a, b in zip(library.columns, _own(e, now), strict=True)]
    new: list[dict[str, list[Array]]] = [{} for _ in e.runs]
    for parts, variants, chosen in (
        ((EVEN, ODD), PLAIN, tried),
        (ALL, BOTH, [one for one in tried if one.coordinate in OF_TWO]),
    ):
        more = smoothers.columns_of(ground, e.runs, (motions, size), dict.fromkeys(parts, chosen))
        new = [{**a, **b} for a, b in zip(new, more, strict=True)]
        joined = [{**a, **b} for a, b in zip(known, new, strict=True)]
        found = [each for one in chosen for each in _foretold(e, now, joined, (one, variants))]
        good = [one for one in found if one.share >= FORETOLD and one.gain > max(least, one.limit)]
        if good:
            return _shape(e, now, new, _best(good))
    return None


def _best(good: Sequence[Foretold]) -> Foretold:
    # A little more from a richer function is no reason to take it: the table must hold what it can.
    largest = max(one.gain for one in good)
    near = [one for one in good if one.gain >= 0.9 * largest]
    return min(near, key=lambda one: (not _tabled(one), -one.gain))


def _squares(e: Evidence, residuals: Sequence[list[Array]]) -> float:
    pairs = zip(e.runs, residuals, strict=True)
    return float(sum(np.sum((run.weight * one[:, 0]) ** 2) for run, repeats in pairs for one in repeats))


def _own(e: Evidence, now: Fitted) -> list[dict[str, list[Array]]]:
    """Columns of the effects' own parameters, which move beside every function."""
    own = refine.parameters(now)
    return columns.all_columns(now.equipped, e.runs, own, e.base.noise) if own else [{} for _ in e.runs]


def _foretold(
    e: Evidence,
    now: Fitted,
    joined: list[dict[str, list[Array]]],
    what: tuple[Smoother, Sequence[tuple[str, ...]]],
) -> list[Foretold]:
    one, variants = what
    members = null.gains(list(joined[0]))
    beside = [direction.name for direction in refine.parameters(now)]
    parts = dict.fromkeys(part for each in variants for part in each)
    wanted = [*members, *beside, *(name for part in parts for name in smoothers.names(one, part))]
    g = gathered(e, joined, means(now.left), wanted)
    g = g._replace(current=np.zeros_like(g.current))
    nuisance = g.of([*search.nuisances(e), *beside])
    floor = float(coordinates.floor_of_means(e)[0])
    return [_judged(g, one, chosen, (nuisance, members, floor)) for chosen in variants]


def _judged(g: Grams, one: Smoother, parts: tuple[str, ...], beside: tuple[list[int], list[str], float]) -> Foretold:
    nuisance, members, floor = beside
    own, both = g.of([name for part in parts for name in smoothers.names(one, part)]), hands(g)
    before, after = foretold(both, nuisance, own)
    form = [foretold(against(both, place), nuisance, own) for place in g.of(members)]
    limit = float(np.quantile([x - y for x, y in form], FORM)) if form else 0.0
    share = (before - after) / (before - floor) if before > floor else 0.0
    return Foretold(one, parts, before - after, share, limit)


def _tabled(one: Foretold) -> bool:
    return one.smoother.coordinate in TABLES and set(one.parts) <= set(TABLES[one.smoother.coordinate][1])


def _shape(e: Evidence, now: Fitted, new: list[dict[str, list[Array]]], best: Foretold) -> Shape:
    """Force over the coordinate, fitted beside the base's parameters: those have taken a part of it upon themselves."""
    one = best.smoother
    own = [name for part in best.parts for name in smoothers.names(one, part)]
    g = gathered(e, new, means(now.left), own)
    beside = g.of(refine.nuisances(e))
    amplitude = smooth(g.effort.sum(axis=0), [*beside, *g.of(own)], len(beside))[len(beside) :]
    split = dict(zip(best.parts, np.split(amplitude, len(best.parts)), strict=True))
    grid, force = _force(one, split)
    shape = Shape(one.coordinate, grid, force, min(best.share, 1.0))
    return shape._replace(fields=_fields(shape)) if _tabled(best) else shape


def _force(one: Smoother, split: dict[str, Array]) -> tuple[Array, Array]:
    """Grid and force; over both directions where speed or the way since a reversal is the coordinate."""
    signed = one.coordinate in ("speed", "displacement_since_reversal") and ODD in split
    grid = np.linspace(-one.high if signed else one.low, one.high, ROWS)
    basis = one.basis(np.abs(grid) if signed else grid)
    side = np.sign(grid) if signed else np.ones(ROWS)
    force = split.get(EVEN, np.zeros(len(basis))) @ basis + side * (split.get(ODD, np.zeros(len(basis))) @ basis)
    return grid, force


def _fields(shape: Shape) -> tuple[tuple[str, str | float | tuple[float, ...]], ...]:
    p = _table(shape)
    return (
        ("residual.coordinate", effects.COORDINATES[p.coordinate]),
        ("residual.start", p.start),
        ("residual.step", p.step),
        ("residual.values", tuple(float(one) for one in p.values)),
    )


def with_shape(e: Evidence, now: Fitted, shape: Shape) -> Fitted:
    """`now` with the table of `shape` in its model, and all other parameters refitted beside it.

    Without that refit the gap may widen: a base that had bent towards the unknown must bend back.
    """
    stage = now.model.stage._replace(residual=as_table(shape))
    return refine.refine(e, now.model._replace(stage=stage), now.effects)


def as_table(shape: Shape) -> effects.Table:
    """`shape` as the stage model's data-based term; neutral where no coordinate of the model can hold it.

    The table opposes the motor, so it is the force that the model lacks with its sign turned.
    """
    return _table(shape) if shape.fields else effects.NO_TABLE


def _table(shape: Shape) -> effects.Table:
    name = TABLES[shape.coordinate][0]
    if name == "velocity" and shape.grid[0] >= 0.0:
        name = "speed"
    code = effects.COORDINATES.index(name)
    start, step = float(shape.grid[0]), float(shape.grid[1] - shape.grid[0])
    return effects.Table(code, start, step, jit.table((-shape.force).tolist()))
