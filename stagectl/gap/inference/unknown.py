"""What no effect explains: a shape over one coordinate, a band of frequency, a course in time, or no order at all.

It is reported where it is large, repeats, and can be predicted on data that it was not fitted to.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.effect import MECHANICS, Scales
from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.inference import basis_functions, shape_fits, unstructured_residual
from stagectl.gap.inference.basis_functions import BasisColumns
from stagectl.gap.inference.cable_centre import BIAS
from stagectl.gap.inference.coordinates import means
from stagectl.gap.inference.shape_fits import ShapeFit, best_of, floor_of, least_gain, repeats_of, shape_of
from stagectl.gap.inference.thresholds import BEYOND_FRICTION_LAWS, SHIFT_LEAST
from stagectl.gap.logs.session import Session
from stagectl.gap.residuals import gram_matrices, least_squares
from stagectl.gap.residuals.gram_matrices import Columns, Grams, Products, folds, partialled_out
from stagectl.gap.result.diagnosis import UNORDERED, UnknownTerm
from stagectl.gap.selection import null_ensemble, refine
from stagectl.gap.selection.constants import FORM, OF_KIN
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.linearised import Library, Predicted
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels.effects import TURN
from stagectl.kernels.stage import sliding
from stagectl.units import LINEAR

ASYMMETRY = "coulomb_asymmetry"
KINDRED = {"position": "position_mod_pitch", "position_mod_pitch": "position"}  # an error of form shows in both


class Explained(NamedTuple):
    """What an effect that is there may leave of the mean of the repeats, by an error of its form."""

    block: str
    seen_over: tuple[str, ...]
    may_leave: float  # sum of squares


def functions(e: Evidence, size: Scales, library: Library) -> BasisColumns:
    """Functions of single coordinates along the runs, together with the base and the null ensemble."""
    names = [*e.base.products.names, *null_ensemble.member_names(library.products.names)]
    filtering = basis_functions.ResidualFilter(e.base.model, e.base.noise)
    efforts = [run.weight * mean[:, 0] for run, (mean,) in zip(e.runs, means(e.base.after), strict=True)]
    return basis_functions.functions(filtering, e.runs, size, gram_matrices.selected(library.products, names), efforts)


def predicted(e: Evidence, now: Fitted, smooth: BasisColumns) -> Predicted:
    """What would be named an unknown of `now`: in the mechanics by an order, in the drive by repeating; else 0.

    In the mechanics it is the most that a function of one coordinate, or of the clock, predicts, over all repeats.
    """
    least, repeats, own = least_gain(e), repeats_of(e), shape_fits.own_columns(e, now)
    clear = [fit for fit in shape_fits.single_coordinate(e, now, own, smooth) if fit.clear(least)]
    of_clock = unstructured_residual.clock_gain(e, now, smooth, least * repeats)[0]
    effort = max([*(fit.gain * repeats for fit in clear), of_clock])
    return Predicted((effort, _of_drive(e, now, smooth, own)), max((fit.share for fit in clear), default=0.0))


def _of_drive(e: Evidence, now: Fitted, smooth: BasisColumns, own: Columns) -> float:
    """Sum of squares of the current that would be named, over all repeats; 0 without repeats."""
    if not refine.repeated(e):
        return 0.0
    return unstructured_residual.drive_excess(e, _mean_residual(now, smooth, own)) * repeats_of(e)


def _mean_residual(now: Fitted, smooth: BasisColumns, own: Columns) -> unstructured_residual.MeanResidual:
    """What `now` leaves, next to all nuisances and the effects' `own` parameters."""
    return unstructured_residual.mean_residual(now, gram_matrices.with_columns(smooth.known, own))


def unordered(e: Evidence, now: Fitted, smooth: BasisColumns) -> bool:
    """Whether what `now` leaves of repeated runs would be named an unknown that oscillates, or has no order."""
    if not refine.repeated(e):
        return False
    residual = _mean_residual(now, smooth, shape_fits.own_columns(e, now))
    rows = unstructured_residual.free_rows(e, residual, unstructured_residual.MECHANICS)
    band = unstructured_residual.in_a_band(e, rows, least_gain(e))
    return bool(band or _without_order(e, residual.grams, rows, 0.0))


class Residual:
    """What a fit leaves, as it is looked at for an unknown and for an error of form; made once, and only if needed."""

    def __init__(self, e: Evidence, now: Fitted, smooth: BasisColumns) -> None:
        self._of = (e, now, smooth)

    @functools.cached_property
    def own(self) -> Columns:
        """The columns of the effects' own parameters: each is a simulation of all runs."""
        e, now, _ = self._of
        return shape_fits.own_columns(e, now)

    @functools.cached_property
    def fits(self) -> list[ShapeFit]:
        """The fits of single coordinates."""
        e, now, smooth = self._of
        return shape_fits.single_coordinate(e, now, self.own, smooth)


def unknown(e: Evidence, selected: Selection, smooth: BasisColumns, left: Residual) -> UnknownTerm | None:
    """The shape of the residual of `selected`, over the coordinate that orders it best; None where it has none.

    Noise has no order either: what was not repeated cannot be separated from it, so only a coordinate counts, or a
    line in time.
    """
    now = selected.fitted
    known = gram_matrices.with_columns(smooth.known, left.own)
    shape = _ordered(e, selected, known, smooth, left)
    if shape:
        return shape
    residual = unstructured_residual.mean_residual(now, known)
    rows = unstructured_residual.free_rows(e, residual, unstructured_residual.MECHANICS)
    if not refine.repeated(e):
        return unstructured_residual.oscillation(e, rows, least_gain(e))
    kindred = max((part.may_leave for part in _explained(e, selected) if part.block != "drive"), default=0.0)
    return (
        unstructured_residual.in_a_band(e, rows, max(least_gain(e), kindred))
        or unstructured_residual.over_the_clock(e, now, smooth, least_gain(e) * repeats_of(e))
        or unstructured_residual.in_the_drive(e, residual)
        or _without_order(e, residual.grams, rows, kindred)
    )


