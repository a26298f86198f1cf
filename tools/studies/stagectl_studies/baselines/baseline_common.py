"""What all baselines stand on: the session, its base refit, and the dictionary; and the form of their answers."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from stagectl.gap import diagnose
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.selection import linearised
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.evidence import Weighed
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels import stage
from stagectl.kernels.stage import Stage

SHIFT = 0.01  # share from which a refitted value is told


class Ground(NamedTuple):
    """A session with its base refit and its dictionary."""

    session: Session
    evidence: Evidence
    library: Library


class Answer(NamedTuple):
    """What a baseline says: names, surest first, and the model or the predictions it leads to."""

    names: tuple[str, ...]
    improved: Stage | None
    shifts: tuple[str, ...] = ()  # of values that the model has
    predicted: tuple[Array, ...] = ()  # (n,) rad, of each held-out log, where no model was made


def ground(session: Session, excluded: Sequence[str]) -> Ground:
    """The same steps as those of the diagnosis, up to its search."""
    options = diagnose.Options(tuple(excluded))
    e = diagnose.baseline(session, options.excluded)
    return Ground(session, e, diagnose.candidates_of(e, diagnose.scales_of(session, e), options))


def shifts(g: Ground) -> tuple[str, ...]:
    """Values of the model that the refit has moved by more than `SHIFT`."""
    before, after = g.session.stage, g.evidence.base.model.stage
    coulomb = stage.sliding(before.friction)
    changes = {
        "inertia": after.mechanics.inertia / before.mechanics.inertia - 1.0,
        "viscous": (after.mechanics.viscous - before.mechanics.viscous) / max(before.mechanics.viscous, 1e-12),
        "coulomb": stage.sliding(after.friction) / coulomb - 1.0,
        "bias": (after.mechanics.bias - before.mechanics.bias) / coulomb,
    }
    return tuple(name for name, change in changes.items() if abs(change) > SHIFT)


def singles(g: Ground, now: Fitted) -> dict[str, EffectValues]:
    """Every effect that may join the model, at its most probable place alone; the most probable effect first."""
    at = linearised.linearised(g.evidence, g.library, now)
    best: dict[str, Weighed] = {}
    for item in at.verdict.sets:
        if len(item.members) == 1:
            (name,) = item.effects
            best.setdefault(name, item)
    return {name: at.values(item)[0] for name, item in best.items()}


def as_json(answer: Answer) -> dict[str, Any]:
    """The answer as that of a diagnosis: effects first, then shifts of values."""
    effects = [_effect(name, False) for name in answer.names] + [_effect(name, True) for name in answer.shifts]
    verdict = "effects" if answer.names else "parameters" if answer.shifts else "none"
    return {"verdict": verdict, "effects": effects, "gap": {}, "where": {}, "next_experiment": None}


def _effect(name: str, parameter: bool) -> dict[str, Any]:
    return {"name": name, "alternatives": [], "probability": 1.0, "parameter": parameter, "parameters": {}}
