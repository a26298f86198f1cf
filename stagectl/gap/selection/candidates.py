"""The library on one machine: every effect as groups of columns, one group for each place on the grid of its shapes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from stagectl.gap.effects import library
from stagectl.gap.effects.effect import Definition, TimeVariation
from stagectl.gap.effects.stage_changes import coulomb, scaled
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.sensitivities import Direction, TrackedModel
from stagectl.gap.selection.thresholds import SCALED_CHANGE
from stagectl.kernels.stage import Stage


class Form(NamedTuple):
    """An effect at one place on the grid of its shapes: its amplitudes are columns."""

    effect: Definition
    shape: Mapping[str, float]
    typical: tuple[float, ...]  # size of each amplitude at which its column was taken
    names: tuple[str, ...]  # of the columns, one for each amplitude

    def values(self, amplitudes: Sequence[float]) -> dict[str, float]:
        """All parameters of the effect, for these amplitudes within their bounds."""
        bounds = zip(self.effect.amplitudes, amplitudes, strict=True)
        return {**self.shape, **{bound.name: min(max(float(x), bound.low), bound.high) for bound, x in bounds}}


class EffectValues(NamedTuple):
    """An effect with values for all its parameters."""

    effect: Definition
    values: Mapping[str, float]


def forms(effects: Sequence[Definition]) -> list[Form]:
    """Every effect at every place on its grid."""
    return [form for effect in effects for form in _forms(effect)]


def _forms(effect: Definition) -> list[Form]:
    grids = [shape.grid for shape in effect.shapes]
    sizes = list(zip(*(amplitude.typical for amplitude in effect.amplitudes), strict=True))
    return [_form(effect, place, size) for place in itertools.product(*grids) for size in sizes]


def _form(effect: Definition, place: tuple[float, ...], size: tuple[float, ...]) -> Form:
    shape = {axis.name: value for axis, value in zip(effect.shapes, place, strict=True)}
    values = ",".join(f"{value:.6g}" for value in (*place, *size))
    names = tuple(f"{effect.name}({values}).{amplitude.name}" for amplitude in effect.amplitudes)
    return Form(effect, shape, size, names)


def directions(form: Form) -> list[Direction]:
    """The columns of `form`: one amplitude at a time, at its typical size."""
    variation = form.effect.time_variation
    named = zip(form.effect.amplitudes, form.typical, form.names, strict=True)
    if variation is not None:
        return [
            on_the_clock(name, variation, amplitude.name, lambda clock: variation.factor(form.shape, clock))
            for amplitude, _, name in named
        ]
    absent = EffectValues(form.effect, form.values([0.0] * len(form.typical)))
    return [direction(absent, amplitude.name, size, name) for amplitude, size, name in named]


def on_the_clock(name: str, variation: TimeVariation, amplitude: str, factor: Callable[[Array], Array]) -> Direction:
    """The column of what runs on the session clock: that of the parameter it scales, times a factor of time."""
    return Direction(name, _SCALED[variation.of[amplitude]], SCALED_CHANGE, factor=factor)


def _scaled(change: Callable[[Stage, Mapping[str, float]], Stage]) -> Callable[[TrackedModel], TrackedModel]:
    return lambda m: m._replace(stage=change(m.stage, {"size": SCALED_CHANGE}))


# One function for each, so that all directions that scale the same parameter share one simulation.
_SCALED = {"coulomb": _scaled(coulomb), "viscous": _scaled(scaled("mechanics.viscous"))}


def direction(current: EffectValues, parameter: str, step: float, name: str) -> Direction:
    """The model with one parameter of an effect moved by `step` from its current value."""
    changed = EffectValues(current.effect, {**current.values, parameter: current.values[parameter] + step})
    return Direction(name, lambda m: equipped(m, [changed]), step)


def equipped(p: TrackedModel, effects: Sequence[EffectValues]) -> TrackedModel:
    """The model with these effects in its stage."""
    stage = p.stage
    for valued in effects:
        stage = valued.effect.apply(stage, valued.values)
    return p._replace(stage=stage)


def without(effects: Sequence[Definition], excluded: Sequence[str]) -> list[Definition]:
    """The library without the effects `excluded`, and without wider effects that hold them as a special case."""
    gone = {*excluded, *(wider for name in excluded for wider in library.generalisations(name))}
    return [effect for effect in effects if effect.name not in gone]
