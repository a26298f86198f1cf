"""The parameters of effects as columns to be fitted, with how far each may move in a step."""

import math
from collections.abc import Iterator, Mapping, Sequence

from stagectl.gap.effects.effect import Shape, TimeVariation, Values
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.sensitivities import Direction, TrackedModel
from stagectl.gap.selection import thresholds
from stagectl.gap.selection.candidates import EffectValues, direction, equipped, on_the_clock


def directions(model: TrackedModel, effects: Sequence[EffectValues]) -> list[Direction]:
    """One direction for each parameter that may be refined, named ``effect.parameter``.

    Effects overwrite their fields, so a change is the same effect with another value on top of the whole model.
    """
    moving: list[Direction] = []
    for k, valued in enumerate(effects):
        if valued.effect.time_variation is not None:
            moving += _on_the_clock(valued, valued.effect.time_variation)
            continue
        narrow = _narrowness(valued)
        for amplitude in valued.effect.amplitudes:
            value = valued.values[amplitude.name]
            step = max(abs(value), thresholds.LEAST_AMPLITUDE * abs(amplitude.typical[0]))
            step *= narrow * thresholds.AMPLITUDE_CHANGE
            moving.append(_replaced(model, effects, (k, amplitude.name), _inwards(value, step, amplitude.high)))
        moving += [
            _replaced(model, effects, (k, shape.name), narrow * _change(shape, valued.values[shape.name]))
            for shape in _refined(valued)
        ]
    return moving


def _change(shape: Shape, value: float) -> float:
    """By how much a shape is changed for its column; a share towards its middle, from 0 as well."""
    if shape.share:
        return math.copysign(thresholds.SHARE_CHANGE, 0.5 - value)
    return _inwards(value, thresholds.SHAPE_CHANGE * min(value, shape.width), shape.high)


def _inwards(value: float, step: float, high: float) -> float:
    """The `step`, the other way where it would leave the range."""
    return step if value + step <= high else -step


def _narrowness(valued: EffectValues) -> float:
    """Factor on the changes by which columns are taken: a resonance must stay within its own width.

    Both its frequency and the mass that takes part in it move it along the frequencies.
    """
    return min(valued.values["damping"] / thresholds.BROAD_DAMPING, 1.0) if valued.effect.resonant else 1.0


def _refined(valued: EffectValues) -> list[Shape]:
    return [shape for shape in valued.effect.shapes if shape.refined]


def _on_the_clock(valued: EffectValues, variation: TimeVariation) -> Iterator[Direction]:
    """The same for what runs on the session clock: factors of time on the columns of what it scales."""
    name, values = valued.effect.name, dict(valued.values)
    for amplitude in valued.effect.amplitudes:
        yield on_the_clock(f"{name}.{amplitude.name}", variation, amplitude.name, lambda t: variation.factor(values, t))
    first = valued.effect.amplitudes[0].name
    for shape in _refined(valued):  # an amplitude times the change of its factor
        more = {**values, shape.name: (1.0 + thresholds.SHAPE_CHANGE) * values[shape.name]}
        scale = values[first] / (thresholds.SHAPE_CHANGE * values[shape.name])

        def factor(t: Array, more: Values = more, scale: float = scale) -> Array:
            changed: Array = scale * (variation.factor(more, t) - variation.factor(values, t))
            return changed

        yield on_the_clock(f"{name}.{shape.name}", variation, first, factor)


def _replaced(model: TrackedModel, effects: Sequence[EffectValues], place: tuple[int, str], step: float) -> Direction:
    """The parameter at `place`: number of its effect, and its name."""
    k, parameter = place
    valued = effects[k]
    changed = EffectValues(valued.effect, {**valued.values, parameter: valued.values[parameter] + step})
    others = [*effects[:k], changed, *effects[k + 1 :]]
    plain = direction(valued, parameter, step, f"{valued.effect.name}.{parameter}")
    return plain._replace(change=lambda m: equipped(m._replace(stage=model.stage), others))


def limits(effects: Sequence[EffectValues]) -> list[tuple[float, float]]:
    """How far each of the effects' parameters may move in one step, in the order of `directions`."""
    limits: list[tuple[float, float]] = []
    for valued in effects:
        for amplitude in valued.effect.amplitudes:
            value = valued.values[amplitude.name]
            limits.append((amplitude.low - value, amplitude.high - value))
        for shape in _refined(valued):
            value = valued.values[shape.name]
            low, high = shape.low, shape.high
            if not shape.share:
                low, high = max(value / thresholds.SHAPE_FACTOR, low), min(value * thresholds.SHAPE_FACTOR, high)
            limits.append((low - value, high - value))
    return limits


def informed(effects: Sequence[EffectValues]) -> dict[str, tuple[float, float]]:
    """How far each amplitude is from no effect, and how large it may be before any data."""
    return {
        f"{valued.effect.name}.{amplitude.name}": (
            valued.values[amplitude.name],
            thresholds.AMPLITUDE_WIDTH * max(map(abs, amplitude.typical)),
        )
        for valued in effects
        for amplitude in valued.effect.amplitudes
    }


def shifted(valued: EffectValues, move: Mapping[str, float]) -> EffectValues:
    """An effect with its parameters moved by their steps."""
    moves = {name: move.get(f"{valued.effect.name}.{name}", 0.0) for name in valued.values}
    values = {name: value + moves[name] for name, value in valued.values.items()}
    shares = [shape for shape in valued.effect.shapes if shape.share]
    bounded = {shape.name: min(max(values[shape.name], shape.low), shape.high) for shape in shares}
    return EffectValues(valued.effect, {**values, **bounded})
