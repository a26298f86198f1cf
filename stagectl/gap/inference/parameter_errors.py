"""Parameters of the model that are off: how far, how surely, and how much of the gap each of them causes.

A shift counts where it is beyond the uncertainty that the half strokes give it, large enough to matter for a model, and
material: without it, the rest of the model, refitted, must fit noticeably worse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.library import FORCE_SCALED
from stagectl.gap.inference import thresholds
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import friction_family, gram_matrices, least_squares
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.result.diagnosis import Value
from stagectl.gap.selection import baseline_fit, refine
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels import stage

UNITS = {
    "inertia": "kg m^2 | kg",
    "viscous": "N m s/rad | N s/m",
    "bias": "N m | N",
    "time_shift": "s",
    "coulomb": "N m | N",
    "presliding": "rad | m",
}  # rotary | linear


class Shift(NamedTuple):
    """One parameter against its nominal value."""

    name: str
    change: float  # relative; of the bias to the friction, of the time shift to the control period
    deviation: float  # of the change
    share: float  # of the closable misfit before the refit that returns without it
    value: Value
    sure: bool


class Estimate(NamedTuple):
    """A parameter as fitted, SI."""

    value: float
    nominal: float
    deviation: float  # standard
    scale: float  # to which its change is relative


def shifts(
    session: Session, e: Evidence, now: Fitted, g: gram_matrices.Grams, deviation: Mapping[str, float], before: float
) -> list[Shift]:
    """All shifts of the refitted model; `before` is the closable misfit of the nominal model.

    `g` holds the columns of all parameters at their fitted values, `deviation` their standard deviations.
    """
    returned = _returned(g, refine.nuisances(e), _moves(session, now))
    estimates = _estimates(session, now, deviation)
    estimates["coulomb"] = _coulomb(session, now, g, list(deviation))
    shares = {name: returned.get(name, 0.0) / before for name in estimates}
    known = [_shift(name, estimate, shares[name], session.kind) for name, estimate in estimates.items()]
    return [*known, *_presliding(session, now)]


def _estimates(session: Session, now: Fitted, deviation: Mapping[str, float]) -> dict[str, Estimate]:
    """Values of the parameters that have a column of their own."""
    p, q = session.stage.mechanics, now.model.stage.mechanics
    estimates = {
        "inertia": (q.inertia, p.inertia, p.inertia),
        "viscous": (q.viscous, p.viscous, p.viscous or 1e-9),
        "bias": (q.bias, p.bias, friction_family.size(session.stage)),
        "time_shift": (now.model.shift, 0.0, session.dt),
    }
    return {
        name: Estimate(value, nominal, deviation[name], scale)
        for name, (value, nominal, scale) in estimates.items()
        if name in deviation
    }


def _coulomb(session: Session, now: Fitted, g: gram_matrices.Grams, names: list[str]) -> Estimate:
    """Coulomb friction, with the deviation of the sum of all weights of its law."""
    places = [names.index(name) for name in names if name.startswith("weight_")]
    variance = gram_matrices.clustered_covariance(g, names)[np.ix_(places, places)].sum()
    nominal, value = (stage.sliding(p.friction) for p in (session.stage, now.model.stage))
    return Estimate(value, nominal, float(np.sqrt(max(variance, 0.0))), friction_family.size(session.stage))


def _moves(session: Session, now: Fitted) -> dict[str, dict[str, float]]:
    """How each parameter would go back to its nominal value, as moves of the base's directions."""
    p, q = session.stage, now.model.stage
    weights = q.friction.operators.weight
    total = max(float(np.sum(weights)), 1e-300)
    change = stage.sliding(q.friction) - stage.sliding(p.friction)
    return {
        "inertia": {"inertia": p.mechanics.inertia - q.mechanics.inertia},
        "viscous": {"viscous": p.mechanics.viscous - q.mechanics.viscous},
        "bias": {"bias": p.mechanics.bias - q.mechanics.bias},
        "time_shift": {"time_shift": -now.model.shift},
        "coulomb": {baseline_fit.weight_name(k): -change * float(w) / total for k, w in enumerate(weights)},
    }


def undone(session: Session, now: Fitted, name: str) -> TrackedModel:
    """The fitted model with one parameter, named as a shift is, back at its nominal value."""
    whole = now.equipped
    if name == "presliding":
        return whole._replace(stage=whole.stage._replace(friction=session.stage.friction))
    if name == "force_constant":
        return whole._replace(stage=session.stage)
    still = {baseline_fit.weight_name(k): 0.0 for k in range(len(whole.stage.friction.operators.weight))}
    return baseline_fit.moved(whole, {**still, **_moves(session, now)[name]}, None)


