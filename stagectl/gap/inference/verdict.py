"""From fits to names: effects with their probabilities, their alternatives, their values and intervals."""

from collections.abc import Mapping, Sequence

from stagectl.gap.effects import library
from stagectl.gap.effects.effect import Data, units_of
from stagectl.gap.inference import amplitudes, cable_centre, thresholds
from stagectl.gap.inference.patch_fields import fields_of
from stagectl.gap.inference.value_errors import Errors
from stagectl.gap.logs.session import Session
from stagectl.gap.residuals.gram_matrices import NORMAL
from stagectl.gap.result.diagnosis import NAMED, Fields, FoundEffect, Value
from stagectl.gap.selection import refine
from stagectl.gap.selection.candidates import (
    CURVE,
    LAG,
    EffectValues,
    equipped,
    in_place,
    joined,
    of_the_motor,
    of_the_structure,
)
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.material import refitted_without
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels.fields import get
from stagectl.kernels.stage import Stage
from stagectl.units import unit_on

_REACHED = 1e-9  # depth of a limit that is just reached: of none the effect is neutral
DELAYS = {"dead_time": "time", "current_loop": "lag"}  # effects that are one, and its name among their values


def named_effects(session: Session, e: Evidence, selected: Selection, known: Sequence[Errors]) -> list[FoundEffect]:
    """The effects that were selected, those with the largest gains first.

    `known` holds the errors of all parameters, by each way to divide the data.
    """
    effects = [_effect(session, e, selected, fitted, known) for fitted in selected.fitted.effects]
    ranked = sorted(effects, key=lambda effect: -selected.gains[effect.name])
    return [part for effect in ranked for part in _split(effect)]


def _split(effect: FoundEffect) -> list[FoundEffect]:
    """An effect that works on another one, and that other one: see `candidates.parts`."""
    if effect.name != LAG:
        return [effect]
    curve = {name: value for name, value in effect.parameters.items() if name != "lag"}
    others = tuple(name for name in effect.alternatives if name != CURVE)
    return [effect._replace(name=CURVE, parameters=curve, coordinate="speed", alternatives=others), effect]


def only_named(e: Evidence, selected: Selection) -> Selection:
    """`selected` without what is not named: a cause in doubt must not hide that something is there."""
    doubted = {name for name, probability in selected.probability.items() if probability < NAMED}
    return selected._replace(fitted=refitted_without(e, selected.fitted, doubted))


def taken_out(e: Evidence, selected: Selection, name: str) -> Selection:
    """`selected` without the effect `name`, fitted anew."""
    return selected._replace(fitted=refitted_without(e, selected.fitted, {name}))


def without_jitter(effect: FoundEffect, most: float) -> FoundEffect:
    """`effect` without the alternative of a jitter, where its mean delay is longer than that of `most` (s, rms)."""
    if effect.name not in DELAYS or not _longer(effect, most):
        return effect
    return effect._replace(alternatives=tuple(name for name in effect.alternatives if name != "jitter"))


def with_signatures(effects: Sequence[FoundEffect], signatures: Sequence[FoundEffect]) -> list[FoundEffect]:
    """Effects and the drive's signatures; the mean of a jittering delay is no delay of its own."""
    jitter = _jitter(signatures)
    kept = [effect for effect in effects if effect.name not in DELAYS or _longer(effect, jitter)]
    return [*kept, *signatures]


def beyond_jitter(shifts: Sequence[FoundEffect], signatures: Sequence[FoundEffect]) -> list[FoundEffect]:
    """The `shifts` of parameters, without a time shift that a jitter makes: what is late by chance is so on average."""
    most = thresholds.SHIFT_PER_JITTER * _jitter(signatures)
    return [shift for shift in shifts if shift.name != "time_shift" or abs(shift.parameters[shift.name].value) > most]


def _jitter(signatures: Sequence[FoundEffect]) -> float:
    """Of the drive (s, rms); 0 where it has none."""
    return next((found.parameters["rms"].value for found in signatures if found.name == "jitter"), 0.0)


def _longer(delay: FoundEffect, jitter: float) -> bool:
    """Whether a `delay` is longer than the mean of a `jitter` (s, rms)."""
    return delay.parameters[DELAYS[delay.name]].value > thresholds.DELAY_PER_JITTER * jitter


def _effect(
    session: Session, e: Evidence, selected: Selection, fitted: EffectValues, known: Sequence[Errors]
) -> FoundEffect:
    name, now = fitted.effect.name, selected.fitted
    rest = [other for other in now.effects if other is not fitted]
    before = equipped(now.model, rest).stage
    values = with_limit(parameters(fitted, now, known, session.kind), fitted, before)
    return FoundEffect(
        name=name,
        alternatives=(*_alternatives(name, selected), *of_the_motor(fitted, rest), *of_the_structure(fitted, rest)),
        probability=selected.probability[name],
        share=0.0,
        parameters=_in_order(values, session),
        block=fitted.effect.block,
        fields=fields_of(before, now.equipped.stage),
        coordinate=fitted.effect.coordinate,
        choices=tuple((other, _fields(fit)) for other, fit in _rivals(e, selected, name).items()),
    )


