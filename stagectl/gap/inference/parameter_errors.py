"""Parameters of the model that are off: how far, how surely, and how much of the gap each of them causes.

A shift counts where it is more probable than none, large enough to matter for a model, and material: without it, the
rest of the model, refitted, must fit noticeably worse.  Where only several together are material, because each stands
in for the others, the one that explains most alone counts, and the others are its alternatives.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import expit, ndtr

from stagectl.gap.effects.library import FORCE_SCALED
from stagectl.gap.inference import rolling_zone, thresholds
from stagectl.gap.inference.estimates import Estimate, estimates, whole_delay
from stagectl.gap.inference.value_errors import Errors, log_odds
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import gram_matrices, least_squares
from stagectl.gap.residuals.gram_matrices import NORMAL
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.result.diagnosis import NAMED, Value
from stagectl.gap.selection import baseline_fit, constants, linearised, refine, simulation_odds
from stagectl.gap.selection.evidence import fitted_odds
from stagectl.gap.selection.linearised import Remains
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels import stage
from stagectl.kernels.fields import put
from stagectl.units import unit_on

UNITS = {
    "inertia": "kg m^2 | kg",
    "viscous": "N m s/rad | N s/m",
    "bias": "N m | N",
    "time_shift": "s",
    "dead_time": "s",
    "coulomb": "N m | N",
    "presliding": "rad | m",
}  # rotary | linear


POSITIVE = ("inertia", "viscous", "coulomb", "presliding", "dead_time")


class Shift(NamedTuple):
    """One parameter against its nominal value."""

    name: str
    change: float  # relative; of the bias to the friction, of the time shift to the control period
    deviation: float  # of the change
    share: float  # misfit that returns without it, over that of the nominal model or what this one leaves (`_scale`)
    value: Value
    probability: float
    alike: tuple[str, ...] = ()  # parameters of which one explains as much
    from_nothing: bool = False  # the nominal value is 0: no force constant makes something of it
    scale: float = 1.0  # to which the change is relative

    @property
    def sure(self) -> bool:
        """Whether it counts."""
        return self.probability > NAMED and self.share > thresholds.SHIFT_SHARE


class Material(NamedTuple):
    """What the model loses without a shift."""

    misfit: float  # that returns
    given: tuple[str, ...] = ()  # other parameters that stay at their nominal values
    alike: tuple[str, ...] = ()  # those of them that explain about as much alone


def shifts(session: Session, e: Evidence, now: Fitted, known: Sequence[Errors]) -> list[Shift]:
    """All shifts of the refitted model.

    `known` are the errors next to the model alone, and beside what is unnamed.  That the unnamed is a function of one
    coordinate is no more than a guess, so a shift is as probable as under the less favourable of the two.
    """
    scale = _scale(e, now)
    moves = {name: move for name, move in _moves(session, e, now).items() if set(move) <= set(refine.nuisances(e))}
    moves = {name: _of_columns(move, session, now) for name, move in moves.items()}
    material = _materials(known[0].grams, refine.nuisances(e), moves, thresholds.SHIFT_SHARE * scale)
    views = [estimates(session, e, now, errors) for errors in known]
    parts = {name: material.get(name, Material(0.0)) for name in views[0].estimates}
    of_columns = [
        _shift(name, [view.given(name, part.given) for view in views], part.misfit / scale, session.kind, part.alike)
        for name, part in parts.items()
    ]
    return [*of_columns, *_presliding(session, e, now, known, scale)]


def _scale(e: Evidence, now: Fitted) -> float:
    """Misfit to which what a shift is worth is compared: the nominal model's above the noise, or all that `now` leaves.

    The smaller one counts.  Another error that is large makes none immaterial, and neither does noise where there is
    little to close.
    """
    before = refine.total(e, list(e.base.before)) - refine.floor(e)
    return max(min(before, refine.total(e, now.residuals)), 1e-300)


def _moves(session: Session, e: Evidence, now: Fitted) -> dict[str, dict[str, float]]:
    """How each parameter would go back to its nominal value, as moves of the base's directions.

    All that rubs goes back in proportion: stop operators and bristle.
    """
    p, q = session.stage, now.model.stage
    back = stage.sliding(p.friction) / max(stage.sliding(q.friction), 1e-300) - 1.0
    rubs = {baseline_fit.weight_name(k): float(weight) for k, weight in enumerate(q.friction.operators.weight)}
    if e.base.bristle is not None:
        rubs[e.base.bristle.name] = q.friction.bristle.coulomb
    elif q.friction.bristle.coulomb:
        rubs["bristle_size"] = 1.0
    return {
        "inertia": {"inertia": p.mechanics.inertia - q.mechanics.inertia},
        "viscous": {"viscous": p.mechanics.viscous - q.mechanics.viscous},
        "bias": {"bias": p.mechanics.bias - q.mechanics.bias},
        "time_shift": {"time_shift": -now.model.shift},
        "dead_time": {"dead_time": whole_delay(p, session.dt) - whole_delay(q, session.dt)},
        "coulomb": {name: back * force for name, force in rubs.items()},
    }


def _of_columns(move: Mapping[str, float], session: Session, now: Fitted) -> dict[str, float]:
    """A move in the units of the columns: that of the nominal bristle counts in shares of its nominal force."""
    share = now.model.stage.friction.bristle.coulomb / (session.stage.friction.bristle.coulomb or 1.0)
    return {part: size * (share if part == "bristle_size" else 1.0) for part, size in move.items()}


def undone(session: Session, e: Evidence, now: Fitted, *names: str) -> TrackedModel:
    """The fitted model with parameters, named as shifts are, back at their nominal values."""
    model, moves = now.equipped, _moves(session, e, now)
    for name in names:
        if name == "presliding":
            model = put(model, "stage.friction", session.stage.friction)
        elif name == "force_constant":
            model = model._replace(stage=session.stage)
        else:
            model = refine.moved(e, model, moves[name])
    return model


def _materials(
    g: gram_matrices.Grams, names: Sequence[str], moves: Mapping[str, Mapping[str, float]], least: float
) -> dict[str, Material]:
    """What each of `moves` is worth; one that returns less than `least` alone may be material with others."""
    summed = g.both.sum(axis=0)

    def returned(back: Sequence[str]) -> float:
        """Misfit that comes back when these go back to their nominal values and all others may follow."""
        move = {part: size for name in back for part, size in moves[name].items()}
        moved = np.zeros(len(g.names) + 1)
        moved[g.places(list(move))] = list(move.values())
        others = g.places([name for name in names if name not in move])
        column = summed @ moved
        followed = float(column[others] @ least_squares.inverse(summed[np.ix_(others, others)]) @ column[others])
        return max(float(moved @ column) - followed, 0.0)

    found = {name: Material(returned([name])) for name in moves}
    hidden = [name for name, alone in found.items() if alone.misfit <= least]
    while hidden and (together := returned(hidden)) > least:
        without = {name: returned([other for other in hidden if other != name]) for name in hidden}
        best = min(hidden, key=lambda name: without[name])
        hidden.remove(best)
        alike = tuple(name for name in hidden if without[name] - without[best] <= least)
        found[best] = Material(together - without[best], tuple(hidden), alike)
    return found


def _shift(name: str, views: Sequence[Estimate], share: float, kind: str, alike: tuple[str, ...] = ()) -> Shift:
    """The shift of the first of `views`, as sure as the least sure of them."""
    p, sure = views[0], min(_probability(name, view) for view in views)
    error = max(float(np.hypot(view.deviation, view.value - p.value)) for view in views)
    change, spread, half = (p.value - p.nominal) / p.scale, error / p.scale, NORMAL * error
    lowest, larger = 0.0 if name in POSITIVE else -np.inf, max(view.larger for view in views)
    value = Value(p.value, max(p.value - half, lowest), p.value + half + larger, unit_on(kind, UNITS[name]))
    return Shift(name, change, spread, share, value, sure, alike, p.nominal == 0.0, p.scale)


def _probability(name: str, p: Estimate) -> float:
    """Probability that a parameter has changed, and by more than what matters for a model.

    Of the values between which it lies, that counts which is nearest to the nominal one.  At most even where the
    interval holds the nominal value: the prior alone is no finding.
    """
    spread, moved = max(p.deviation, 1e-9 * p.scale), p.value - p.nominal
    moved = min(moved + p.larger, 0.0) if moved < 0.0 else moved
    factor = log_odds(np.array([moved]), np.array([[spread**2]]), np.array([max(p.prior, 1e-300)]))
    odds = np.log(shift_odds(name, p.nominal)) + factor
    least = thresholds.SHIFT_LEAST[name] * p.scale
    beyond = ndtr((moved - least) / spread) + ndtr((-moved - least) / spread)
    probability = float(expit(odds) * beyond)
    return probability if abs(moved) > NORMAL * spread else min(probability, NAMED)


def shift_odds(name: str, nominal: float) -> float:
    """Prior odds that a parameter is off."""
    return constants.INCLUSION if name in thresholds.MAY_BE_NONE and nominal == 0.0 else 1.0


def _presliding(session: Session, e: Evidence, now: Fitted, known: Sequence[Errors], scale: float) -> Iterator[Shift]:
    """The shift of the rolling zone's length; without friction there is no rolling zone.

    It has no column of its own: what it is worth tells the simulation with the nominal zone, that rubs as much.
    """
    nominal = session.stage.friction
    sizes = [stage.sliding(p) for p in (nominal, now.model.stage.friction)]
    if min(sizes) <= thresholds.FRICTIONLESS * max(sizes):
        return
    zone = stage.scaled_friction(nominal, sizes[1] / sizes[0])
    other = refine.residuals(e, put(now.model, "stage.friction", zone), now.effects)
    without, present = (_beside_friction(e, residuals) for residuals in (other, now.residuals))
    odds = fitted_odds(simulation_odds.gain_of_strokes(without, present), 1, len(present.strokes))
    views = [view for errors in known for view in rolling_zone.lengths(nominal, now, errors, e.base.bristle)]
    share = max(float(np.sum(without.strokes - present.strokes)), 0.0) / scale
    found = _shift("presliding", views, share, session.kind)
    yield found._replace(probability=min(found.probability, float(expit(odds))))


def _beside_friction(e: Evidence, residuals: list[list[Array]]) -> Remains:
    """What is left of `residuals` in each half stroke, where all parameters but those of the friction may follow.

    A rolling zone shows at each reversal: every half stroke counts by itself.
    """
    own = [name for name in refine.nuisances(e) if name in UNITS]
    g = gram_matrices.grams(gram_matrices.selected(e.base.products, own), residuals)
    fit = least_squares.fit(g.effort.sum(axis=0), g.places(own))
    left = np.append(-fit.amplitude, 1.0)
    samples = linearised.samples(e)
    return Remains((g.effort @ left) @ left, g.floor[:, 0], samples, (1,) * len(samples), 0.0)


def of_force(known: Sequence[Shift]) -> list[Shift]:
    """Those of inertia, viscous and Coulomb friction, in this order, that a force constant that is off would shift."""
    by_name = {shift.name: shift for shift in known if not shift.from_nothing}
    return [by_name[name] for name in FORCE_SCALED if name in by_name]


def shared(known: Sequence[Shift]) -> frozenset[str]:
    """Those of inertia, viscous and Coulomb friction that have shifted as another of them has.

    A force constant that is off shifts all three alike.  Where two agree and the third has changed by itself, the force
    constant and that third one explain the data as well.
    """
    scaled = [shift for shift in of_force(known) if shift.sure and shift.change > thresholds.LOST]
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
    three = of_force(known)
    if len(three) < 3 or not all(
        abs(shift.change) > thresholds.COMMON_LEAST and shift.change > thresholds.LOST for shift in three
    ):
        return None
    logs = np.log1p([shift.change for shift in three])
    if np.ptp(logs) > thresholds.COMMON_SPREAD or not any(shift.sure for shift in three):
        return None
    scale = float(np.exp(-logs[0]))  # the inertia is known best
    width = NORMAL * max(three[0].deviation, thresholds.COMMON_ERROR)
    value = Value.around(scale - 1.0, width, "")
    return Shift(
        "force_constant",
        scale - 1.0,
        three[0].deviation,
        sum(shift.share for shift in three),
        value,
        max(shift.probability for shift in three),
    )
