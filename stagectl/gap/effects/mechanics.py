"""Effects of motor, screw, cable, table and base, but for factors on friction; and parameters that every model has."""

import math
from collections.abc import Sequence

from stagectl.gap.effects import grids
from stagectl.gap.effects.effect import Amplitude, Parameters, ParametersOf, Scales, Shape, Values
from stagectl.gap.effects.stage_changes import (
    Change,
    comb,
    coulomb,
    filled,
    harmonic,
    harmonic_parameters,
    put,
    scaled,
    sized,
    stretched,
    warming,
)
from stagectl.kernels.plant import SpeedPower
from stagectl.kernels.stage import Stage

_EFFORT, _STIFFNESS = "N m | N", "N m/rad | N/m"
_COGGING = ("motor.cogging", "motor.cogging_second", "motor.cogging_third", "motor.cogging_fourth")
_RIPPLE = ("motor.ripple", "motor.ripple_second", "motor.ripple_third")
_TRANSMISSION = ("load_share", "load_friction", "resonance", "damping")


def _viscous_nonlinear(s: Scales) -> Parameters:
    def apply(p: Stage, v: Values) -> Stage:
        """`size`: what the power of the speed adds at the largest speed, as a share of the viscous friction there."""
        effort = v["size"] * s.viscous * s.speed
        return put(p, "mechanics.viscous_power", SpeedPower(effort, s.speed, v["exponent"]))

    exponent = Shape("exponent", "", grids.SPEED_EXPONENTS, True, 0.2, 4.0)
    return Parameters((Amplitude("size", "", (0.2,), -1.0, 2.0),), (exponent,), apply)


def _cable_spring(s: Scales) -> Parameters:
    """Fitted around the middle of the travel, where it is no constant force; `cable_centre` finds its own centre."""
    return Parameters(
        (Amplitude("stiffness", _STIFFNESS, (0.1 * s.coulomb / s.stroke,), 0.0),),
        (Shape("centre", "rad | m", (s.centre,), False, s.centre - s.stroke, s.centre + s.stroke),),
        filled("mechanics.cable", stiffness="stiffness", centre="centre"),
    )


def _cable_hysteresis(s: Scales) -> Parameters:
    return Parameters(
        (Amplitude("effort", _EFFORT, (0.1 * s.coulomb,), 0.0),),
        (
            Shape("slip", "rad | m", tuple(s.stroke * f for f in grids.CABLE_SLIPS)),
            Shape("exponent", "", (1.0,), True, 0.05, 2.0),
        ),
        filled("mechanics.cable", hysteresis="effort", slip="slip", exponent="exponent"),
    )


def _backlash(s: Scales) -> Parameters:
    gaps = tuple(f * s.length for f in grids.BACKLASH_GAPS)
    closed, highest = grids.no_faster_than_rows(grids.BACKLASH_FREQUENCIES, s.dt), grids.highest_told(s.dt)
    return Parameters(
        (Amplitude("gap", "rad | m", gaps, 0.0, 20.0 * s.length),),
        (
            Shape("load_share", "", (grids.LOAD_SHARE,), True, 0.02, 0.95),
            Shape("load_friction", "", (0.9, 0.4), True, 0.0, 1.0, share=True),
            Shape("resonance", "Hz", closed, True, grids.SOFTEST_TRAIN, max(highest, grids.SOFTEST_TRAIN)),
            Shape("damping", "", (0.1,), True, 0.01, 1.0),
        ),
        lambda p, v: _with_load(p, v, backlash=v["gap"]) if v["gap"] > 0.0 else p,
        nonlinear=True,
    )


def _compliance(s: Scales) -> Parameters | None:
    """A load behind a spring: where the logs ring, it swings alone, as if the motor held it."""
    frequencies = _with_modes(grids.COMPLIANCE_FREQUENCIES, s, 1.0 / math.sqrt(1.0 - grids.LOAD_SHARE))
    if not frequencies:
        return None
    return Parameters(
        (Amplitude("load_share", "", (grids.LOAD_SHARE,), 0.0, 0.95),),
        (
            Shape("resonance", "Hz", frequencies, True, 2.0, grids.highest_told(s.dt)),
            Shape("damping", "", (0.03,), True, 0.002, 1.0),
            Shape("load_friction", "", (0.4,), True, 0.0, 1.0, share=True),
        ),
        lambda p, v: _with_load(p, v) if v["load_share"] > 0.0 else p,
        resonant=True,
    )


