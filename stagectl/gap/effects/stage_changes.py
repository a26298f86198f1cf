"""Changes of a stage model that effects are made of."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stagectl.gap.effects import grids
from stagectl.gap.effects.effect import Amplitude, Parameters, ParametersOf, Shape, TimeVariation, Values
from stagectl.kernels import stage
from stagectl.kernels.fields import get as get
from stagectl.kernels.fields import put as put
from stagectl.kernels.stage import Stage

Change = Callable[[Stage, Values], Stage]


def scaled(place: str) -> Change:
    """The field at `place`, multiplied by 1 + size."""
    return lambda p, v: put(p, place, get(p, place) * (1.0 + v["size"]))


def added(**places: str) -> Change:
    """Each parameter of the effect, added to a field."""

    def apply(p: Stage, v: Values) -> Stage:
        for name, place in places.items():
            p = put(p, place, get(p, place) + v[name])
        return p

    return apply


def sized(amplitude: Amplitude, place: str) -> ParametersOf:
    """An effect that adds its only `amplitude` to a field, on every machine."""
    return lambda _: Parameters((amplitude,), (), added(**{amplitude.name: place}))


def filled(place: str, **names: str) -> Change:
    """The block at `place`, with each named field set to the parameter of the effect that `names` gives."""
    return lambda p, v: put(p, place, get(p, place)._replace(**{field: v[name] for field, name in names.items()}))


def harmonic(place: str, origin: float = 0.0) -> Change:
    """``sine sin(order angle) + cosine cos(order angle)`` as amplitude, order and phase of the Harmonic at `place`.

    The angle counts from the `origin` (rad | m).
    """

    def apply(p: Stage, v: Values) -> Stage:
        size, phase = math.hypot(v["sine"], v["cosine"]), math.atan2(v["cosine"], v["sine"])
        phase = math.remainder(phase - v["order"] * math.tau * origin / p.mechanics.pitch, math.tau)
        return put(p, place, get(p, place)._replace(amplitude=size, order=v["order"], phase=phase))

    return apply


def harmonic_parameters(
    place: str, unit: str, size: float, orders: tuple[float, ...], most: float = math.inf
) -> Parameters:
    """Sine and cosine of typically `size`, at `most` so large, at each of the `orders`, of the Harmonic at `place`."""
    pair = tuple(Amplitude(part, unit, (size,), -most, most) for part in ("sine", "cosine"))
    return Parameters(pair, (Shape("order", "", orders, False),), harmonic(place))


def with_double(place: str, unit: str, size: float, orders: tuple[float, ...], most: float = math.inf) -> Parameters:
    """`harmonic_parameters` at `place`, and as many of twice the order at ``place_second``."""
    wave = harmonic_parameters(place, unit, size, orders, most)
    double = tuple(amplitude._replace(name=f"second_{amplitude.name}") for amplitude in wave.amplitudes)
    change = harmonic(f"{place}_second")

    def apply(p: Stage, v: Values) -> Stage:
        second = {"sine": v["second_sine"], "cosine": v["second_cosine"], "order": 2.0 * v["order"]}
        return change(wave.apply(p, v), second)

    return wave._replace(amplitudes=(*wave.amplitudes, *double), apply=apply)


def comb(places: Sequence[str], size: Amplitude, order: Shape, origin: float = 0.0) -> Parameters:
    """Sine and cosine of a wave at the first of `places`, and of multiples of its order at the others.

    Each is like `size`.  The angle counts from the `origin` (rad | m).
    """
    numbers = range(1, len(places) + 1)
    pairs = tuple(size._replace(name=f"{part}_{k}") for k in numbers for part in ("sine", "cosine"))
    multiples = tuple(Shape(f"multiple_{k}", "", (float(k),), False) for k in numbers[1:])

    def apply(p: Stage, v: Values) -> Stage:
        for k, place in zip(numbers, places, strict=True):
            whole = v["order"] * (v[f"multiple_{k}"] if k > 1 else 1.0)
            p = harmonic(place, origin)(p, {"sine": v[f"sine_{k}"], "cosine": v[f"cosine_{k}"], "order": whole})
        return p

    return Parameters(pairs, (order, *multiples), apply)


def warming(place: str, parameter: str, size: float) -> ParametersOf:
    """The rise, typically by the share `size`, of a `parameter` of a cold machine, in the block at `place`."""
    return lambda _: Parameters(
        (Amplitude("rise", "", (size,), -0.9, 5.0),),
        (Shape("time", "s", grids.WARMING_TIMES),),
        filled(place, rise="rise", time="time"),
        TimeVariation({"rise": parameter}, _decay),
    )


def coulomb(p: Stage, v: Values) -> Stage:
    """All friction but the viscous part, multiplied by 1 + size."""
    return p._replace(friction=stage.scaled_friction(p.friction, 1.0 + v["size"]))


def stretched(p: Stage, v: Values) -> Stage:
    """The rolling zone, longer by the share `size`."""
    return p._replace(friction=stage.stretched_friction(p.friction, 1.0 + v["size"]))


def _decay(v: Values, t: Any) -> Any:
    """``exp(-t / time)`` at the session clock `t` (n,) s: 1 on a cold machine, 0 on a warm one."""
    return np.exp(-t / v["time"])


def delayed(p: Stage, later: float, dt: float) -> Stage:
    """The drive's delay longer by `later` (s): as dead time, or whole periods `dt` (s) fewer where it is shorter."""
    dead = p.drive.dead_time + later
    fewer = min(math.ceil(max(-dead, 0.0) / dt), p.drive.delay_samples)
    delay = p.drive._replace(delay_samples=p.drive.delay_samples - fewer, dead_time=max(dead + fewer * dt, 0.0))
    return p._replace(drive=delay)
