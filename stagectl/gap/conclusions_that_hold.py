"""What the fits say of the effects that are found, until none is left that the held-out runs refute.

Where the loop shows that more is missing and nothing orders it, the search is made again among the effects that bend.
"""

from typing import NamedTuple

from stagectl.gap.inference import cable_centre, constant_force, search_beside, value_errors, verdict
from stagectl.gap.inference.basis_functions import BasisColumns
from stagectl.gap.inference.conclusions import Conclusions, Localisation, conclude, localise
from stagectl.gap.logs.session import Session
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.refine import Evidence
from stagectl.gap.steps import Progress, Step, StepTimer
from stagectl.gap.validation.validate import Validation, refuted_words, validate


class Fits(NamedTuple):
    """A session, and what was fitted to it."""

    session: Session
    checked: bool  # whether the command could be recomputed, and agreed
    evidence: Evidence
    library: Library
    functions: BasisColumns
    excluded: tuple[str, ...]  # effects that must not be named


class Held(NamedTuple):
    """The effects that hold, and what is said with them."""

    selected: Selection
    conclusions: Conclusions
    location: Localisation
    validation: Validation
    refuted: tuple[str, ...] = ()  # effects that explain forces, and are not what is missing

    @property
    def without_order(self) -> bool:
        """Whether the loop alone shows that something is missing."""
        return self.validation.closure.open and self.conclusions.unknown is None


def answer_of(fits: Fits, timer: StepTimer, progress: Progress) -> tuple[Evidence, Held]:
    """What is found and holds, and the data that say so.

    Along the measured path, what bends may leave less than an error in the form of friction does: then only the loop
    shows that it is missing, and it is searched for.
    """
    evidence, held = _found(fits, timer, progress)
    if not held.without_order:
        return evidence, held
    timer.begin(Step.SEARCH)
    bent = fits._replace(library=fits.library._replace(unordered=lambda *_: True))
    wider = _found(bent, timer, progress)
    return wider if len(wider[1].selected.fitted.effects) > len(held.selected.fitted.effects) else (evidence, held)


def _found(fits: Fits, timer: StepTimer, progress: Progress) -> tuple[Evidence, Held]:
    evidence, selected = standing(fits.evidence, fits.library, fits.functions, progress)
    return evidence, conclusions_that_hold(fits._replace(evidence=evidence), selected, timer)


def standing(e: Evidence, library: Library, functions: BasisColumns, progress: Progress) -> tuple[Evidence, Selection]:
    """The effects that stand and are borne out; those next to a function only where one of these is."""
    for found in search_beside.searched(e, library, functions, progress):
        e, selected = _borne_out(found, functions, progress)
        if selected.beside:
            break
    return e, selected


def _borne_out(
    found: search_beside.Searched, functions: BasisColumns, progress: Progress
) -> tuple[Evidence, Selection]:
    e, library, selected, known = found
    selected = value_errors.borne_out(e, library, selected, functions, progress)
    selected = selected._replace(fitted=cable_centre.centred(e, selected.fitted))
    return search_beside.alone(*constant_force.settled(e, library, selected, progress), known)


def conclusions_that_hold(fits: Fits, selected: Selection, timer: StepTimer) -> Held:
    """What is said of the effects that are `selected`, less those that the held-out runs refute, one after the other.

    The fit without such an effect is another one: parameters and the unknown are said anew.
    """
    session, e = fits.session, fits.evidence
    timer.begin(Step.PARAMETERS)
    conclusions = conclude(session, e, fits.library, selected, fits.functions, fits.excluded)
    timer.begin(Step.LOCALISATION)
    location = localise(session, e, selected, conclusions, fits.functions, fits.checked)
    timer.begin(Step.VALIDATION)
    validation = validate(session, e, selected, conclusions)
    refuted = validation.closure.refuted
    if not refuted:
        return Held(selected, conclusions, location, validation)
    held = conclusions_that_hold(fits, verdict.taken_out(e, selected, refuted), timer)
    warnings = (refuted_words(refuted), *held.validation.warnings)
    validation = held.validation._replace(warnings=warnings)
    return held._replace(validation=validation, refuted=(refuted, *held.refuted))
