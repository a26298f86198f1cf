"""The search goes on beside an unknown: what no library holds hides every smaller effect that one does.

Where a function of one coordinate predicts most of what a model leaves, that function joins the nuisances, and sets of
effects are compared again beside it.  Which function is decided by its evidence.  It takes what it can explain before
any effect may, so that effects are only added, and what stands without it stays.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from stagectl.gap.effects.library import coordinate_label
from stagectl.gap.inference import basis_functions, unknown
from stagectl.gap.inference.basis_functions import ALL, BasisColumns, CoordinateBasis
from stagectl.gap.inference.shape_fits import COMBINED, SINGLE, WITH_ACCELERATION, own_columns
from stagectl.gap.inference.thresholds import FUNCTION_SIZE
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.gram_matrices import Products
from stagectl.gap.selection import constants, linearised, refine, select
from stagectl.gap.selection.established import Say, Selection
from stagectl.gap.selection.evidence import Candidate, Prior, gains, temper
from stagectl.gap.selection.free_function import FreeFunction
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.refine import Evidence, Fitted

NEVER = ("direction",)  # a sign is an asymmetry
_AS_FORCE = np.array([1.0, 0.0], np.float32)  # of a column: effort and current


class Searched(NamedTuple):
    """What a search has found, on these data and with this library."""

    evidence: Evidence
    library: Library
    selected: Selection
    known: frozenset[str] = frozenset()  # effects that stand without a function next to them


class _Function(NamedTuple):
    basis: CoordinateBasis
    parts: tuple[str, ...]
    deviation: float  # N m | N


def searched(e: Evidence, library: Library, smooth: BasisColumns, say: Say) -> list[Searched]:
    """The effects that stand; before them, those beside a function of one coordinate where there are more of them."""
    without = Searched(e, library, select.select(e, library, say))
    now = without.selected.fitted
    if not library.predict(e, now).share or len(now.effects) >= constants.MOST_EFFECTS:
        return [without]
    function = _likeliest(e, library, now, smooth)
    say(f"next to a function of the {coordinate_label(function.basis.coordinate)}")
    e, library = _beside(e, library, smooth, function)
    more = select.select_from(e, library, refine.refine(e, now.model, now.effects), say)
    known, found = (frozenset(valued.effect.name for valued in each.effects) for each in (now, more.fitted))
    return [Searched(e, library, more, known), without] if known < found else [without]


def alone(e: Evidence, selected: Selection, known: frozenset[str]) -> tuple[Evidence, Selection]:
    """`e` and what is `selected` on it, without a function beside: what it explained is an unknown again.

    Effects that are not `known` were found next to it.
    """
    if e.beside is None:
        return e, selected
    names = [name for name in e.base.products.names if name not in e.beside.names]
    e = refine.with_products(e, gram_matrices.selected(e.base.products, names), None)
    fitted = selected.fitted._replace(residual_sum_of_squares=refine.total(e, selected.fitted.residuals))
    beside = frozenset(valued.effect.name for valued in fitted.effects) - known
    return e, selected._replace(fitted=fitted, beside=beside)


def _likeliest(e: Evidence, library: Library, now: Fitted, smooth: BasisColumns) -> _Function:
    """The function with the largest evidence next to `now`, over all sizes of its amplitudes."""
    powers = (_power(e, library), 0.0)  # it is a force: the current has no part in it
    sizes = [scale * FUNCTION_SIZE * smooth.size.coulomb for scale, _ in constants.SCALES[:3]]  # N m | N
    found: list[tuple[float, _Function]] = []
    for basis, variants, products in _tried(e, now, smooth):
        g = gram_matrices.fold_sums(products, now.residuals)
        start = linearised.start_of(g, linearised.parameters(e, now, g), powers)
        for parts in variants:
            places = tuple(g.places(_names(basis, parts)))
            candidates = [
                Candidate(basis.coordinate, 0, Prior(places, np.zeros(len(places)), np.full(len(places), size)), 1.0)
                for size in sizes
            ]
            each = gains(start, candidates)
            found.append((float(logsumexp(each)), _Function(basis, parts, sizes[int(each.argmax())])))
    return max(found, key=lambda pair: pair[0])[1]


def _tried(
    e: Evidence, now: Fitted, smooth: BasisColumns
) -> Iterator[tuple[CoordinateBasis, Sequence[tuple[str, ...]], Products]]:
    """Every coordinate with the parts of its functions, and with their columns next to all that is free."""
    own = own_columns(e, now)
    for basis in (basis for basis in smooth.bases if basis.coordinate not in NEVER):
        yield basis, SINGLE, gram_matrices.with_columns(smooth.products[basis.coordinate], own)
    combined = [basis for basis in smooth.bases if basis.coordinate in COMBINED]
    columns = basis_functions.columns_of(smooth, {part: combined for part in ALL})
    products = gram_matrices.with_columns(gram_matrices.with_columns(smooth.known, columns), own)
    for basis in combined:
        yield basis, WITH_ACCELERATION, products


def _power(e: Evidence, library: Library) -> float:
    """Of the likelihood of the residual effort."""
    return temper(library.excess[0], linearised.strokes(e))


def _names(basis: CoordinateBasis, parts: Sequence[str]) -> list[str]:
    return [name for part in parts for name in basis_functions.names(basis, part)]


def _beside(e: Evidence, library: Library, smooth: BasisColumns, function: _Function) -> tuple[Evidence, Library]:
    """The data and the library with the columns of a `function` among the nuisances."""
    columns = [
        {f"beside.{name}": [column * _AS_FORCE for column in each] for name, each in of_run.items()}
        for of_run in basis_functions.columns_of(smooth, {part: [function.basis] for part in function.parts})
    ]
    own = gram_matrices.products(e.runs, columns)
    beside = FreeFunction(columns, own, function.deviation, _power(e, library))
    e = refine.with_products(e, e.base.products, beside)
    library = linearised.library_of(e, library.forms, gram_matrices.with_columns(library.products, columns))
    around = smooth._replace(
        known=gram_matrices.with_columns(smooth.known, columns),
        products={name: gram_matrices.with_columns(p, columns) for name, p in smooth.products.items()},
    )
    return e, library._replace(predict=lambda e, now: unknown.predicted(e, now, around))