def without_pitch(session: Session, shape: UnknownTerm | None) -> tuple[str, ...]:
    """What to say of an unknown over the position of a linear axis that repeats over a length that is not stated."""
    if shape is None or shape.coordinate not in KINDRED:
        return ()
    if session.kind != LINEAR or session.stage.mechanics.pitch != TURN:
        return ()
    where = "`stage.pitch` in nominal.yaml, `mechanics.pitch` in a stage file"
    return (f"no pitch is known, and the unknown follows the position: state the magnet or screw pitch ({where})",)


def error_of_form(now: Fitted, left: Residual) -> UnknownTerm | None:
    """The coordinate of which a function predicts most of what `now` leaves, and more than any friction law gives it.

    However little that is: too little for an unknown, it is an error in the form of the effects over this coordinate.
    """
    if not now.effects:
        return None
    clear = [fit for fit in left.fits if fit.clear(0.0)]
    return UNORDERED._replace(coordinate=best_of(clear).basis.coordinate) if clear else None


def _ordered(
    e: Evidence, selected: Selection, known: Products, smooth: BasisColumns, left: Residual
) -> UnknownTerm | None:
    """The residual effort as a function of one coordinate, or of one coordinate and the acceleration there.

    `known` are the columns of all nuisances, with those of the effects' own parameters.
    """
    now, least = selected.fitted, least_gain(e)
    if shape_fits.squares(e, means(now.residuals)) - floor_of(e) <= max(least, 0.0):
        return None
    explained = [*_explained(e, selected), _asymmetry(e, now)]
    if clear := _clear(left.fits, explained, least):
        best = best_of(clear)
        shape = shape_of(e, now, gram_matrices.with_columns(smooth.products[best.basis.coordinate], left.own), best)
        return shape if _matters(shape, now) else None
    products, combined = shape_fits.with_acceleration(e, now, known, smooth)
    clear = _clear(combined, explained, least)
    return shape_of(e, now, products, best_of(clear)) if clear else None


def _matters(shape: UnknownTerm, now: Fitted) -> bool:
    """Whether a function of the direction alone is as large as a shift of Coulomb friction that matters.

    It is such a shift, or a constant force; next to nothing else it is what the fit of these has left.
    """
    if shape.coordinate != "direction":
        return True
    return float(np.abs(shape.force).max()) >= SHIFT_LEAST["coulomb"] * sliding(now.model.stage.friction)


def _clear(fits: Sequence[ShapeFit], explained: Sequence[Explained], least: float) -> list[ShapeFit]:
    """Fits that are clear, and more than an error in the form of an effect over the same coordinate leaves."""
    return [fit for fit in fits if fit.gain > _form_error(fit.basis.coordinate, explained) and fit.clear(least)]


def _form_error(coordinate: str, explained: Sequence[Explained]) -> float:
    kin = kindred(coordinate)
    return max((part.may_leave for part in explained if not kin.isdisjoint(part.seen_over)), default=0.0)


def kindred(coordinate: str) -> set[str]:
    """The coordinates over which an error of form over `coordinate` shows."""
    return {coordinate, KINDRED.get(coordinate, coordinate)}


def _explained(e: Evidence, selected: Selection) -> list[Explained]:
    effects, each = [EFFECTS[part.effect.name] for part in selected.fitted.effects], OF_KIN / repeats_of(e)
    return [Explained(effect.block, effect.seen_over, each * selected.gains[effect.name]) for effect in effects]


def _asymmetry(e: Evidence, now: Fitted) -> Explained:
    """Of a bias that is off: while the axis slides, an asymmetry of friction is one, and after a reversal it is not."""
    names, seen_over = refine.nuisances(e), EFFECTS[ASYMMETRY].seen_over
    if BIAS not in names:
        return Explained(MECHANICS, seen_over, 0.0)
    moved, g = e.base.prior.moved(now.model, BIAS), gram_matrices.fold_sums(e.base.products, now.residuals)
    places = g.places(names)
    apart = least_squares.inverse(g.effort.sum(axis=0)[np.ix_(places, places)])
    lost = float(moved**2 / apart[names.index(BIAS), names.index(BIAS)])  # with the nominal bias
    return Explained(MECHANICS, seen_over, FORM / repeats_of(e) * lost)


def _without_order(e: Evidence, g: Grams, rows: unstructured_residual.FreeRows, kindred: float) -> UnknownTerm | None:
    """What repeats and is too much for any friction law, though nothing orders it; no term of the model.

    `kindred` is what an error in the form of a named effect may leave.
    """
    excess = sum(float(np.sum(residual * residual)) for residual in rows.residual) - floor_of(e)
    if excess < max(least_gain(e), BEYOND_FRICTION_LAWS * _worst_law(e, g), kindred):
        return None
    return UNORDERED


def _worst_law(e: Evidence, g: Grams) -> float:
    """Largest sum of squares that the base leaves on a machine of the null ensemble."""
    free = partialled_out(folds(g, g.effort), g.places(refine.moving(e)))
    return max(
        (float(free[:, place, place].sum()) for place in g.places(null_ensemble.member_names(g.names))), default=0.0
    )
