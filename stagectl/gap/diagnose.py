"""The pipeline: one session in, one answer out.  Each step is a file of its own; this one only hands on.

::

    session -> runs -> [A controller] -> base refit -> candidates, null ensemble -> search -> names, shifts
            -> where -> shrink on held-out runs -> next experiment -> Found
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from stagectl.gap.controller_check.command_check import CommandCheck, check_command
from stagectl.gap.effects.effect import Scales
from stagectl.gap.effects.library import definitions
from stagectl.gap.experiment_design.experiment_proposal import propose
from stagectl.gap.inference import parameter_errors, time_localisation, verdict
from stagectl.gap.inference.basis_functions import Functions
from stagectl.gap.inference.coordinates import coordinates
from stagectl.gap.inference.signatures import signatures
from stagectl.gap.inference.unknown import functions, largest, with_shape
from stagectl.gap.inference.unknown import unknown as find_unknown
from stagectl.gap.logs.session import Array, GapError, Session
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.residuals.half_strokes import runs
from stagectl.gap.residuals.pitch_orders import modes, orders
from stagectl.gap.result.diagnosis import (
    NAMED,
    NOISE,
    UNORDERED,
    DiagnosisResult,
    FoundEffect,
    Gap,
    NextExperiment,
    UnknownTerm,
)
from stagectl.gap.result.verdict_text import sentence
from stagectl.gap.selection import (
    baseline_fit,
    candidate_scores,
    candidates,
    machine_scales,
    null_ensemble,
    refine,
    search,
)
from stagectl.gap.selection.candidate_scores import Library
from stagectl.gap.selection.detection_thresholds import thresholds
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.swap_tests import Selection
from stagectl.gap.validation import closure, held_out_gap
from stagectl.gap.validation.warnings import doubts
from stagectl.kernels.stage import Stage

Say = Callable[[str], None]  # what is being done
MEMBERS = {False: 12, True: 40}  # of the null ensemble, on the fast and the full path
RESAMPLED = {False: 4, True: 25}  # times for each experiment that is left out
SEED = 20100


class Options(NamedTuple):
    """How a diagnosis is made."""

    excluded: tuple[str, ...] = ()  # effects that must not be candidates
    full: bool = False
    advice: bool = True  # whether the next experiment is looked for


class Diagnosis(NamedTuple):
    """The answer, and the model that it leads to."""

    found: DiagnosisResult
    improved: Stage  # nominal with all that was found


class Clock:
    """Seconds of each step, and what is being done."""

    def __init__(self, say: Say) -> None:
        self._say, self._began, self._name = say, time.monotonic(), ""
        self.steps: list[tuple[str, float]] = []

    def __call__(self, name: str) -> None:
        """The step `name` begins."""
        now = time.monotonic()
        if self._name:
            self.steps.append((self._name, now - self._began))
        self._name, self._began = name, now
        if name:
            self._say(name)


def diagnose(session: Session, options: Options, say: Say) -> Diagnosis:
    """Where the gap lies, which effect causes it, and how far it shrinks.

    Raises GapError where the session has nothing that a diagnosis could start from.
    """
    with threadpool_limits(1):  # rollouts take all cores; threads of the algebra beside them only wait for each other
        return _diagnosed(session, options, Clock(say), say)


def _diagnosed(session: Session, options: Options, clock: Clock, say: Say) -> Diagnosis:
    clock("controller: the command recomputed")
    agreement = check_command(session)
    if agreement.checked and not agreement.agrees:
        return Diagnosis(_controller(session, agreement), session.stage)
    if reason := unidentifiable(session):
        return Diagnosis(_blank(session, "not-identifiable", reason), session.stage)
    evidence, size, library = prepared(session, options, clock)
    clock("search")
    smooth = functions(evidence, size, library)
    selected = search.search(evidence, library, say, lambda now: largest(evidence, now, smooth))
    clock("parameters")
    before, now = closable(evidence, evidence.base.before), selected.fitted
    g = gram_matrices.grams(refine.tangent(evidence, now, refine.parameters(now)), now.residuals)
    deviation = verdict.deviations(evidence, now, g)
    moved = parameter_errors.shifts(session, evidence, now, g, deviation, before)
    clock("where")
    sure = verdict.sure(evidence, selected, verdict.named_effects(session, selected, deviation, apart=False))
    unknown = find_unknown(evidence, sure, smooth)
    clock("held-out runs simulated")
    fitted = now if unknown is None or not unknown.fields else with_shape(evidence, sure.fitted, unknown)
    signed = signatures(session, evidence, fitted, options.excluded)
    improved = _improved(session, [fitted, now])
    noted = doubts(session, evidence, improved)
    for one in signed:
        improved = one.put_in(improved)
    told = closure.told(session, evidence, selected, improved)
    unknown = UNORDERED if unknown is None and told.open else unknown
    named = verdict.named_effects(session, selected, deviation, apart=unknown is None)
    effects = [*verdict.with_signatures(named, signed), *verdict.shifted(session, moved, now)]
    effects = [one for one in effects if one.name not in options.excluded]
    found = _assembled(session, evidence, selected, effects, told, (unknown, improved, agreement, smooth))
    found = found._replace(notes=(*session.notes, *noted))
    clock("next experiment")
    if options.advice:
        found = _advised(session, found, selected, evidence)
    clock("")
    found = found._replace(seconds=tuple(clock.steps))
    return Diagnosis(found._replace(sentence=sentence(found)), improved)


def prepared(session: Session, options: Options, say: Say) -> tuple[Evidence, Scales, Library]:
    """The base refit, the sizes that the data give, and all candidates on them: where every search begins."""
    say("base model refitted")
    training = runs(session)
    refitted = baseline_fit.refit(session, training, sensitivities.model_of(session, session.stage), options.excluded)
    evidence = refine.evidence(training, refitted)
    say("effects simulated along the measured paths")
    size = machine_scales.scales(session, training, orders(training, refitted.after, session.stage.mechanics.pitch))
    size = size._replace(modes=modes(training, refitted.after))
    return evidence, size, candidates_of(evidence, size, options)


def unidentifiable(session: Session) -> str:
    """Why nothing can be told from `session`; empty where something can."""
    training = [log for log in session.logs if not log.held_out]
    if not training:
        return "every log is held out: there is none to find anything in; mark some `use: diagnose`"
    if all(log.command is None and log.current is None for log in training):
        return (
            "no log holds a current or a command: without a force, no motion tells inertia from friction; log the "
            "current, or name its column"
        )
    return ""


def candidates_of(e: Evidence, size: Scales, options: Options) -> Library:
    """All effects with their columns on these data, and what the null ensemble gives each."""
    forms = candidates.forms(candidates.without(definitions(size), options.excluded))
    directions = [one for form in forms for one in candidates.directions(form)]
    without = null_ensemble.members(e.base.model, MEMBERS[options.full], SEED, size.coulomb)
    known = gram_matrices.with_columns_by_run(
        e.base.products,
        lambda run: sensitivities.all_columns(e.base.model, [run], [*directions, *without], e.base.noise)[0],
    )
    g = gram_matrices.fold_sums(known, e.base.after)
    limits = thresholds(g, g.places(candidate_scores.nuisances(e)), forms)
    return Library(
        tuple(forms), known, limits, RESAMPLED[options.full], candidate_scores.closable(e, g), bool(g.current.any())
    )


def closable(e: Evidence, residuals: Sequence[list[Array]]) -> float:
    """Sum of squares above the floor of repeats."""
    return max(refine.total(e, list(residuals)) - refine.floor(e), 1e-300)


def _improved(session: Session, models: Sequence[Fitted]) -> Stage:
    """The best of the fitted models, or the nominal one: the first that closes the loop's gap on the training logs."""
    stages = [*(one.equipped.stage for one in models), session.stage]
    training = [log for log in session.logs if not log.held_out]
    if session.law is None or any(log.setpoints is None for log in training):
        return stages[0]
    return held_out_gap.closest(session, stages, training)


