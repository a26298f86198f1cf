"""A load behind a spring, and a base on its feet: the encoder at the motor sees the same of both.

With all friction at the motor, the answers of the position to the current are one function::

    1 + mu s^2 / (s^2 + 2 zeta w s + w^2)      mu: mass over the base's, or load over what the motor itself moves

Friction at the load tells them apart, as far as there is any.  Where the data show none, the base is the simpler one.
"""

import math
from collections.abc import Callable

from stagectl.gap.effects.effect import Values
from stagectl.gap.selection import constants, linearised, refine, simulation_odds
from stagectl.gap.selection.candidates import EffectValues, in_place
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.refine import Evidence, Fitted

Other = tuple[str, Callable[[Values], Values]]


def _load(v: Values) -> Values:
    share = v["ratio"] / (1.0 + v["ratio"])
    return {"load_share": share, "resonance": v["frequency"], "damping": v["damping"], "load_friction": 0.0}


def _base(v: Values) -> Values:
    ratio = v["load_share"] / (1.0 - v["load_share"])
    return {"ratio": ratio, "frequency": v["resonance"], "damping": v["damping"]}


LOAD, BASE = "compliance", "base_vibration"
OTHERS: dict[str, Other] = {BASE: (LOAD, _load), LOAD: (BASE, _base)}


def simpler(e: Evidence, library: Library, now: Fitted) -> Fitted:
    """`now`, or with a base in the place of a load whose friction, one parameter more, explains next to nothing."""
    load = next((valued for valued in now.effects if valued.effect.name == LOAD), None)
    others = other_resonances(e, library, now, load) if load is not None else []
    return others[0] if others else now


def other_resonances(e: Evidence, library: Library, now: Fitted, valued: EffectValues) -> list[Fitted]:
    """`now` with the other one of the two, last, in the place of `valued`; none where it is far worse, or there."""
    if valued.effect.name not in OTHERS:
        return []
    name, values_of = OTHERS[valued.effect.name]
    rest = [effect for effect in now.effects if effect is not valued]
    form = next((form for form in library.forms if form.effect.name == name), None)
    if form is None or name in in_place(rest):
        return []
    after = refine.refine(e, now.model, [*rest, EffectValues(form.effect, values_of(valued.values))])
    instead, present = (linearised.remains(e, library, fitted) for fitted in (after, now))
    odds = math.exp(-0.5 * simulation_odds.gain_of_strokes(instead, present))
    return [after] if odds >= constants.COMPARABLE else []
