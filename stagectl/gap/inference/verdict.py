"""From fits to names: effects with their probabilities, their alternatives, their values and intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from stagectl.gap.effects import library
from stagectl.gap.effects.effect import Amplitude, Data, Definition, Shape
from stagectl.gap.inference import patch_fields, thresholds
from stagectl.gap.inference.signatures import DriveSignature
from stagectl.gap.logs.session import GapError, Session
from stagectl.gap.residuals import friction_family, gram_matrices
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.result.diagnosis import NAMED, Fields, FoundEffect, Value
from stagectl.gap.selection import refine
from stagectl.gap.selection.candidates import EffectValues, equipped
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.swap_tests import Selection
from stagectl.kernels.stage import Stage

DELAYS = {"dead_time": "time", "current_loop": "lag"}  # effects of the drive that delay, and their parameter


def named_effects(
    session: Session, selected: Selection, deviation: Mapping[str, float], by_experiment: bool
) -> list[FoundEffect]:
    """The effects of the search, those with the largest gains first.

    `deviation` holds the standard deviations of all parameters.  With `by_experiment` what one experiment shows clearly
    counts, whatever is unexplained in the others.  It does where only the form of friction is left; where there is an
    unknown, an effect may be a part of it.
    """
    now = selected.fitted
    effects = [_effect(session, selected, fitted, deviation, by_experiment) for fitted in now.effects]
    ranked = sorted(effects, key=lambda effect: -selected.gains[effect.name])
    return [part for effect in ranked for part in _split(effect)]


def _split(effect: FoundEffect) -> list[FoundEffect]:
    """An effect that works on another one, and that other one: what lags is a Stribeck friction."""
    if effect.name != "friction_lag":
        return [effect]
    curve = {name: value for name, value in effect.parameters.items() if name != "lag"}
    others = tuple(name for name in effect.alternatives if name != "stribeck")
    return [effect._replace(name="stribeck", parameters=curve, coordinate="speed", alternatives=others), effect]


def only_named(e: Evidence, selected: Selection, effects: Sequence[FoundEffect]) -> Selection:
    """`selected` without what is not named: a cause in doubt must not hide that something is there."""
    named = {effect.name for effect in effects if effect.probability >= NAMED}
    kept = [fitted for fitted in selected.fitted.effects if fitted.effect.name in named]
    if len(kept) == len(selected.fitted.effects):
        return selected
    return selected._replace(fitted=refine.refine(e, selected.fitted.model, kept))


def with_signatures(effects: Sequence[FoundEffect], signatures: Sequence[DriveSignature]) -> list[FoundEffect]:
    """Effects and the drive's signatures; the mean of a jittering delay is no dead time of its own."""
    jitter = next((signature.value for signature in signatures if signature.effect.name == "jitter"), 0.0)
    kept = [
        effect
        for effect in effects
        if effect.name != "dead_time" or effect.parameters["time"].value > thresholds.DEAD_TIME_PER_JITTER * jitter
    ]
    return [*kept, *(signature.effect for signature in signatures)]


def deviations(e: Evidence, now: Fitted, g: Grams) -> dict[str, float]:
    """Standard deviations of all parameters, an effect's as ``effect.parameter``; `g` holds their columns."""
    return gram_matrices.standard_deviations(
        g, [*refine.nuisances(e), *(direction.name for direction in refine.parameters(now))]
    )


def _effect(
    session: Session, selected: Selection, fitted: EffectValues, deviation: Mapping[str, float], by_experiment: bool
) -> FoundEffect:
    name, now = fitted.effect.name, selected.fitted
    rivals = {other: share for other, share in selected.alternatives[name].items() if share > 0.0}
    rest = [other for other in now.effects if other is not fitted]
    return FoundEffect(
        name=name,
        alternatives=_alternatives(name, rivals),
        probability=min(selected.inclusion[name] / thresholds.STABLE_INCLUSION, 1.0)
        * clarity(selected, fitted, deviation, by_experiment)
        * probability(selected.clarity[name].doubt, rivals, name),
        share=0.0,
        parameters=parameters(fitted, deviation, session.kind),
        block=fitted.effect.block,
        fields=changed(equipped(now.model, rest).stage, now.equipped.stage),
        coordinate=fitted.effect.coordinate,
    )