def _returned(
    g: gram_matrices.Grams, names: Sequence[str], moves: Mapping[str, Mapping[str, float]]
) -> dict[str, float]:
    """Misfit that comes back when one parameter goes back and all others of the model may follow."""
    summed = g.both.sum(axis=0)
    returned = {}
    for name, move in moves.items():
        if not all(part in names for part in move):
            continue
        moved = np.zeros(len(g.names) + 1)
        moved[g.places(list(move))] = list(move.values())
        others = g.places([other for other in names if other not in move])
        column = summed @ moved
        whole = float(moved @ column)
        followed = float(column[others] @ least_squares.inverse(summed[np.ix_(others, others)]) @ column[others])
        returned[name] = max(whole - followed, 0.0)
    return returned


def _unit(name: str, kind: str) -> str:
    rotary, *linear = UNITS[name].split(" | ")
    return linear[0] if linear and kind == "linear" else rotary


def _shift(name: str, p: Estimate, share: float, kind: str) -> Shift:
    change, spread = (p.value - p.nominal) / p.scale, p.deviation / p.scale
    large = abs(change) > thresholds.SHIFT_LEAST[name] and abs(change) > thresholds.SHIFT_SIGMA * spread
    half = 1.96 * p.deviation
    value = Value(p.value, p.value - half, p.value + half, _unit(name, kind))
    return Shift(name, change, spread, share, value, large and share > thresholds.SHIFT_SHARE)


def _presliding(session: Session, now: Fitted) -> list[Shift]:
    """The shift of the rolling zone's length; none without friction, which has no rolling zone.

    It has no column of its own, so it counts as material and its deviation is a share of itself.
    """
    p, q = session.stage.friction, now.model.stage.friction
    if min(stage.sliding(p), stage.sliding(q)) < thresholds.FRICTIONLESS * max(
        stage.sliding(p), stage.sliding(q), 1e-300
    ):
        return []
    before, after = half_way(p), half_way(q)
    estimate = Estimate(after, before, thresholds.PRESLIDING_ERROR * before, before)
    return [_shift("presliding", estimate, 1.01 * thresholds.SHIFT_SHARE, session.kind)]


def half_way(p: stage.Friction) -> float:
    """Displacement after a reversal at which half of the friction has turned round (rad | m)."""
    grid = np.geomspace(1e-4, 3.0, 400) * friction_family.length(p)
    curve: Array = friction_family.reversal(p, grid)
    return float(np.interp(0.5 * curve[-1], curve, grid))


def shared(known: Sequence[Shift]) -> frozenset[str]:
    """Those of inertia, viscous and Coulomb friction that have shifted as another of them has.

    A force constant that is off shifts all three alike.  Where two agree and the third has changed by itself, the force
    constant and that third one explain the data as well.
    """
    scaled = [shift for shift in known if shift.sure and shift.name in FORCE_SCALED and shift.change > thresholds.LOST]
    logs = {shift.name: np.log1p(shift.change) for shift in scaled}
    return frozenset(
        name
        for name, log in logs.items()
        if any(abs(log - other) < thresholds.COMMON_SPREAD for rival, other in logs.items() if rival != name)
    )


def common(known: Sequence[Shift]) -> Shift | None:
    """A common shift of inertia, viscous and Coulomb friction: exactly that of the force constant, the other way.

    None where the three do not agree.
    """
    by_name = {shift.name: shift for shift in known}
    three = [by_name[name] for name in FORCE_SCALED if name in by_name]
    if len(three) < 3 or not all(
        abs(shift.change) > thresholds.COMMON_LEAST and shift.change > thresholds.LOST for shift in three
    ):
        return None
    logs = np.log1p([shift.change for shift in three])
    if np.ptp(logs) > thresholds.COMMON_SPREAD or not any(shift.sure for shift in three):
        return None
    scale = float(np.exp(-logs[0]))  # the inertia is known best
    width = 1.96 * max(three[0].deviation, thresholds.COMMON_ERROR)
    value = Value(scale - 1.0, scale - 1.0 - width, scale - 1.0 + width, "")
    return Shift("force_constant", scale - 1.0, three[0].deviation, sum(shift.share for shift in three), value, True)