def _with_load(p: Stage, v: Values, **more: float) -> Stage:
    """The stage with a load behind its transmission."""
    changed = p.mechanics.transmission._replace(**{name: v[name] for name in _TRANSMISSION}, **more)
    return put(p, "mechanics.transmission", changed)


def _base_vibration(s: Scales) -> Parameters | None:
    grid = _with_modes(grids.BASE_FREQUENCIES, s, math.sqrt(1.0 + grids.BASE_RATIO))  # the axis on it holds it back
    if not grid:
        return None
    return Parameters(
        (Amplitude("ratio", "", (grids.BASE_RATIO,), 0.0, 1.0),),
        (
            Shape("frequency", "Hz", grid, True, 0.0, grids.highest_told(s.dt)),
            Shape("damping", "", (0.03,), True, 0.002, 1.0),
        ),
        filled("mechanics.base", ratio="ratio", frequency="frequency", damping="damping"),
        resonant=True,
    )


def _with_modes(usual: Sequence[float], s: Scales, higher: float) -> tuple[float, ...]:
    """The frequencies (Hz) at which the logs ring, each so much `higher`, and the `usual` ones far from these."""
    seen = grids.told_by_rows([higher * mode for mode in s.modes], s.dt)
    far = [f for f in usual if all(abs(f - mode) > grids.SAME_FREQUENCY * f for mode in seen)]
    return (*seen, *grids.told_by_rows(far, s.dt))


def _cogging_order(s: Scales) -> tuple[Shape, float]:
    """The order, and where its angle counts from (rad | m).

    A whole order of the pitch is exact.  Where the pitch is not known, none is whole: the order is fitted, and the
    angle counts from the middle of the travel, as far from there a phase says nothing.
    """
    orders = s.orders.get("cogging", ())
    fitted = bool(orders) and not any(order.is_integer() for order in orders)
    return Shape("order", "", orders, fitted, width=s.pitch / s.stroke), s.centre if fitted else 0.0


def _cogging(s: Scales) -> Parameters:
    order, origin = _cogging_order(s)
    wave = harmonic_parameters("motor.cogging", _EFFORT, 0.02 * s.coulomb, order.grid)
    return wave._replace(shapes=(order,), apply=harmonic("motor.cogging", origin))


def _cogging_map(s: Scales) -> Parameters | None:
    """A harmonic of the pitch with three of its multiples, as poles and teeth of a motor give them."""
    if not s.orders.get("cogging"):
        return None
    size = max(0.02 * s.coulomb, grids.COGGING_OF_EFFORT * s.force_constant * s.current)
    return comb(_COGGING, Amplitude("", _EFFORT, (size,)), *_cogging_order(s))


def _current_ripple(s: Scales) -> Parameters:
    """Three harmonics of the pole pairs: of the back-EMF's form, of the current sensors' offsets, of their gains."""
    order = Shape("order", "", s.orders.get("current_ripple", ()), False)
    return comb(_RIPPLE, Amplitude("", "", (0.01,), -0.2, 0.2), order)


def _gravity(s: Scales) -> Parameters | None:
    """The weight of what turns about an axis that is not vertical; not where the position is no angle."""
    return harmonic_parameters("mechanics.gravity", _EFFORT, s.coulomb, (1.0,)) if s.rotates else None


def _share(change: Change) -> ParametersOf:
    """A relative change of the parameter."""
    return lambda _: Parameters((Amplitude("size", "", (0.1,), -0.9, 10.0),), (), change)


PARAMETERS: dict[str, ParametersOf] = {
    # Parameters that every model has: a change of one is an error of the parameter, not a missing effect.
    "inertia": _share(scaled("mechanics.inertia")),
    "viscous": _share(scaled("mechanics.viscous")),
    "coulomb": _share(coulomb),
    "presliding": _share(stretched),
    "force_constant": _share(scaled("motor.force_constant")),
    "bias": lambda s: sized(Amplitude("effort", _EFFORT, (0.1 * s.coulomb,)), "mechanics.bias")(s),
    "cogging": _cogging,
    "cogging_map": _cogging_map,
    "gravity": _gravity,
    "current_ripple": _current_ripple,
    "viscous_nonlinear": _viscous_nonlinear,
    "viscous_asymmetry": sized(Amplitude("size", "", (0.1,), -0.9, 0.9), "mechanics.viscous_asymmetry"),
    "thermal_viscous": warming("mechanics.viscous_warming", "viscous", 0.2),
    "cable_spring": _cable_spring,
    "cable_hysteresis": _cable_hysteresis,
    "backlash": _backlash,
    "compliance": _compliance,
    "base_vibration": _base_vibration,
}