def _alternatives(name: str, rivals: Mapping[str, float]) -> tuple[str, ...]:
    """What no data can distinguish first, then what explains these data nearly as well."""
    exact = library.look_alikes(name, Data.ALL)
    close = [
        other
        for other, share in sorted(rivals.items(), key=lambda pair: -pair[1])
        if share >= thresholds.ALTERNATIVE_GAIN and other not in library.generalisations(name)
    ]
    return tuple(dict.fromkeys([*exact, *close, *library.look_alikes(name, Data.ONE_SPEED)]))


def clarity(selected: Selection, fitted: EffectValues, deviation: Mapping[str, float], by_experiment: bool) -> float:
    """Factor below 1 where so much of the mechanics stays unexplained that the effect may be a part of it.

    Of the drive's effects that concerns the delays alone: a nonlinearity of the base's time shift imitates one.
    """
    name = fitted.effect.name
    if fitted.effect.block == "drive" and name not in DELAYS:
        return 1.0
    width = deviation[f"{name}.{DELAYS[name]}"] if name in DELAYS else 0.0
    if width > 0.0:
        return min(abs(fitted.values[DELAYS[name]]) / (thresholds.DELAY_SIGMA[name] * width), 1.0)
    share = selected.gains[name] / max(selected.unexplained, 1e-300)
    if name in DELAYS:
        return min(share / thresholds.FAINT_SHARE_OF_DELAY, 1.0)
    return min(max(share, selected.clarity[name].share if by_experiment else 0.0) / thresholds.FAINT_SHARE, 1.0)


def probability(doubt: float, rivals: Mapping[str, float], name: str) -> float:
    """That this effect is there, and that it is this one and none of its alternatives (gains relative to its own).

    The search takes the best, so that it keeps at least an even chance against them all.
    """
    there: float = 1.0 - 0.5 * min(doubt, 1.0) ** thresholds.DOUBT_STEEPNESS
    wider = library.generalisations(name)  # what holds this effect as a special case is no rival to it
    weights = (min(share, 1.0) ** thresholds.RIVAL_SHARPNESS for other, share in rivals.items() if other not in wider)
    return float(there * max(1.0 / (1.0 + sum(weights)), thresholds.LEAST_AGAINST_RIVALS))


def changed(before: Stage, after: Stage) -> Fields:
    """Fields of the stage file that an effect changes; a friction that no law has is taken as stop operators."""
    try:
        return patch_fields.fields_of(before, after)
    except GapError:
        law = friction_family.as_operators(after.friction)
        return patch_fields.fields_of(before, after._replace(friction=law))


def parameters(fitted: EffectValues, deviation: Mapping[str, float], kind: str) -> dict[str, Value]:
    """Values with 95 % intervals; a sine and a cosine become amplitude and phase."""
    units = _units(fitted.effect, kind)
    half = {name: 1.96 * deviation.get(f"{fitted.effect.name}.{name}", 0.0) for name in fitted.values}
    values = {name: Value(x, x - half[name], x + half[name], units[name]) for name, x in fitted.values.items()}
    return _harmonic(values, half) if "sine" in values and "cosine" in values else values


def _harmonic(values: dict[str, Value], half: Mapping[str, float]) -> dict[str, Value]:
    sine, cosine = values.pop("sine"), values.pop("cosine")
    size, width = math.hypot(sine.value, cosine.value), math.hypot(half["sine"], half["cosine"])
    phase, turn = math.atan2(cosine.value, sine.value), min(width / max(size, 1e-300), math.pi)
    amplitude = Value(size, max(size - width, 0.0), size + width, sine.unit)
    return {"amplitude": amplitude, "phase": Value(phase, phase - turn, phase + turn, "rad"), **values}


def _units(effect: Definition, kind: str) -> dict[str, str]:
    declared: list[Amplitude | Shape] = [*effect.amplitudes, *effect.shapes]
    parts = {parameter.name: [unit.strip() for unit in parameter.unit.split("|")] for parameter in declared}
    return {name: both[-1] if kind == "linear" else both[0] for name, both in parts.items()}


def rivals(e: Evidence, selected: Selection, effect: FoundEffect) -> dict[str, Stage]:
    """Models with an alternative in the place of `effect`, each refined to explain the same data."""
    now = selected.fitted
    rest = [other for other in now.effects if other.effect.name != effect.name]
    tried = selected.rivals.get(effect.name, {})
    names = [name for name in effect.alternatives if name in tried]
    return {name: refine.refine(e, now.model, [*rest, tried[name]], 2).equipped.stage for name in names}
