"""Parameters that an effect, or an unknown, changes along the stroke, with the speed, the load or over the session.

The fit has one value of such a parameter: at the middle of the travel, far from rest, on a warm machine.  The nominal
value may be one that the machine has elsewhere, such as the mean, or will have when a drift goes on: no log shows where
it ends, and a machine has more than one time constant.  Then the parameter is not off.  The effect says all, and its
patch holds the value from which it counts.

An unknown is a function of one coordinate, and some parameters are such a function, too: how much of it each of them
holds, nothing shows.  Then the unknown says all.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.effect import MECHANICS
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.result.diagnosis import NAMED, PARAMETERS, UNEXPLAINED, FoundEffect, Part, UnknownTerm
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.refine import Fitted
from stagectl.kernels import stage

# Parameters whose force is a function of a coordinate; derived.  That of the current is any share of the effort; over
# the time each kind of friction has a function of its own.
_OF_UNKNOWN = {
    "speed": ("viscous", "coulomb", "bias"),
    "direction": ("coulomb", "bias"),
    "acceleration": ("inertia",),
    "current": ("inertia", "viscous", "coulomb", "force_constant"),
    "time": ("viscous", "coulomb", "presliding"),
}

Swept = dict[str, dict[str, tuple[float, float]]]  # of each effect: its parameters, and the factors that these have


def swept(session: Session, now: Fitted) -> Swept:
    """The parameters that each effect of `now` changes, with the smallest and largest factor of each in the logs."""
    found = {valued.effect.name: _factors(session, now, valued) for valued in now.effects}
    return {
        name: {parameter: (float(factor.min()), float(factor.max())) for parameter, factor in factors.items()}
        for name, factors in found.items()
        if factors
    }


def _factors(session: Session, now: Fitted, valued: EffectValues) -> dict[str, Array]:
    """The factor (n,) on each parameter that an effect changes, over all logs."""
    variation = valued.effect.time_variation
    if variation is not None:
        ends = np.array([time for log in session.logs for time in (log.start, log.start + log.rows * session.dt)])
        decay = variation.factor(valued.values, np.linspace(ends.min(), ends.max(), 2 * len(ends)))
        return {parameter: 1.0 + valued.values[size] * decay for size, parameter in variation.of.items()}
    if valued.effect.name == "position_friction":
        along = valued.effect.apply(now.model.stage, valued.values).friction.along
        place = np.concatenate([log.position for log in session.logs]) - along.centre
        return {"coulomb": 1.0 + along.slope * place + along.bow * place * place}
    if valued.effect.name == "load_friction":  # from rest to the largest effort of the motor
        most = valued.values["share"] * _largest_effort(session, now) / stage.sliding(now.model.stage.friction)
        return {"coulomb": np.array([1.0, 1.0 + most])}
    if "rise" in valued.values:  # of Stribeck's curve: from the fastest motion to rest
        return {"coulomb": np.array([1.0, 1.0 + valued.values["rise"]])}
    return {}


def _largest_effort(session: Session, now: Fitted) -> float:
    """Of the motor (N m | N), by the current that the drive reports, or else by the command."""
    currents = ((log.command if log.current is None else log.current, log.valid) for log in session.logs)
    most = max((np.max(np.abs(x[valid]), initial=0.0) for x, valid in currents if x is not None), default=0.0)
    return now.model.stage.motor.force_constant * float(most)


class Merged(NamedTuple):
    """Effects with the parameters that they change."""

    effects: list[FoundEffect]
    taken_over: dict[str, float]  # by each of them, and as unexplained, of what all parameters take of the gap
    unknown: UnknownTerm | None = None  # with the fields of its parameters

    def of_gap(self, shares: Mapping[str, float]) -> dict[str, float]:
        """`shares` of the gap, what an effect has taken over from the parameters with it."""
        whole = shares.get(PARAMETERS, 0.0)
        moved = {name: share * whole for name, share in self.taken_over.items()}
        rest = {PARAMETERS: whole - sum(moved.values())} if PARAMETERS in shares else {}
        return {**shares, **rest, **{name: shares.get(name, 0.0) + share for name, share in moved.items()}}

    def of_effort(self, parts: Sequence[Part]) -> tuple[Part, ...]:
        """The same for `parts` of what the nominal model leaves."""
        shares = self.of_gap({part.name: part.share for part in parts if part.block == MECHANICS})
        return tuple(part._replace(share=shares[part.name]) if part.block == MECHANICS else part for part in parts)


def merged(effects: Sequence[FoundEffect], factors: Swept, unknown: UnknownTerm | None = None) -> Merged:
    """The effects, each that is named with the parameters whose nominal value lies within what it changes them by.

    An `unknown` force has its parameters, whatever their value.
    """
    sure = {
        effect.name: factors[effect.name]
        for effect in effects
        if effect.probability >= NAMED and effect.name in factors
    }
    owner = {effect.name: name for effect in effects for name, of in sure.items() if _within(effect, of)}
    held = _OF_UNKNOWN.get(unknown.coordinate, ()) if unknown is not None and unknown.block == MECHANICS else ()
    owner |= {effect.name: UNEXPLAINED for effect in effects if effect.parameter and effect.name in held}
    own = {name: [effect for effect in effects if owner.get(effect.name) == name] for name in owner.values()}
    whole = sum(effect.share for effect in effects if effect.parameter and effect.name != "presliding") or 1.0
    kept = [_with(effect, own.get(effect.name, [])) for effect in effects if effect.name not in owner]
    taken = {name: sum(part.share for part in parts) / whole for name, parts in own.items()}
    return Merged(kept, taken, _with_fields(unknown, own.get(UNEXPLAINED, [])))


def _with_fields(unknown: UnknownTerm | None, own: Sequence[FoundEffect]) -> UnknownTerm | None:
    """The `unknown` with the fields of its parameters, where a stage file has a term for it."""
    if unknown is None or not unknown.fields:
        return unknown
    return unknown._replace(fields=(*(field for effect in own for field in effect.fields), *unknown.fields))


def _with(effect: FoundEffect, own: Sequence[FoundEffect]) -> FoundEffect:
    """`effect` with its `own` parameters: their share, their values, their fields."""
    return effect._replace(
        share=effect.share + sum(other.share for other in own),
        parameters=effect.parameters | {other.name: other.parameters[other.name] for other in own},
        fields=tuple(dict(field for part in (effect, *own) for field in part.fields).items()),
    )


def own_parameters(session: Session, now: Fitted) -> dict[str, list[str]]:
    """Of each effect of `now` the parameters whose nominal value lies within what it changes them by."""
    nominal, fitted = (_values(p) for p in (session.stage, now.model.stage))
    return {
        name: [p for p, factors in of.items() if _covers(factors, fitted[p] / nominal[p])]
        for name, of in swept(session, now).items()
    }


def _values(p: stage.Stage) -> dict[str, float]:
    """Of the parameters that are swept, without end where the model has none."""
    values = {"coulomb": stage.sliding(p.friction), "viscous": p.mechanics.viscous}
    return {name: value or math.inf for name, value in values.items()}


def _within(shift: FoundEffect, factors: Mapping[str, tuple[float, float]]) -> bool:
    return (
        shift.parameter
        and shift.name in factors
        and _covers(factors[shift.name], 1.0 + shift.parameters["change"].value)
    )


def _covers(factors: tuple[float, float], of_nominal: float) -> bool:
    """Whether a parameter has changed from its nominal value to others, or may yet come to it by as much again."""
    low, high = factors
    return (2.0 * low - high) * of_nominal <= 1.0 <= (2.0 * high - low) * of_nominal
