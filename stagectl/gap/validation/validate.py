"""The conclusions judged in closed loop: which model follows the logs best, and how far the gap closes with it."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.library import label
from stagectl.gap.inference.beside_unknown import stands
from stagectl.gap.inference.conclusions import Conclusions
from stagectl.gap.inference.signatures import put_in
from stagectl.gap.logs.session import Log, Session
from stagectl.gap.residuals import sensitivities
from stagectl.gap.result.diagnosis import NAMED, FoundEffect
from stagectl.gap.selection import refine
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.validation import held_out_gap, rollouts
from stagectl.gap.validation.closure import Closure, closure, effort, rubbing, slides
from stagectl.gap.validation.thresholds import NEARLY_CLOSEST
from stagectl.identification.capture_checks import force_scaled, implausible
from stagectl.kernels.stage import Stage

NOTHING_HELD_OUT = (
    "no log is held out: the gap after is that of blocks of the runs, each with the values that were fitted to "
    "the other blocks; the effects themselves were chosen on all blocks"
)
NOTHING_CLOSER = (
    "no fitted model brings the simulation closer to the logs, so none is applied: the gap after is that of the "
    "nominal model, and an effect that is named explains forces without improving it"
)


class Validation(NamedTuple):
    """What the held-out runs say."""

    improved: Stage  # nominal with all that was found
    closure: Closure
    warnings: tuple[str, ...]


def validate(session: Session, e: Evidence, selected: Selection, conclusions: Conclusions) -> Validation:
    """The best of the models that were found, with the drive's signatures, on runs that chose nothing.

    Where the gap of these is wider with it, none is applied.
    """
    alone = _effects_alone(session, e, selected, conclusions)
    first = [fitted.equipped.stage for fitted in alone]
    best = _best_model(session, e, [*first, *_models(session, conclusions), session.stage])
    judged = next((fitted for fitted, stage in zip(alone, first, strict=True) if stage is best), None)
    improved = put_in(best, conclusions.signatures)
    found = closure(session, e, selected, improved, judged)
    if found.gap.after > found.gap.before:
        best = improved = session.stage
        found = closure(session, e, selected, improved)
    lines = [*warnings(session, e, best), *scale_doubt(session.stage, improved, conclusions.shifts)]
    return Validation(improved, found, tuple(lines))


def _effects_alone(session: Session, e: Evidence, selected: Selection, conclusions: Conclusions) -> list[Fitted]:
    """The effects on the nominal values, where none of these is said to be off: what is not named is not moved.

    The fit moves all of them, within their doubt.  Where the truth was the nominal value, that may lead the loop away.
    """
    if not selected.fitted.effects or any(shift.probability >= NAMED for shift in conclusions.shifts):
        return []
    return [refine.at_values(e, sensitivities.model_of(session.stage, session.dt), selected.fitted.effects)]


def _models(session: Session, conclusions: Conclusions) -> list[Stage]:
    """The models that were found, each after itself with the nominal curve of the friction.

    A curve is fitted to the effort, and may lead away in the loop: on a Dahl machine it widened the gap by 3 %, and the
    tracking error by half.  So it has to bring the loop closer.  Where its length is named, it has been judged.
    """
    nominal = session.stage.friction
    if any(shift.name == "presliding" and shift.probability >= NAMED for shift in conclusions.shifts):
        return list(conclusions.models)
    pairs = [
        [p._replace(friction=rubbing(p.friction, nominal)), p] if slides(p, session.stage) else [p]
        for p in conclusions.models
    ]
    return [p for pair in pairs for p in pair]


def confirmed(effect: FoundEffect, unexplained: bool, spared: Collection[str]) -> FoundEffect:
    """`effect` as the loop confirms it: where something is `unexplained`, one that takes nothing of the gap is not it.

    Fitted next to a cause without a name, an effect or a parameter takes on a part of that.  Of those that are `spared`
    the loop says little: see `closure.unjudged`.
    """
    if not unexplained or effect.share > 0.0 or effect.name in spared:
        return effect
    return effect._replace(probability=min(effect.probability, stands(0.0, 1.0)))


def refuted_words(name: str) -> str:
    """The note on an effect that the logs which are judged refute."""
    return (
        f"{label(name)} explains forces, but the simulation follows the judged logs more closely without it: what it "
        "explains has another cause, and it is not named"
    )


def _best_model(session: Session, e: Evidence, stages: Sequence[Stage]) -> Stage:
    """The first of `stages` that closes the gap on the training logs: of the loop, or of the effort without one."""
    training = [log for log in session.logs if not log.held_out]
    if session.law is None or any(log.setpoints is None for log in training):
        models = (e.base.model._replace(stage=stage) for stage in stages)
        sums = [float(effort(model, e.runs, e.base.noise, session.dt).squares.sum()) for model in models]
        return _nearly_closest(stages, sums)
    return closest(session, stages, training)


def closest(session: Session, stages: Sequence[Stage], logs: Sequence[Log]) -> Stage:
    """The first of `stages` whose loop follows `logs` nearly as closely as that of the best of them.

    A model that explains more of the effort need not bring its position closer: a table or a fit that leads away from
    the logs that it was made on is dropped.
    """
    judged = held_out_gap.judged_logs(session, logs)
    rows = [rollouts.simulated_logs(session, stage, logs) for stage in stages]
    sums = [float(np.sum(held_out_gap.remaining(judged, simulated))) for simulated in rows]
    return _nearly_closest(stages, sums)


def _nearly_closest(stages: Sequence[Stage], sums: Sequence[float]) -> Stage:
    limit = NEARLY_CLOSEST * np.nanmin(sums)
    return next(stage for stage, remaining in zip(stages, sums, strict=True) if remaining <= limit)


def scale_doubt(nominal: Stage, improved: Stage, shifts: Sequence[FoundEffect]) -> list[str]:
    """A warning where what was found is so far from `nominal` that a unit or the scale of the force is in doubt.

    Only the `shifts` that are named count: a value that the logs do not tell may lie anywhere.
    """
    told = {shift.name for shift in shifts if shift.probability >= NAMED}
    at_nominal = nominal.motor.force_constant / improved.motor.force_constant
    known = {name: at_nominal * value for name, value in force_scaled(improved).items()}
    return implausible({name: x for name, x in known.items() if {name, "force_constant"} & told}, nominal)


def warnings(session: Session, e: Evidence, improved: Stage) -> list[str]:
    """Warnings of repeats that are copies, of runs that were used twice, and of a fit that the loop does not confirm.

    `improved` is the model that the loop was found to follow best.
    """
    lines = []
    copies = sum(not log.held_out for log in session.logs) - sum(len(run.logs) for run in e.runs)
    if copies:
        lines.append(f"{copies} repeats are copies, to the last bit, and are ignored: they show nothing of the noise")
    if not any(log.held_out for log in session.logs):
        lines.append(NOTHING_HELD_OUT)
    if improved is session.stage:
        lines.append(NOTHING_CLOSER)
    return lines
