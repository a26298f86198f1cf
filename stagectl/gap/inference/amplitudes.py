"""Amplitude and phase of a sine and a cosine, and how large several of them are together, with their 95 % intervals.

An interval holds the values of all points that the common errors of the parts allow: those within as many standard
errors as an interval of one value.  So an amplitude's interval begins at none only where the parts may all be none.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.optimize import brentq

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.gram_matrices import NORMAL
from stagectl.gap.result.diagnosis import Value

_NO_ERROR = 1e-12  # of the sum of all squares: an error that is exactly none would have no inverse


def with_amplitudes(values: Mapping[str, Value], errors: Mapping[tuple[str, ...], Sequence[Array]]) -> dict[str, Value]:
    """`values` with amplitude and phase in the place of each sine and cosine, first; of a map after that of the whole.

    `errors` has the mean square errors (k, k) of each of the `groups`, from every division of the data.
    """
    found: dict[str, Value] = {}
    for group in groups(values):
        found |= _wave(group, values, errors[group]) if len(group) == 2 else {}
    rest = {name: value for name, value in values.items() if "sine" not in name}
    whole = groups(values)[-1] if found else ()
    if len(whole) > 2:
        return {**rest, "amplitude": _amplitude(whole, values, errors[whole]), **found}
    return {**found, **rest}


def groups(names: Iterable[str]) -> list[tuple[str, ...]]:
    """Each sine with its cosine; last, of a map, which has more than two of these pairs, all of them."""
    pairs = [(name, name.replace("sine", "cosine")) for name in names if "sine" in name and "cosine" not in name]
    return [*pairs, sum(pairs, ())] if len(pairs) > 2 else [*pairs]


def _wave(pair: tuple[str, ...], values: Mapping[str, Value], errors: Sequence[Array]) -> dict[str, Value]:
    """Amplitude and phase, named as the sine is."""
    amplitude, part = _amplitude(pair, values, errors), np.array([values[name].value for name in pair])
    phase = math.atan2(part[1], part[0])
    back, on = _turns(part, errors) if amplitude.low > 0.0 else (-math.pi, math.pi)
    names = [pair[0].replace("sine", name) for name in ("amplitude", "phase")]
    return {names[0]: amplitude, names[1]: Value(phase, phase + back, phase + on, "rad")}


def _amplitude(group: tuple[str, ...], values: Mapping[str, Value], errors: Sequence[Array]) -> Value:
    """Of one wave; of several that of one with the power of all."""
    part = np.array([values[name].value for name in group])
    ends = [lengths(part, error) for error in errors] or [(float(np.linalg.norm(part)),) * 2]
    low, high = min(end[0] for end in ends), max(end[1] for end in ends)
    return Value(float(np.linalg.norm(part)), low, high, values[group[0]].unit)


def lengths(point: Array, error: Array) -> tuple[float, float]:
    """The shortest and the longest vector within `NORMAL` standard errors of a `point` (k,), of its `error` (k, k)."""
    scale = math.sqrt(float(point @ point + np.trace(error)))
    if scale == 0.0 or not math.isfinite(scale):
        return 0.0, scale
    square, axes = np.linalg.eigh(error / scale**2)
    square = np.maximum(square, _NO_ERROR)
    part = np.abs(axes.T @ point) / scale + 1e-9 * np.sqrt(square)  # never across an axis, where two would be longest

    def excess(at: float) -> float:
        """Squared standard errors from the point to the extreme one at the multiplier `at`, over those allowed."""
        return float(np.sum(part * part * square / (at - square) ** 2)) - NORMAL**2

    def length(at: float) -> float:
        return scale * float(np.linalg.norm(part * at / (at - square)))

    reach = float(np.linalg.norm(part) * np.sqrt(square[-1])) / NORMAL
    longest = length(brentq(excess, square[-1] * (1.0 + 1e-12), square[-1] + 1.01 * reach))
    if excess(0.0) <= 0.0:
        return 0.0, longest
    return length(brentq(excess, -1.01 * reach, 0.0)), longest


def _turns(part: Array, errors: Sequence[Array]) -> tuple[float, float]:
    """How far the phase may turn either way, around ellipses that do not hold the origin."""
    phase, angle = math.atan2(part[1], part[0]), np.linspace(0.0, math.tau, 721)
    circle = NORMAL * np.array([np.cos(angle), np.sin(angle)])
    x, y = np.concatenate([part[:, None] + _root(error) @ circle for error in errors] or [part[:, None]], axis=1)
    turned = np.remainder(np.arctan2(y, x) - phase + math.pi, math.tau) - math.pi
    return float(turned.min()), float(turned.max())


def _root(error: Array) -> Array:
    square, axes = np.linalg.eigh(error)
    root: Array = axes * np.sqrt(np.maximum(square, 0.0)) @ axes.T
    return root
