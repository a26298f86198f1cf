"""What the fits say, until no effect is left that the held-out runs refute."""

from typing import NamedTuple

from stagectl.gap.inference import verdict
from stagectl.gap.inference.basis_functions import BasisColumns
from stagectl.gap.inference.conclusions import Conclusions, Localisation, conclude, localise
from stagectl.gap.logs.session import Session
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.refine import Evidence
from stagectl.gap.steps import Step, StepTimer
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
