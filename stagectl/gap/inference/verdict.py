"""From fits to names: effects with their probabilities, their rivals, their values and their intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from stagectl.gap.effects import library
from stagectl.gap.effects.effect import Amplitude, Data, Definition, Shape
from stagectl.gap.effects.library import FORCE_SCALED
from stagectl.gap.inference import patch_fields
from stagectl.gap.inference.parameter_errors import Shift, common, shared
from stagectl.gap.inference.signatures import Signature
from stagectl.gap.logs.session import GapError, Session
from stagectl.gap.residuals import friction_family, linear_fit
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.result.diagnosis import NAMED, Fields, FoundEffect, Value
from stagectl.gap.selection import refine
from stagectl.gap.selection.candidates import EffectValues, equipped
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.swap_tests import Selection
from stagectl.kernels.stage import Stage

AS_GOOD = 0.9  # of an effect's own gain: what takes as much explains these data as well
SHARPNESS = 8.0  # how fast a rival's weight falls with what it lacks of the gain
STEEPNESS = 1.5  # with which doubt falls as the gain rises beyond its limit
OF_JITTER = 4.0  # a longer mean delay than that is there beside the jitter
FAINT = 0.25  # of what stays unexplained: what took less may be a part of that
LEAKS = 0.01  # the same for a delay in the drive that lies at its bound
# Standard deviations: what bends the time shift of the base looks like a delay, but less sure; a shift by a part of a
# sample looks like a slower loop.
SURE = {"dead_time": 10.0, "current_loop": 40.0}
STABLE = 0.8  # share of resamples in which an effect must be found again
EVEN = 0.55  # least share of a found effect against its rivals


def named_effects(
    session: Session, selected: Selection, deviation: Mapping[str, float], apart: bool
) -> list[FoundEffect]:
    """The effects of the search, the surest gains first, with the `deviation` of their parameters.

    `apart`: what one experiment shows clearly counts, whatever is left in the others.  So it is where only the form of
    friction is left; where an unknown is, an effect may be a part of that.
    """
    now = selected.fitted
    found = [_effect(session, now, one, (selected, apart), deviation) for one in now.effects]
    order = {one.effect.name: selected.gains[one.effect.name] for one in now.effects}
    return [part for one in sorted(found, key=lambda one: -order[one.name]) for part in _parted(one)]


def _parted(one: FoundEffect) -> list[FoundEffect]:
    """An effect that works on another one, and that other one: what lags is a Stribeck friction."""
    if one.name != "friction_lag":
        return [one]
    curve = {name: value for name, value in one.parameters.items() if name != "lag"}
    others = tuple(name for name in one.alternatives if name != "stribeck")
    return [one._replace(name="stribeck", parameters=curve, coordinate="speed", alternatives=others), one]


def sure(e: Evidence, selected: Selection, found: Sequence[FoundEffect]) -> Selection:
    """`selected` without what is not named: a cause in doubt must not hide that something is there."""
    named = {one.name for one in found if one.probability >= NAMED}
    stay = [one for one in selected.fitted.effects if one.effect.name in named]
    if len(stay) == len(selected.fitted.effects):
        return selected
    return selected._replace(fitted=refine.refine(e, selected.fitted.model, stay))


def with_signatures(effects: Sequence[FoundEffect], found: Sequence[Signature]) -> list[FoundEffect]:
    """Effects and the drive's signatures; the mean of a jittering delay is no dead time of its own."""
    size = next((one.value for one in found if one.effect.name == "jitter"), 0.0)
    own = [one for one in effects if one.name != "dead_time" or one.parameters["time"].value > OF_JITTER * size]
    return [*own, *(one.effect for one in found)]


def deviations(e: Evidence, now: Fitted, g: Grams) -> dict[str, float]:
    """Standard deviations of all parameters, an effect's as ``effect.parameter``; `g` holds their columns."""
    return linear_fit.standard_deviations(g, [*refine.nuisances(e), *(one.name for one in refine.parameters(now))])