def _fields(fit: Fitted) -> Fields:
    """What the last effect of a fit changes."""
    return fields_of(equipped(fit.model, fit.effects[:-1]).stage, fit.equipped.stage)


def _alternatives(name: str, selected: Selection) -> tuple[str, ...]:
    """What no data can distinguish first, then what the evidence finds comparable, the likeliest first."""
    exact = library.look_alikes(name, Data.ALL)
    present = {fitted.effect.name for fitted in selected.fitted.effects}
    comparable = [other for other in selected.alternatives[name] if other in selected.rivals[name]]
    alike = [*comparable, *library.look_alikes(name, Data.ONE_SPEED)]
    barred = {*library.EFFECTS[name].generalisations, *present}
    return tuple(dict.fromkeys([*exact, *(other for other in alike if other not in barred)]))


def parameters(fitted: EffectValues, now: Fitted, known: Sequence[Errors], kind: str) -> dict[str, Value]:
    """Values with 95 % intervals, where they can lie; a sine and a cosine become amplitude and phase.

    The largest of the `known` errors of each value counts.
    """
    largest = {name: max(each.deviations()[name] for each in known) for name in known[0].names}
    values = _values(fitted, cable_centre.with_centre(now, largest), kind)
    errors = {
        group: [each.of([f"{fitted.effect.name}.{name}" for name in group]) for each in known]
        for group in amplitudes.groups(values)
    }
    return amplitudes.with_amplitudes(values, errors)


def _values(fitted: EffectValues, deviation: Mapping[str, float], kind: str) -> dict[str, Value]:
    """Each value by itself, with its standard `deviation`."""
    units = units_of(fitted.effect, kind)
    ends = {amplitude.name: (amplitude.low, amplitude.high) for amplitude in fitted.effect.amplitudes}
    ends |= {shape.name: (shape.low, shape.high) for shape in fitted.effect.shapes}
    values = {}
    for name, x in fitted.values.items():
        half = NORMAL * deviation.get(f"{fitted.effect.name}.{name}", 0.0)
        low, high = ends[name]
        values[name] = Value(x, min(max(x - half, low), x), max(min(x + half, high), x), units[name])
    return values


def with_limit(values: dict[str, Value], fitted: EffectValues, before: Stage) -> dict[str, Value]:
    """The values; of a limit of the drive itself, not how far it is below the most that the logs ask for.

    One that is reached is not above that.
    """
    depth = values.get("depth")
    if depth is None or depth.value <= 0.0:
        return values
    place = next(place for place, _ in fields_of(before, fitted.effect.apply(before, fitted.values)))

    def at(share: float) -> float:
        return float(get(fitted.effect.apply(before, {**fitted.values, "depth": max(share, _REACHED)}), place))

    unit = "V" if place.endswith("voltage_limit") else "A"
    return {place.rpartition(".")[2]: Value(at(depth.value), at(depth.high), at(depth.low), unit)}


def _in_order(values: dict[str, Value], session: Session) -> dict[str, Value]:
    """The values, what tells most first: the gap of a backlash, the size of an offset, the period of a map.

    An order needs the pitch: one that was fitted is also given as a period.
    """
    for first in ("gap", "current"):
        if first in values:
            return {first: values[first], **values}
    order, pitch, of_map = values.get("order"), session.stage.mechanics.pitch, next(iter(values), "") == "order"
    if order is None or not (of_map or order.low < order.high):
        return values
    unit = unit_on(session.kind, "rad | m")
    period = {"period": Value(pitch / order.value, pitch / order.high, pitch / order.low, unit)}
    return {**period, **values} if of_map else {**values, **period}


def rivals(e: Evidence, selected: Selection, effect: FoundEffect) -> dict[str, Stage]:
    """Models with an alternative in the place of `effect`, each refined to explain the same data."""
    return {name: fit.equipped.stage for name, fit in _rivals(e, selected, effect.name).items()}


def _rivals(e: Evidence, selected: Selection, name: str) -> dict[str, Fitted]:
    """The same as fits; the alternative is their last effect."""
    now = selected.fitted
    rest = [other for other in now.effects if other.effect.name != name]
    present = in_place(rest)
    tried = {other: valued for other, valued in selected.rivals.get(name, {}).items() if other not in present}
    return {other: refine.refine(e, now.model, joined(rest, [valued]), 2) for other, valued in tried.items()}
