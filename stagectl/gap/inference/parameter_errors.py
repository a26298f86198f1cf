"""Parameters of the model that are off: how far, how surely, and how much of the gap each of them takes.

A shift counts where it is beyond what the half strokes say of its own uncertainty, large enough to matter for a
model, and material: without it the rest of the model, refitted, must lack noticeably more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.library import FORCE_SCALED
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import friction_family, gram_matrices, least_squares, linear_fit
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.result.diagnosis import Value
from stagectl.gap.selection import baseline_fit, refine
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels import stage

SURE = 4.0  # standard deviations
RUBS = 0.01  # of the larger Coulomb friction, nominal or fitted: below it the length of the smaller means nothing
MATERIAL = 0.005  # of the closable misfit before the refit
LEAST = {"inertia": 0.01, "viscous": 0.02, "coulomb": 0.02, "presliding": 0.25, "bias": 0.02, "time_shift": 0.1}
COMMON = 0.006  # spread of the logarithms of J, D and T_c within which their shift is one common scale


class Shift(NamedTuple):
    """One parameter against its nominal value."""

    name: str
    change: float  # relative; of the bias to the friction, of the time shift to the control period
    deviation: float  # of the change
    share: float  # of the closable misfit before the refit that returns without it
    value: Value
    sure: bool


def shifts(
    session: Session, e: Evidence, now: Fitted, g: gram_matrices.Grams, deviation: Mapping[str, float], before: float
) -> list[Shift]:
    """All shifts of the refitted model; `before` is the closable misfit of the nominal model.

    `g` holds the columns of all parameters where they stand, `deviation` the standard deviations of these.
    """
    names = list(deviation)
    returned = _returned(g, refine.nuisances(e), _moves(session, now))
    found = [
        _plain(session, now, name, deviation[name], returned.get(name, 0.0) / before)
        for name in ("inertia", "viscous", "bias", "time_shift")
        if name in deviation
    ]
    weights = [name for name in names if name.startswith("weight_")]
    places = [names.index(name) for name in weights]
    coulomb_sd = float(np.sqrt(max(linear_fit.clustered_covariance(g, names)[np.ix_(places, places)].sum(), 0.0)))
    return [*found, *_friction(session, now, coulomb_sd, returned.get("coulomb", 0.0) / before)]


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
    found = {}
    for name, move in moves.items():
        if not all(part in names for part in move):
            continue
        moved = np.zeros(len(g.names) + 1)
        moved[g.places(list(move))] = list(move.values())
        others = g.places([one for one in names if one not in move])
        column = summed @ moved
        whole = float(moved @ column)
        rest = float(column[others] @ least_squares.inverse(summed[np.ix_(others, others)]) @ column[others])
        found[name] = max(whole - rest, 0.0)
    return found


def _plain(session: Session, now: Fitted, name: str, deviation: float, share: float) -> Shift:
    p, q = session.stage, now.model.stage
    coulomb = friction_family.size(p)
    value, nominal, scale, unit = {
        "inertia": (q.mechanics.inertia, p.mechanics.inertia, p.mechanics.inertia, "kg m^2 | kg"),
        "viscous": (q.mechanics.viscous, p.mechanics.viscous, p.mechanics.viscous or 1e-9, "N m s/rad | N s/m"),
        "bias": (q.mechanics.bias, p.mechanics.bias, coulomb, "N m | N"),
        "time_shift": (now.model.shift, 0.0, session.dt, "s"),
    }[name]
    return _shift(name, (value, nominal), (deviation, scale), share, _unit(unit, session.kind))


def _unit(both: str, kind: str) -> str:
    parts = [part.strip() for part in both.split("|")]
    return parts[-1] if kind == "linear" else parts[0]


def _shift(name: str, values: tuple[float, float], sizes: tuple[float, float], share: float, unit: str) -> Shift:
    (value, nominal), (deviation, scale) = values, sizes
    change, spread = (value - nominal) / scale, deviation / scale
    large = abs(change) > LEAST[name] and abs(change) > SURE * spread
    shown = Value(value, value - 1.96 * deviation, value + 1.96 * deviation, unit)
    return Shift(name, change, spread, share, shown, large and share > MATERIAL)


def _friction(session: Session, now: Fitted, deviation: float, share: float) -> list[Shift]:
    p, q = session.stage.friction, now.model.stage.friction
    unit, scale = _unit("N m | N", session.kind), friction_family.size(session.stage)
    found = [_shift("coulomb", (stage.sliding(q), stage.sliding(p)), (deviation, scale), share, unit)]
    if min(stage.sliding(p), stage.sliding(q)) < RUBS * max(stage.sliding(p), stage.sliding(q), 1e-300):
        return found  # what does not rub has no rolling zone
    before, after = half_way(p), half_way(q)
    length = _unit("rad | m", session.kind)
    stretch = _shift("presliding", (after, before), (0.03 * before, before), 1.01 * MATERIAL, length)
    return [*found, stretch]


def half_way(p: stage.Friction) -> float:
    """Displacement after a reversal at which half of the friction has turned round (rad | m)."""
    grid = np.geomspace(1e-4, 3.0, 400) * friction_family.length(p)
    curve: Array = friction_family.reversal(p, grid)
    return float(np.interp(0.5 * curve[-1], curve, grid))


def shared(found: Sequence[Shift]) -> frozenset[str]:
    """Those of inertia, viscous and Coulomb friction that have shifted as another of them has.

    One force constant that is off shifts all three alike; two that agree while the third has changed by itself are as
    well explained by it and that one.
    """
    scaled = [one for one in found if one.sure and one.name in FORCE_SCALED and one.change > -0.9]
    pairs = [(one, other) for one in scaled for other in scaled if one is not other]
    alike = [one for one, other in pairs if abs(np.log1p(one.change) - np.log1p(other.change)) < COMMON]
    return frozenset(one.name for one in alike)


def common(found: Sequence[Shift]) -> Shift | None:
    """A common shift of inertia, viscous and Coulomb friction: exactly that of the force constant, the other way."""
    by_name = {one.name: one for one in found}
    three = [by_name[name] for name in FORCE_SCALED if name in by_name]
    if len(three) < 3 or not all(abs(one.change) > 0.01 and one.change > -0.9 for one in three):
        return None
    logs = np.log1p([one.change for one in three])
    if np.ptp(logs) > COMMON or not any(one.sure for one in three):
        return None
    scale = float(np.exp(-logs[0]))  # the inertia is known best
    width = 1.96 * max(three[0].deviation, 0.002)
    value = Value(scale - 1.0, scale - 1.0 - width, scale - 1.0 + width, "")
    return Shift("force_constant", scale - 1.0, three[0].deviation, sum(one.share for one in three), value, True)