def _effect(
    session: Session,
    now: Fitted,
    one: EffectValues,
    what: tuple[Selection, bool],
    deviation: Mapping[str, float],
) -> FoundEffect:
    name, (selected, apart) = one.effect.name, what
    rivals = {other: share for other, share in selected.alternatives[name].items() if share > 0.0}
    certain = library.look_alikes(name, Data.ALL)
    close = tuple(
        other
        for other, share in sorted(rivals.items(), key=lambda x: -x[1])
        if share >= AS_GOOD and other not in library.generalisations(name)
    )
    rest = [other for other in now.effects if other is not one]
    return FoundEffect(
        name=name,
        alternatives=tuple(dict.fromkeys([*certain, *close, *library.look_alikes(name, Data.ONE_SPEED)])),
        probability=min(selected.inclusion[name] / STABLE, 1.0)
        * _clear(selected, one, deviation, apart)
        * probability(selected.clarity[name].doubt, rivals, name),
        share=0.0,
        parameters=parameters(one, deviation, session.kind),
        block=one.effect.block,
        fields=changed(equipped(now.model, rest).stage, now.equipped.stage),
        coordinate=one.effect.coordinate,
    )


def _clear(selected: Selection, one: EffectValues, deviation: Mapping[str, float], apart: bool) -> float:
    """Below 1 where so much of the mechanics stays unexplained that an effect may be a part of it.

    Of the drive's effects it is a delay: what bends the time shift of the base looks like one.
    """
    name = one.effect.name
    delays = {"dead_time": "time", "current_loop": "lag"}
    if one.effect.block == "drive" and name not in delays:
        return 1.0
    width = deviation[f"{name}.{delays[name]}"] if name in delays else 0.0
    if width > 0.0:
        return min(abs(one.values[delays[name]]) / (SURE[name] * width), 1.0)
    share = selected.gains[name] / max(selected.unexplained, 1e-300)
    if name in delays:
        return min(share / LEAKS, 1.0)
    return min(max(share, selected.clarity[name].share if apart else 0.0) / FAINT, 1.0)


def probability(doubt: float, rivals: Mapping[str, float], name: str) -> float:
    """That this effect is there, and that it is this one and none of its rivals (gains relative to its own).

    The search takes the best, so that it keeps at least an even chance against them all.
    """
    there: float = 1.0 - 0.5 * min(doubt, 1.0) ** STEEPNESS
    wider = library.generalisations(name)  # what holds this effect as a special case is no rival to it
    this = 1.0 / (1.0 + sum(min(share, 1.0) ** SHARPNESS for other, share in rivals.items() if other not in wider))
    return float(there * max(this, EVEN))


def changed(before: Stage, after: Stage) -> Fields:
    """Fields of the stage file that an effect changes; a friction that no law has is taken as stop operators."""
    try:
        return patch_fields.fields_of(before, after)
    except GapError:
        law = friction_family.as_operators(after.friction)
        return patch_fields.fields_of(before, after._replace(friction=law))


def parameters(one: EffectValues, deviation: Mapping[str, float], kind: str) -> dict[str, Value]:
    """Values with intervals, a sine and a cosine as amplitude and phase."""
    values = dict(one.values)
    spread = {name: 1.96 * deviation.get(f"{one.effect.name}.{name}", 0.0) for name in values}
    units = _units(one.effect, kind)
    if "sine" in values and "cosine" in values:
        return _harmonic(values, spread, units)
    return {name: Value(x, x - spread[name], x + spread[name], units[name]) for name, x in values.items()}


def _harmonic(values: dict[str, float], spread: Mapping[str, float], units: Mapping[str, str]) -> dict[str, Value]:
    sine, cosine = values.pop("sine"), values.pop("cosine")
    size, width = math.hypot(sine, cosine), math.hypot(spread["sine"], spread["cosine"])
    phase, turn = math.atan2(cosine, sine), min(width / max(size, 1e-300), math.pi)
    rest = {name: Value(x, x - spread[name], x + spread[name], units[name]) for name, x in values.items()}
    return {
        "amplitude": Value(size, max(size - width, 0.0), size + width, units["sine"]),
        "phase": Value(phase, phase - turn, phase + turn, "rad"),
        **rest,
    }


