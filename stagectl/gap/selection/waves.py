"""Waves of the position that stand out of what surrounds them, however little they are of all that is missing.

An error in the form of the friction lies at the reversals and in the slow course of a stroke.  At a fine order of the
position there is next to none of it: a line there is judged by the spectrum beside it, and not by the whole.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import pitch_orders
from stagectl.gap.residuals.pitch_orders import Lines
from stagectl.gap.selection import constants, refine
from stagectl.gap.selection.candidates import EffectValues, of_the_motor
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.material import without
from stagectl.gap.selection.refine import Evidence, Fitted

SINGLE, MAP, ENCODER = constants.WAVES
RIPPLE, _ = constants.RIPPLES
MULTIPLES = ("multiple_2", "multiple_3", "multiple_4")  # parameters of a map; a ripple has the first two


class Wave(NamedTuple):
    """An effect of the model that stands by its line."""

    rest: Fitted  # the model without it, which has the line
    probability: float  # that the line is none of noise


class _Comb(NamedTuple):
    """Lines at an order and its multiples."""

    order: float  # of the pitch
    multiples: tuple[int, ...]


def with_wave(e: Evidence, library: Library, now: Fitted) -> Fitted | None:
    """`now` with a force or a ripple at the highest line in what it lacks, or with more harmonics of the force it has.

    None where no line is high enough, or stays when it is fitted.
    """
    return _with_force(e, library, now) or _with_ripple(e, library, now)


def _with_force(e: Evidence, library: Library, now: Fitted) -> Fitted | None:
    waves = [valued for valued in now.effects if valued.effect.name in (SINGLE, MAP)]
    if any(valued.effect.name == MAP for valued in waves):
        return None
    found = _lines(e, now, SINGLE)
    line = waves[0].values["order"] if waves else found.highest()
    comb = _comb(found, line)
    if not (comb.multiples if waves else _stands_out(found, line)):
        return None
    rest = [valued for valued in now.effects if valued not in waves]
    present = {valued.effect.name for valued in rest}
    fresh = _encoder(library, comb, found.apart) if not waves else []
    fresh = [*fresh, *_wave_of(library, comb, waves)]
    effects = [[*rest, each] for each in fresh if each.effect.name not in present]
    return _that_explains(e, now, effects, found, [each * comb.order for each in (1, *comb.multiples)])


def _with_ripple(e: Evidence, library: Library, now: Fitted) -> Fitted | None:
    """`now` with a ripple of the motor, whose orders are whole ones, or of the balls at its strongest line.

    A further line of the motor is one of its own harmonics, and no ball pass.
    """
    if not any(form.effect.name in constants.RIPPLES for form in library.forms):
        return None
    found = _lines(e, now, RIPPLE)
    line = found.strongest(constants.LINE)
    if line is None:
        return None
    own = next((valued for valued in now.effects if valued.effect.name == RIPPLE), None)
    others = [valued for valued in now.effects if valued is not own]
    tried = [[*now.effects, each] for each in _fresh_ripples(library, now, line)]
    if own is not None and line.is_integer():
        tried += [[*others, each] for each in _further_harmonic(e, now, own, line)]
    return _that_explains(e, now, tried, found, [line])


def _fresh_ripples(library: Library, now: Fitted, line: float) -> list[EffectValues]:
    """The ripples with this `line` that `now` does not have."""
    present = {valued.effect.name for valued in now.effects}
    forms = [form for form in library.forms if form.effect.name in {*constants.RIPPLES} - present]
    fresh = {
        form.effect.name: EffectValues(form.effect, {**form.values([0.0] * len(form.typical)), "order": line})
        for form in forms
    }
    return [
        each
        for name, each in fresh.items()
        if (line.is_integer() or name != RIPPLE) and not of_the_motor(each, now.effects)
    ]


def _further_harmonic(e: Evidence, now: Fitted, ripple: EffectValues, line: float) -> list[EffectValues]:
    """The `ripple` of `now` with the `line` in the place of a harmonic that has none; nothing where all have one."""
    values, (_, *further) = ripple.values, _harmonics(ripple)
    free = (
        (name, pair)
        for name, (order, pair) in zip(MULTIPLES, further, strict=False)
        if _line_without(e, now, ripple, order, pair)[0] < constants.LINE
    )
    return [
        EffectValues(ripple.effect, {**values, **dict.fromkeys(pair, 0.0), name: line / values["order"]})
        for name, pair in free
    ][:1]


def _that_explains(
    e: Evidence, now: Fitted, tried: Sequence[Sequence[EffectValues]], found: Lines, orders: Sequence[float]
) -> Fitted | None:
    """The best fit of the effects `tried`; None where it is no better than `now`, or the lines `orders` are left."""
    fits = [refine.refine(e, now.model, effects) for effects in tried]
    after = min(fits, key=lambda fitted: fitted.residual_sum_of_squares, default=now)
    if not after.residual_sum_of_squares < now.residual_sum_of_squares:
        return None
    return after if _gone(found, _lines(e, after, after.effects[-1].effect.name), orders) else None


def _comb(found: Lines, line: float) -> _Comb:
    """The comb that holds a `line` (order of the pitch): its multiples, or it and others as those of a lower one."""
    part = _divisor(found, line)
    order = line / part
    heights = {k: _height(found, k * order) for k in range(2, int(found.orders[-1] / order) + 1)}
    high = sorted((k for k, height in heights.items() if height >= constants.LINE), key=lambda k: -heights[k])
    own = [part] if part > 1 else []
    return _Comb(order, tuple([*own, *(k for k in high if k != part)][: len(MULTIPLES)]))


def _divisor(found: Lines, line: float) -> int:
    """Which multiple the `line` is of the highest line at a part of its order; 1 where none stands out.

    Parts count as far as the travel tells them apart.
    """
    parts = [k for k in range(2, 1 + int(line / found.orders[0])) if k * (k + 1) * found.apart < line]
    return max((k for k in parts if _stands_out(found, line / k)), key=lambda k: _height(found, line / k), default=1)


def _wave_of(library: Library, comb: _Comb, waves: Sequence[EffectValues]) -> list[EffectValues]:
    """The wave of a `comb`, from the values of the single one that is there; of the rest, the fit finds them."""
    wanted = MAP if comb.multiples else SINGLE
    form = next((form for form in library.forms if form.effect.name == wanted), None)
    if form is None:
        return []
    values = {**form.values([0.0] * len(form.typical)), "order": comb.order}
    if comb.multiples:
        others = [k for k in range(2, 2 + 2 * len(MULTIPLES)) if k not in comb.multiples]
        values |= dict(zip(MULTIPLES, map(float, [*comb.multiples, *others]), strict=False))
    for single in waves:
        place = 1 if single.values["order"] == comb.order else 2  # else it is the first of the multiples
        values |= {f"{part}_{place}": single.values[part] for part in ("sine", "cosine")}
    return [EffectValues(form.effect, values)]


def _encoder(library: Library, comb: _Comb, apart: float) -> list[EffectValues]:
    """An encoder that is off centre: it looks like a wave of one period a turn until it is simulated."""
    forms = [form for form in library.forms if form.effect.name == ENCODER]
    return [
        EffectValues(form.effect, form.values(form.typical))
        for form in forms
        if abs(form.shape["order"] - comb.order) <= apart and not comb.multiples
    ]


def stands(e: Evidence, now: Fitted, valued: EffectValues) -> bool:
    """Whether the effect `valued` of `now` is a wave whose line stands out without it, and is gone with it."""
    found = wave(e, now, valued)
    orders = [order for order, _ in _harmonics(valued)] if found else []
    name = valued.effect.name
    return found is not None and _gone(_lines(e, found.rest, name), _lines(e, now, name), orders)


def wave(e: Evidence, now: Fitted, valued: EffectValues) -> Wave | None:
    """The effect `valued` of `now` as a wave; None where what is missing without any harmonic has no line at its order.

    The power of noise is distributed exponentially: half of it lies below its median.
    """
    if valued.effect.name not in (*constants.WAVES, *constants.RIPPLES):
        return None
    height, count = max(_line_without(e, now, valued, *harmonic) for harmonic in _harmonics(valued))
    if height < constants.LINE:
        return None
    return Wave(without(e, now, valued), float(1.0 - count * 0.5**height))


def _harmonics(valued: EffectValues) -> list[tuple[float, tuple[str, str]]]:
    """The order of each harmonic, and the names of its sine and cosine."""
    values = valued.values
    if MULTIPLES[0] not in values:
        return [(values["order"], ("sine", "cosine"))]
    orders = [values["order"], *(values["order"] * values[name] for name in MULTIPLES if name in values)]
    return [(order, (f"sine_{k}", f"cosine_{k}")) for k, order in enumerate(orders, 1)]


def _line_without(
    e: Evidence, now: Fitted, valued: EffectValues, order: float, harmonic: tuple[str, str]
) -> tuple[float, int]:
    """Height of the line at `order` that `now` lacks without this `harmonic` of its wave; the number of lines.

    Another harmonic nearby would raise what surrounds the line.
    """
    less = EffectValues(valued.effect, {**valued.values, **dict.fromkeys(harmonic, 0.0)})
    rest = now._replace(effects=tuple(less if other is valued else other for other in now.effects))
    found = _lines(e, rest, valued.effect.name)
    return _height(found, order), len(found.orders)


def _lines(e: Evidence, now: Fitted, name: str) -> Lines:
    """The lines that `now` lacks, in the signal in which the effect `name` makes one."""
    return pitch_orders.lines(now.equipped, e.runs, now.model.stage.mechanics.pitch, name in constants.RIPPLES)


def _stands_out(found: Lines, order: float) -> bool:
    return _height(found, order) >= constants.LINE


def _gone(before: Lines, after: Lines, orders: Sequence[float]) -> bool:
    """Whether nearly all of the power at these orders is explained."""
    lost, whole = (sum(_power(found, order) for order in orders) for found in (after, before))
    return lost <= (1.0 - constants.GONE) * whole


def _power(found: Lines, order: float) -> float:
    return _largest(found, found.power, order)


def _height(found: Lines, order: float) -> float:
    return _largest(found, found.height, order)


def _largest(found: Lines, values: Array, order: float) -> float:
    """The largest of `values` (k,) that the travel does not tell from the `order`."""
    return float(values[np.abs(found.orders - order) <= found.apart].max(initial=0.0))
