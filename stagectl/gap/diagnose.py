"""The pipeline: one session in, one diagnosis out.  Each step is one call into one room, in the rooms' order.

::

    session
       |  controller_check     is the command that of the deployed law?
       |  selection            base refitted, effects simulated, the evidence: which effects, with which values
       |  inference            names and probabilities, shifted parameters, the unknown, where the gap lies
       |  validation           the improved model on held-out runs: how far does the gap close?
       v  experiment_design    the experiment that separates what is ambiguous
    Diagnosis
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from stagectl.gap.conclusions_that_hold import Fits, Held, answer_of
from stagectl.gap.controller_check.command_check import CommandCheck, check_command
from stagectl.gap.effects.effect import Scales
from stagectl.gap.effects.library import definitions
from stagectl.gap.experiment_design.experiment_proposal import next_experiment
from stagectl.gap.inference import attribution, swept_parameters, time_localisation, unknown
from stagectl.gap.logs.session import GapError, Session
from stagectl.gap.residuals import gram_matrices, sensitivities, whitening
from stagectl.gap.residuals.base_modes import modes
from stagectl.gap.residuals.half_strokes import runs
from stagectl.gap.residuals.pitch_orders import orders
from stagectl.gap.residuals.thresholds import LONGEST_PERIOD
from stagectl.gap.result.diagnosis import (
    BLOCKS,
    HELD_OUT,
    NAMED,
    UNFITTED,
    UNORDERED,
    DiagnosisResult,
    FoundEffect,
    Gap,
    UnknownTerm,
)
from stagectl.gap.result.verdict_text import sentence
from stagectl.gap.selection import bristle_shape, candidates, null_ensemble, refine
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.linearised import Library, library_of
from stagectl.gap.selection.refine import Evidence
from stagectl.gap.selection.thresholds import ENSEMBLE_MEMBERS, ENSEMBLE_SEED
from stagectl.gap.steps import Progress, Step, StepTimer
from stagectl.gap.validation import shares
from stagectl.gap.validation.closure import unjudged
from stagectl.gap.validation.validate import confirmed
from stagectl.identification.thresholds import LEAST_ENCODER_STEPS
from stagectl.kernels.stage import Stage, sliding
from stagectl.number_format import duration
from stagectl.units import unit_on


class Options(NamedTuple):
    """How a diagnosis is made."""

    excluded: tuple[str, ...] = ()  # effects that must not be candidates
    full: bool = False  # a larger null ensemble and more resamples
    advice: bool = True  # whether the next experiment is looked for


class Diagnosis(NamedTuple):
    """The answer, and the model that it leads to."""

    result: DiagnosisResult
    improved: Stage  # nominal with all that was found


def diagnose(session: Session, options: Options, progress: Progress) -> Diagnosis:
    """Where the gap lies, which effect causes it, and how far it shrinks.

    Raises GapError where the session has nothing that a diagnosis could start from.
    """
    with threadpool_limits(1):  # rollouts take all cores; the algebra's threads would only wait for them
        return _diagnosed(session, options, StepTimer(progress), progress)


def _diagnosed(session: Session, options: Options, timer: StepTimer, progress: Progress) -> Diagnosis:
    timer.begin(Step.CONTROLLER)
    agreement = check_command(session)
    if not agreement.agrees:
        return _beside_the_controller(session, agreement, options, timer, progress)
    if reason := unidentifiable(session):
        return Diagnosis(_unsearched(session, "not-identifiable", reason), session.stage)
    timer.begin(Step.BASELINE)
    evidence = baseline(session, options.excluded)
    timer.begin(Step.SENSITIVITIES)
    size = scales_of(session, evidence)
    library = candidates_of(evidence, size, options)
    timer.begin(Step.SEARCH)
    functions = unknown.functions(evidence, size, library)
    library = library._replace(
        predict=lambda e, now: unknown.predicted(e, now, functions),
        unordered=lambda e, now: unknown.unordered(e, now, functions),
    )
    fits = Fits(session, agreement.checked, evidence, library, functions, options.excluded)
    evidence, said = answer_of(fits, timer, progress)
    result = _answer(session, said)
    timer.begin(Step.EXPERIMENT)
    if options.advice:
        result = _advised(session, result, said.selected, evidence)
    result = result._replace(seconds=timer.seconds)
    return Diagnosis(result._replace(sentence=sentence(result)), said.validation.improved)


def _beside_the_controller(
    session: Session, agreement: CommandCheck, options: Options, timer: StepTimer, progress: Progress
) -> Diagnosis:
    """Another controller ran than is described: that is the verdict; drive and mechanics answer to the logged command.

    Without a known controller no loop is simulated, and the gap is that of the effort.
    """
    when = time_localisation.spans_of_command(session, agreement.limit)
    alone = _unsearched(session, "controller", agreement.words)._replace(captures=when)
    if unidentifiable(session):
        return Diagnosis(alone, session.stage)
    logs = tuple(log._replace(setpoints=None) for log in session.logs)
    beside = _diagnosed(session._replace(law=None, logs=logs), options._replace(advice=False), timer, progress)
    kept = ("effects", "gap", "gaps", "coordinates", "shares", "unknown")
    result = alone._replace(**{name: getattr(beside.result, name) for name in kept}, seconds=beside.result.seconds)
    return Diagnosis(result._replace(sentence=sentence(result)), beside.improved)


def unidentifiable(session: Session) -> str:
    """Why nothing can be identified from `session`; empty where something can."""
    training = [log for log in session.logs if not log.held_out]
    if not training:
        return "every log is held out, so there is none to find anything in; mark some `use: diagnose`"
    if all(log.command is None and log.current is None for log in training):
        return (
            "no log holds a current or a command: without a force, no motion separates inertia from friction; log the "
            "current, or name its column"
        )
    if session.dt > LONGEST_PERIOD:
        return (
            f"rows come every {duration(session.dt)}, and no motion shows in rows that are more than "
            f"{duration(LONGEST_PERIOD)} apart: record faster, or name the unit of the times"
        )
    least = LEAST_ENCODER_STEPS * session.stage.encoder.step
    if all(float(np.ptp(log.position)) <= least for log in training):
        return f"no log moves the axis by more than {LEAST_ENCODER_STEPS:g} encoder steps: record a longer motion"
    return ""


def baseline(session: Session, excluded: Sequence[str]) -> Evidence:
    """The training runs, with the nominal model refitted to them; `excluded` parameters stay at their values."""
    training, nominal = runs(session), sensitivities.model_of(session.stage, session.dt)
    return refine.evidence(training, bristle_shape.refit(session, training, nominal, excluded))


def scales_of(session: Session, e: Evidence) -> Scales:
    """Sizes of the machine, with the orders of the pitch and the frequencies that stand out of the residual."""
    of_pitch = orders(e.base.model, e.runs, session.stage.mechanics.pitch, e.base.noise)
    size = candidates.scales(session, e.runs, of_pitch)._replace(
        modes=modes(e.base.model, e.runs, e.base.after, e.base.noise)
    )
    return size._replace(coulomb=max(size.coulomb, sliding(e.base.model.stage.friction)))  # a model may give none


def candidates_of(e: Evidence, size: Scales, options: Options) -> Library:
    """All effects with their columns on these data, next to those of the null ensemble."""
    forms = candidates.forms(candidates.without(definitions(size), options.excluded))
    directions = [direction for form in forms for direction in candidates.directions(form)]
    ensemble = null_ensemble.members(e.base.model, ENSEMBLE_MEMBERS[options.full], ENSEMBLE_SEED, size.coulomb)
    products = gram_matrices.with_columns_by_run(
        e.base.products,
        lambda run: sensitivities.all_columns(e.base.model, [run], [*directions, *ensemble], e.base.noise)[0],
    )
    return library_of(e, forms, products)


def _answer(session: Session, said: Held) -> DiagnosisResult:
    conclusions, location, closure = said.conclusions, said.location, said.validation.closure
    shape = conclusions.unknown or (UNORDERED if closure.open or said.refuted else None)
    spared = unjudged(session, said.selected)
    found = shares.as_improved(conclusions.effects, session.stage, said.validation.improved)
    changed = swept_parameters.swept(session, said.selected.fitted)
    merged = swept_parameters.merged(shares.of_effects(found, closure.shares), changed, shape)
    effects = [confirmed(effect, shape is not None, spared) for effect in merged.effects]
    named = [effect for effect in effects if effect.probability >= NAMED]
    verdict = verdict_of(named, shape)
    agrees = verdict == "none" and closure.gap.at_floor(closure.gap.before)
    return _empty(session, verdict)._replace(
        effects=tuple(effects),
        gap=closure.gap,
        gaps=closure.gaps,
        blocks=location.blocks,
        coordinates=location.coordinates,
        captures=location.captures,
        parts=attribution.of_named(merged.of_effort(location.parts), named),
        shares=tuple(merged.of_gap(closure.shares).items()),
        unknown=merged.unknown,
        traces=tuple(closure.traces),
        notes=(*session.notes, *said.validation.warnings),
        cannot_tell=(*session.cannot_tell, *whitening.unjudged(session), *unknown.without_pitch(session, shape)),
        friction=() if agrees else shares.law_of(session.stage, said.validation),
    )


def verdict_of(named: Sequence[FoundEffect], shape: UnknownTerm | None) -> str:
    """One of `VERDICTS` for the effects that are `named` and the `shape` of the unknown."""
    if any(not effect.parameter for effect in named):
        return "effects+unknown" if shape is not None else "effects"
    if shape is not None:
        return "unknown"
    return "parameters" if named else "none"


def _advised(session: Session, result: DiagnosisResult, selected: Selection, e: Evidence) -> DiagnosisResult:
    """The answer with the next experiment; where none can be made, a note says why."""
    try:
        return result._replace(next_experiment=next_experiment(session, result, selected, e))
    except GapError as error:
        return result._replace(notes=(*result.notes, f"no next experiment: {error}"))


def _unsearched(session: Session, verdict: str, reason: str) -> DiagnosisResult:
    """The answer where the search cannot begin."""
    result = _empty(session, verdict)._replace(reason=reason)
    if verdict == "controller":
        result = result._replace(blocks={block: float(block == "controller") for block in BLOCKS})
    return result._replace(sentence=sentence(result))


def _empty(session: Session, verdict: str) -> DiagnosisResult:
    """An answer that says nothing but its verdict: where the search cannot begin, and before it is filled."""
    unit = unit_on(session.kind, "rad | m")
    return DiagnosisResult(
        verdict,
        "",
        effects=(),
        gap=Gap(np.nan, np.nan, np.nan, unit, np.nan, np.nan, np.nan),
        gaps={},
        blocks=dict.fromkeys(BLOCKS),
        coordinates=(),
        captures=(),
        shares=(),
        doubts=session.doubts,
        notes=session.notes,
        cannot_tell=session.cannot_tell,
        kind=session.kind,
        travel_per_unit=session.travel_per_unit,
        force_constant=session.stage.motor.force_constant,
        travel_unit=session.travel_unit,
        judged_on=HELD_OUT if any(log.held_out for log in session.logs) else UNFITTED,
    )