def _units(effect: Definition, kind: str) -> dict[str, str]:
    declared: list[Amplitude | Shape] = [*effect.amplitudes, *effect.shapes]
    parts = {one.name: [unit.strip() for unit in one.unit.split("|")] for one in declared}
    return {name: both[-1] if kind == "linear" else both[0] for name, both in parts.items()}


def shifted(session: Session, found: Sequence[Shift], now: Fitted) -> list[FoundEffect]:
    """The parameters that are off, by name; a common scale of all of them is that of the force constant."""
    scale = common(found)
    if scale is not None:
        rest = [one for one in found if one.sure and one.name not in FORCE_SCALED]
        return [_force_constant(session, scale), *(_shifted(session, one, now) for one in rest)]
    sure = sorted((one for one in found if one.sure), key=lambda one: -one.share)
    effects = [_shifted(session, one, now) for one in sure]
    # The part that they share may as well be the force constant's.
    alike = shared(found) | ({sure[0].name} if _alike(sure) else frozenset())
    return [
        one._replace(alternatives=(*one.alternatives, "force_constant")) if one.name in alike else one
        for one in effects
    ]


def _alike(sure: Sequence[Shift]) -> bool:
    """Whether inertia, viscous and Coulomb friction have all gone the same way."""
    changes = [one.change for one in sure if one.name in FORCE_SCALED]
    return len(changes) == 3 and len({change > 0.0 for change in changes}) == 1


def _force_constant(session: Session, shift: Shift) -> FoundEffect:
    value = session.stage.motor.force_constant * (1.0 + shift.change)
    return FoundEffect(
        "force_constant",
        (*library.look_alikes("force_constant", Data.ALL), *FORCE_SCALED),
        0.9,
        shift.share,
        {"change": shift.value},
        fields=(("motor.force_constant", value),),
        parameter=True,
    )


def _shifted(session: Session, one: Shift, now: Fitted) -> FoundEffect:
    sizes = {"inertia": "acceleration", "viscous": "speed", "coulomb": "direction"}
    certainty = 1.0 / (1.0 + (4.0 * max(one.deviation, 1e-6) / abs(one.change)) ** 2)
    width = 1.96 * one.deviation
    values = {one.name: one.value, "change": Value(one.change, one.change - width, one.change + width, "")}
    return FoundEffect(
        one.name,
        _rivals_of_shift(session, one.name),
        certainty,
        one.share,
        values,
        block="sensor" if one.name == "time_shift" else "mechanics",
        fields=_parameter_fields(session, one, now),
        parameter=True,
        coordinate=sizes.get(one.name, "none"),
    )


def _rivals_of_shift(session: Session, name: str) -> tuple[str, ...]:
    """What the same shift may be as well."""
    unmeasured = any(log.current is None or log.command is None for log in session.logs)
    data = Data.ONE_SPEED | Data.WITHOUT_CURRENT if unmeasured else Data.ONE_SPEED
    return tuple(sorted(library.look_alikes(name, data)))


def _parameter_fields(session: Session, one: Shift, now: Fitted) -> Fields:
    if one.name in ("inertia", "viscous", "bias"):
        return ((f"mechanics.{one.name}", one.value.value),)
    if one.name in ("coulomb", "presliding"):
        law = now.model.stage.friction
        return changed(session.stage, session.stage._replace(friction=law))
    return ()


def rivals(e: Evidence, selected: Selection, one: FoundEffect) -> dict[str, Stage]:
    """Models in which another effect stands in the place of `one`, each refined to explain the same data."""
    now = selected.fitted
    rest = [other for other in now.effects if other.effect.name != one.name]
    found = {}
    for name in one.alternatives:
        if name in selected.rivals.get(one.name, {}):
            other = refine.refine(e, now.model, [*rest, selected.rivals[one.name][name]], 2)
            found[name] = other.equipped.stage
    return found
