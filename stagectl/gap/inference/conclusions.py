"""Everything that the fits say of one session: names, values, the unknown, and where the gap lies.

Held-out runs have no part in it; `validation` judges it afterwards.
"""

from typing import NamedTuple

from stagectl.gap.inference import attribution, parameter_errors, shifted_parameters, time_localisation, verdict
from stagectl.gap.inference.basis_functions import BasisColumns
from stagectl.gap.inference.beside_unknown import beside_unknown
from stagectl.gap.inference.coordinates import coordinates
from stagectl.gap.inference.shape_fits import with_shape
from stagectl.gap.inference.signatures import signatures
from stagectl.gap.inference.value_errors import errors
from stagectl.gap.logs.session import Session
from stagectl.gap.result.diagnosis import NAMED, Coordinate, FoundEffect, Part, Spans, UnknownTerm
from stagectl.gap.selection.baseline_fit import is_measured
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.refine import Evidence
from stagectl.kernels.stage import Stage


class Conclusions(NamedTuple):
    """What the fits say."""

    named: tuple[FoundEffect, ...]
    shifts: tuple[FoundEffect, ...]
    signatures: tuple[FoundEffect, ...]  # of the drive
    unknown: UnknownTerm | None
    models: tuple[Stage, ...]  # fitted models, the one that holds most of this first

    @property
    def effects(self) -> list[FoundEffect]:
        """Effects that were selected, signatures of the drive, shifted parameters."""
        shifts = verdict.beyond_jitter(self.shifts, self.signatures)
        return [*verdict.with_signatures(self.named, self.signatures), *shifts]


def conclude(
    session: Session,
    e: Evidence,
    library: Library,
    selected: Selection,
    functions: BasisColumns,
    excluded: tuple[str, ...],
) -> Conclusions:
    """Names, values and the unknown, without the effects that are `excluded`."""
    selected, sure, shape = beside_unknown(e, library, selected, functions)
    now = selected.fitted
    known = list(errors(e, library, now, functions).values())
    effects = verdict.named_effects(session, e, selected, known)
    shifts = [
        shift._replace(probability=min(shift.probability, selected.probability.get(shift.name, 1.0)))
        for shift in parameter_errors.shifts(session, e, now, known)
    ]
    richest = with_shape(e, sure.fitted, shape) if shape is not None and shape.fields else now
    explained = [effect.name for effect in effects if effect.probability >= NAMED]
    seen = signatures(session, e, richest, (*excluded, *explained))
    once = {*excluded, *(signature.name for signature in seen.found)}  # what is both fitted and seen counts once
    return Conclusions(
        tuple(verdict.without_jitter(effect, seen.most_jitter) for effect in effects if effect.name not in once),
        tuple(shift for shift in shifted_parameters.shifted(session, shifts, now) if shift.name not in excluded),
        seen.found,
        shape,
        tuple(fitted.equipped.stage for fitted in (richest, now)),
    )


class Localisation(NamedTuple):
    """Where the gap lies."""

    blocks: dict[str, float | None]  # share of each block; None where its cut was impossible
    parts: tuple[Part, ...]  # whose the gap is
    coordinates: tuple[Coordinate, ...]
    captures: tuple[Spans, ...]


def localise(
    session: Session,
    e: Evidence,
    selected: Selection,
    conclusions: Conclusions,
    functions: BasisColumns,
    checked: bool,
) -> Localisation:
    """In which block of the loop, over which coordinate, and when in each log; `checked`: its command was."""
    now = selected.fitted
    off = [shift for shift in conclusions.shifts if shift.probability >= NAMED]
    acting = time_localisation.contributors(session, e, now, off, conclusions.signatures)
    parts = attribution.parts_of(e, selected, conclusions.effects)
    return Localisation(
        attribution.blocks(parts, checked, is_measured(e.runs)),
        parts,
        attribution.with_coordinates(parts, coordinates(e, functions)),
        tuple(time_localisation.spans(e, now, e.runs, acting)),
    )
