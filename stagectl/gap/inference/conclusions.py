"""Everything that the fits say of one session: names, values, the unknown, and where the gap lies.

Held-out runs have no part in it; `validation` judges it afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from stagectl.gap.controller_check.command_check import CommandCheck
from stagectl.gap.inference import parameter_errors, shifted_parameters, time_localisation, verdict
from stagectl.gap.inference.basis_functions import BasisColumns
from stagectl.gap.inference.coordinates import coordinates
from stagectl.gap.inference.shape_fits import with_shape
from stagectl.gap.inference.signatures import DriveSignature, signatures
from stagectl.gap.inference.unknown import unknown
from stagectl.gap.logs.session import Session
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.result.diagnosis import NAMED, Coordinate, FoundEffect, Spans, UnknownTerm
from stagectl.gap.selection import refine
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.swap_tests import Selection
from stagectl.kernels.stage import Stage


class Conclusions(NamedTuple):
    """What the fits say."""

    named: tuple[FoundEffect, ...]  # where nothing is unknown
    named_with_unknown: tuple[FoundEffect, ...]  # the same effects, less sure: each may be a part of the unknown
    shifts: tuple[FoundEffect, ...]
    signatures: tuple[DriveSignature, ...]
    unknown: UnknownTerm | None
    models: tuple[Stage, ...]  # fitted models, the one that holds most of this first

    def effects(self, something_unknown: bool) -> list[FoundEffect]:
        """Effects of the search, signatures of the drive, shifted parameters."""
        named = self.named_with_unknown if something_unknown else self.named
        return [*verdict.with_signatures(named, self.signatures), *self.shifts]


ParameterErrors = tuple[Mapping[str, float], Sequence[FoundEffect]]


def parameter_errors_of(session: Session, e: Evidence, selected: Selection) -> ParameterErrors:
    """Standard deviations of all parameters, an effect's as ``effect.parameter``, and the model's that are off."""
    now = selected.fitted
    g = gram_matrices.grams(refine.tangent(e, now, refine.parameters(now)), now.residuals)
    deviation = verdict.deviations(e, now, g)
    before = max(refine.total(e, list(e.base.before)) - refine.floor(e), 1e-300)
    shifts = parameter_errors.shifts(session, e, now, g, deviation, before)
    return deviation, shifted_parameters.shifted(session, shifts, now)


def conclude(
    session: Session,
    e: Evidence,
    selected: Selection,
    errors: ParameterErrors,
    functions: BasisColumns,
    excluded: tuple[str, ...],
) -> Conclusions:
    """Names, values and the unknown, without the effects that are `excluded`."""
    now, (deviation, shifts) = selected.fitted, errors
    cautious, confident = (
        verdict.named_effects(session, selected, deviation, by_experiment) for by_experiment in (False, True)
    )
    sure = verdict.only_named(e, selected, cautious)
    shape = unknown(e, sure, functions)
    richest = with_shape(e, sure.fitted, shape) if shape is not None and shape.fields else now
    return Conclusions(
        tuple(effect for effect in confident if effect.name not in excluded),
        tuple(effect for effect in cautious if effect.name not in excluded),
        tuple(shift for shift in shifts if shift.name not in excluded),
        tuple(signatures(session, e, richest, excluded)),
        shape,
        tuple(fitted.equipped.stage for fitted in (richest, now)),
    )


class Localisation(NamedTuple):
    """Where the gap lies."""

    blocks: dict[str, float | None]  # excess share of each block; None where its cut was impossible
    coordinates: tuple[Coordinate, ...]
    captures: tuple[Spans, ...]


def localise(
    session: Session, e: Evidence, now: Fitted, conclusions: Conclusions, functions: BasisColumns, parity: CommandCheck
) -> Localisation:
    """In which block of the loop, over which coordinate, and when in each log."""
    off = [shift for shift in conclusions.shifts if shift.probability >= NAMED]
    acting = time_localisation.contributors(session, now, off, conclusions.signatures)
    return Localisation(
        time_localisation.blocks(e, now, parity),
        coordinates(e, functions),
        tuple(time_localisation.spans(e, now, e.runs, acting)),
    )