def _assembled(
    session: Session,
    e: Evidence,
    selected: Selection,
    effects: list[FoundEffect],
    told: closure.Told,
    result: tuple[UnknownTerm | None, Stage, CommandCheck, Functions],
) -> DiagnosisResult:
    now, (unknown, improved, agreement, smooth) = selected.fitted, result
    shared = _with_shares(effects, told.shares)
    named = [one for one in shared if one.probability >= NAMED]
    return DiagnosisResult(
        verdict=_name(named, unknown),
        sentence="",
        effects=tuple(shared),
        gap=told.gap,
        gaps=told.gaps,
        blocks=time_localisation.blocks(e, now, agreement),
        coordinates=coordinates(e, smooth),
        captures=tuple(time_localisation.spans(e, now, e.runs, time_localisation.parts(session, now, named, improved))),
        shares=tuple(told.shares.items()),
        unknown=unknown,
        traces=tuple(told.traces),
        cannot_tell=session.cannot_tell,
        kind=session.kind,
        travel_per_unit=session.travel_per_unit,
        travel_unit=session.travel_unit,
    )


def _name(named: Sequence[FoundEffect], unknown: UnknownTerm | None) -> str:
    effects = [one for one in named if not one.parameter]
    if effects:
        return "effects+unknown" if unknown is not None else "effects"
    if unknown is not None:
        return "unknown"
    return "parameters" if named else "none"


