"""The library on one machine: every effect as groups of columns, one group for each place on the grid of its shapes."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects import library
from stagectl.gap.effects.effect import Definition, Scales, TimeVariation
from stagectl.gap.effects.stage_changes import coulomb, scaled
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import Direction, TrackedModel
from stagectl.gap.selection.baseline_fit import viscous_unit
from stagectl.gap.selection.thresholds import LARGEST_SPEED, SCALED_CHANGE
from stagectl.kernels.stage import Stage
from stagectl.units import ROTARY

CURVE, LAG = "stribeck", "friction_lag"  # what lags is the curve
BALL_PASS, MOTOR_WAVES = "ball_pass_ripple", ("current_ripple", "cogging", "cogging_map")


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


def bends(effect: Definition) -> bool:
    """Whether a column of the effect holds only near the values at which it was taken."""
    return effect.resonant or effect.nonlinear


def in_place(present: Sequence[EffectValues]) -> frozenset[str]:
    """Names of the effects `present`, and of those that they extend: these have no place of their own any more."""
    names = {valued.effect.name for valued in present}
    return frozenset(names | {library.EFFECTS[name].extends for name in names})


def joined(present: Sequence[EffectValues], added: Sequence[EffectValues]) -> list[EffectValues]:
    """The effects with more of them; a wider form of a present effect takes its place.

    It takes its values, too, unless it bends: then its own were found by a search over all of them.
    """
    kept, fresh = list(present), []
    for valued in added:
        narrow = next((old for old in kept if old.effect.name == library.EFFECTS[valued.effect.name].extends), None)
        known = {} if narrow is None or bends(valued.effect) else narrow.values
        kept = [old for old in kept if old is not narrow]
        taken = {name: x for name, x in known.items() if name in valued.values}
        fresh.append(EffectValues(valued.effect, {**valued.values, **taken}))
    return [*kept, *fresh]


def parts(valued: EffectValues) -> dict[str, EffectValues]:
    """The effects that `valued` is said to be, each with those before it: what lags is a curve, and its lag."""
    name = valued.effect.name
    if name != LAG:
        return {name: valued}
    return {CURVE: EffectValues(valued.effect, {**valued.values, "lag": 0.0}), LAG: valued}


def of_the_motor(valued: EffectValues, present: Sequence[EffectValues]) -> tuple[str, ...]:
    """The motor's waves among `present` of which a ball pass `valued` at a whole order may be a harmonic.

    All harmonics of a motor are multiples of its pole pairs, and it has more of them than the model holds: their orders
    share a divisor.
    """
    order = valued.values.get("order", 0.0)
    if valued.effect.name != BALL_PASS or not order.is_integer():
        return ()
    waves = {other.effect.name: other.values["order"] for other in present if other.effect.name in MOTOR_WAVES}
    return tuple(name for name, x in waves.items() if x.is_integer() and math.gcd(int(x), int(order)) > 1)


def of_the_structure(valued: EffectValues, present: Sequence[EffectValues]) -> tuple[str, ...]:
    """The resonances among `present` of which a resonance `valued` may be a further mode: a structure has many."""
    if not valued.effect.resonant:
        return ()
    return tuple(other.effect.name for other in present if other.effect.resonant)


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


def beside(p: Direction, model: TrackedModel, effects: Sequence[EffectValues]) -> Direction:
    """The direction `p` from `model` on, with `effects` in the place that they have."""
    return p._replace(change=lambda _: equipped(p.change(model), effects))


def without(effects: Sequence[Definition], excluded: Sequence[str]) -> list[Definition]:
    """The library without the effects `excluded`, and without wider effects that hold them as a special case."""
    gone = {*excluded, *(wider for name in excluded for wider in library.EFFECTS[name].generalisations)}
    return [effect for effect in effects if effect.name not in gone]


def scales(session: Session, runs: Sequence[Run], orders: Mapping[str, tuple[float, ...]]) -> Scales:
    """The machine's scales, from the nominal model and the logs; `orders` of the pitch are by effect."""
    p = session.stage
    position = np.concatenate([run.mean.rows[:, 1] for run in runs])
    current = np.concatenate([_delivered_current(run) for run in runs])
    velocity = np.concatenate([np.gradient(run.mean.rows[:, 1], session.dt) for run in runs])
    low, high = float(position.min()), float(position.max())
    drive = p.drive
    voltage = np.abs(drive.resistance * current + drive.back_emf * velocity)
    return Scales(
        coulomb=friction_family.size(p),
        viscous=viscous_unit(p, session.dt),
        force_constant=p.motor.force_constant,
        length=friction_family.length(p.friction),
        speed=float(np.percentile(np.abs(velocity), LARGEST_SPEED)),
        centre=0.5 * (low + high),
        stroke=0.5 * (high - low),
        current=float(np.abs(current).max()),
        pitch=p.mechanics.pitch,
        dt=session.dt,
        session=tuple(sorted({log.start for run in runs for log in run.logs})),
        orders=orders,
        periods=p.encoder.interpolation.order if p.encoder.interpolation.order > 1.0 else 0.0,
        voltage=float(voltage.max()) if drive.back_emf > 0.0 else 0.0,
        delay=drive.delay_samples * session.dt + drive.dead_time,
        lag=drive.current_lag,
        commanded=any(log.commanded for run in runs for log in run.logs),
        measured=any(log.current is not None for run in runs for log in run.logs),
        rotates=session.kind == ROTARY and session.travel_unit == "rad",
    )


def _delivered_current(run: Run) -> Array:
    """The current (n,) A of the drive where it is measured, else the command: a command beyond a limit is no scale."""
    command, measured = run.mean.rows[:, 0], run.mean.rows[:, 2]
    return np.where(np.isnan(measured), command, measured)
