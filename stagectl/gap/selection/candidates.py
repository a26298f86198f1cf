"""The library on one machine: every effect as groups of columns, one group for each place on its shapes' grid."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from stagectl.gap.effects import library
from stagectl.gap.effects.effect import Definition, TimeVariation
from stagectl.gap.effects.stage_changes import coulomb, scaled
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.sensitivities import Direction, Model
from stagectl.kernels.stage import Stage


class Form(NamedTuple):
    """An effect at one place on the grid of its shapes: its amplitudes are columns."""

    effect: Definition
    shape: Mapping[str, float]
    typical: tuple[float, ...]  # size of each amplitude that its column was taken at
    names: tuple[str, ...]  # of the columns, one an amplitude

    def values(self, amplitudes: Sequence[float]) -> dict[str, float]:
        """All parameters of the effect, for these amplitudes within their bounds."""
        pairs = zip(self.effect.amplitudes, amplitudes, strict=True)
        return {**self.shape, **{one.name: min(max(float(x), one.low), one.high) for one, x in pairs}}


class Named(NamedTuple):
    """An effect with values for all its parameters."""

    effect: Definition
    values: Mapping[str, float]


def forms(effects: Sequence[Definition]) -> list[Form]:
    """Every effect at every place of its grid."""
    return [form for effect in effects for form in _forms(effect)]


def _forms(effect: Definition) -> list[Form]:
    grids = [shape.grid for shape in effect.shapes]
    sizes = list(zip(*(one.typical for one in effect.amplitudes), strict=True))
    found = []
    for place in itertools.product(*grids):
        shape = {one.name: value for one, value in zip(effect.shapes, place, strict=True)}
        for size in sizes:
            at = ",".join(f"{value:.6g}" for value in (*place, *size))
            names = tuple(f"{effect.name}({at}).{one.name}" for one in effect.amplitudes)
            found.append(Form(effect, shape, size, names))
    return found


def directions(form: Form) -> list[Direction]:
    """The columns of `form`: one amplitude at a time, at its typical size."""
    if form.effect.time_variation is not None:
        return _time_varying(form, form.effect.time_variation)
    return [
        direction(Named(form.effect, form.values([0.0] * len(form.typical))), one.name, size, name)
        for one, size, name in zip(form.effect.amplitudes, form.typical, form.names, strict=True)
    ]


def _time_varying(form: Form, time_variation: TimeVariation) -> list[Direction]:
    """Columns of what runs on the session clock: those of the parameter that it scales, times a factor of time."""

    def factor(clock: Array) -> Array:
        found: Array = time_variation.factor(form.shape, clock)
        return found

    return [
        Direction(name, SCALED[time_variation.of[one.name]], STEP, factor=factor)
        for one, name in zip(form.effect.amplitudes, form.names, strict=True)
    ]


def _scaled(change: Callable[[Stage, Mapping[str, float]], Stage]) -> Callable[[Model], Model]:
    return lambda m: m._replace(stage=change(m.stage, {"size": STEP}))


STEP = 0.1  # of a scaled parameter
SCALED = {"coulomb": _scaled(coulomb), "viscous": _scaled(scaled("mechanics.viscous"))}


def direction(at: Named, parameter: str, step: float, name: str) -> Direction:
    """The model with one parameter of an effect moved by `step` from where it is."""
    changed = Named(at.effect, {**at.values, parameter: at.values[parameter] + step})
    return Direction(name, lambda m: equipped(m, [changed]), step)


def equipped(p: Model, effects: Sequence[Named]) -> Model:
    """The model with these effects in its stage."""
    stage = p.stage
    for one in effects:
        stage = one.effect.apply(stage, one.values)
    return p._replace(stage=stage)


def without(effects: Sequence[Definition], excluded: Sequence[str]) -> list[Definition]:
    """The library less the effects that must not be candidates, nor under the name of a wider one that holds them."""
    gone = {*excluded, *(wider for name in excluded for wider in library.generalisations(name))}
    return [one for one in effects if one.name not in gone]