def _with_shares(effects: Sequence[FoundEffect], shares: dict[str, float]) -> list[FoundEffect]:
    """Effects with their shares of the closable gap; parameters divide theirs by what each takes of the misfit."""
    whole = max(1.0 - shares.get(NOISE, 0.0), 1e-9)
    total = sum(one.share for one in effects if one.parameter) or 1.0
    parameters = shares.get("parameters", 0.0) / whole
    return [
        one._replace(share=parameters * one.share / total if one.parameter else shares.get(one.name, 0.0) / whole)
        for one in effects
    ]


def _advised(session: Session, found: DiagnosisResult, selected: Selection, e: Evidence) -> DiagnosisResult:
    """The answer with the next experiment; where none can be laid out, a note says why."""
    try:
        return found._replace(next_experiment=_following(session, found, selected, e))
    except GapError as error:
        return found._replace(notes=(*found.notes, f"no next experiment: {error}"))


def _following(session: Session, found: DiagnosisResult, selected: Selection, e: Evidence) -> NextExperiment | None:
    """What separates the effects named from what explains the data as well."""
    ambiguous = [one for one in found.effects if one.alternatives and one.probability >= NAMED and not one.parameter]
    models = {"nominal": session.stage} if not ambiguous else {}
    for one in ambiguous[:1]:
        models[one.name] = selected.fitted.equipped.stage
        models.update(verdict.rivals(e, selected, one))
    return propose(session, models, found.gap.floor)


def _controller(session: Session, agreement: CommandCheck) -> DiagnosisResult:
    found = _blank(session, "controller", agreement.words)
    return found._replace(blocks={"controller": 1.0, "drive": 0.0, "mechanics": 0.0, "sensor": 0.0})


def _blank(session: Session, name: str, reason: str) -> DiagnosisResult:
    unit = "m" if session.kind == "linear" else "rad"
    gap = Gap(np.nan, np.nan, np.nan, unit, np.nan, np.nan, np.nan)
    found = DiagnosisResult(
        name,
        "",
        (),
        gap,
        {},
        {"controller": None, "drive": None, "mechanics": None, "sensor": None},
        (),
        (),
        (),
        reason=reason,
        notes=session.notes,
        cannot_tell=session.cannot_tell,
        kind=session.kind,
        travel_per_unit=session.travel_per_unit,
        travel_unit=session.travel_unit,
    )
    return found._replace(sentence=sentence(found))
