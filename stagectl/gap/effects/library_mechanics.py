"""Effects of motor, screw, table and base: all that is not friction."""

from __future__ import annotations

from stagectl.gap.effects.library import (
    Amplitude,
    Definition,
    Scales,
    Shape,
    TimeVariation,
    Values,
    added,
    cold,
    coulomb,
    harmonic,
    put,
    scaled,
    stretched,
)
from stagectl.kernels.stage import Stage

EFFORT, STIFF, DAMPING = "N m | N", "N m/rad | N/m", "N m s/rad | N s/m"
FREQUENCIES = (80.0, 120.0, 180.0, 270.0, 400.0, 600.0, 900.0, 1350.0)  # Hz, of a compliance
MODES = (8.0, 11.0, 15.0, 21.0, 29.0, 40.0, 55.0)  # Hz, of a base


def parameters(s: Scales) -> list[Definition]:
    """What every model has already: a shift of it is an error of a parameter."""
    size = (Amplitude("size", "", (0.1,), -0.9, 10.0),)
    return [
        Definition("inertia", "mechanics", "acceleration", size, (), scaled("mechanics.inertia")),
        Definition("viscous", "mechanics", "speed", size, (), scaled("mechanics.viscous")),
        Definition("coulomb", "mechanics", "direction", size, (), coulomb),
        Definition("presliding", "mechanics", "displacement_since_reversal", size, (), stretched),
        Definition("force_constant", "mechanics", "none", size, (), scaled("motor.force_constant")),
        Definition(
            "bias",
            "mechanics",
            "none",
            (Amplitude("effort", EFFORT, (0.1 * s.coulomb,)),),
            (),
            added(effort="mechanics.bias"),
        ),
    ]


def definitions(s: Scales) -> list[Definition]:
    """Effects of the mechanics for a machine of these sizes."""
    return [*_motor(s), *_viscous(s), *_cable(s), *_masses(s)]


def _motor(s: Scales) -> list[Definition]:
    pair = (Amplitude("sine", EFFORT, (0.02 * s.coulomb,)), Amplitude("cosine", EFFORT, (0.02 * s.coulomb,)))
    share = (Amplitude("sine", "", (0.01,)), Amplitude("cosine", "", (0.01,)))
    return [
        Definition(
            "cogging",
            "mechanics",
            "position_mod_pitch",
            pair,
            (Shape("order", "", s.orders.get("cogging", ()), False),),
            harmonic("motor.cogging"),
        ),
        Definition(
            "current_ripple",
            "mechanics",
            "position_mod_pitch",
            share,
            (Shape("order", "", s.orders.get("current_ripple", ()), False),),
            harmonic("motor.ripple"),
        ),
    ]


def _viscous(s: Scales) -> list[Definition]:
    return [
        Definition(
            "viscous_nonlinear",
            "mechanics",
            "speed",
            (Amplitude("size", "", (0.2,), -2.0, 2.0),),
            (Shape("root", "", (0.0, 1.0), False),),
            lambda p, v: _bent(p, v, s),
        ),
        Definition(
            "viscous_asymmetry",
            "mechanics",
            "speed",
            (Amplitude("size", "", (0.1,), -0.9, 0.9),),
            (),
            added(size="mechanics.viscous_asymmetry"),
        ),
        Definition(
            "thermal_viscous",
            "mechanics",
            "time",
            (Amplitude("rise", "", (0.2,), -0.9, 5.0),),
            (Shape("time", "s", (30.0, 100.0, 300.0, 1000.0)),),
            lambda p, v: put(
                p, "mechanics.viscous_warming", p.mechanics.viscous_warming._replace(rise=v["rise"], time=v["time"])
            ),
            time_variation=TimeVariation({"rise": "viscous"}, cold),
        ),
    ]


def _bent(p: Stage, v: Values, s: Scales) -> Stage:
    """`size`: share of D w at the largest speed that bends, by the square or the root of the speed."""
    effort = v["size"] * s.viscous * s.speed
    place, scale = ("root", s.speed**0.5) if v["root"] else ("quadratic", s.speed**2)
    return put(p, f"mechanics.{place}", getattr(p.mechanics, place) + effort / scale)


def _cable(s: Scales) -> list[Definition]:
    return [
        Definition(
            "cable_spring",
            "mechanics",
            "position",
            (Amplitude("stiffness", STIFF, (0.1 * s.coulomb / s.stroke,)),),
            (),
            lambda p, v: put(
                p, "mechanics.cable", p.mechanics.cable._replace(stiffness=v["stiffness"], centre=s.centre)
            ),
        ),
        Definition(
            "cable_hysteresis",
            "mechanics",
            "displacement_since_reversal",
            (Amplitude("effort", EFFORT, (0.1 * s.coulomb,), 0.0),),
            (Shape("slip", "rad | m", tuple(s.stroke * f for f in (0.02, 0.05, 0.12, 0.3))),),
            lambda p, v: put(p, "mechanics.cable", p.mechanics.cable._replace(hysteresis=v["effort"], slip=v["slip"])),
        ),
    ]


def _masses(s: Scales) -> list[Definition]:
    zone = s.length
    return [
        Definition(
            "backlash",
            "mechanics",
            "displacement_since_reversal",
            (Amplitude("gap", "rad | m", tuple(f * zone for f in (0.04, 0.1, 0.25, 0.6, 1.5)), 0.0, 20.0 * zone),),
            (
                Shape("load_share", "", (0.3,), True, 0.02, 0.95),
                Shape("load_friction", "", (0.9, 0.4), True, 0.01, 1.0),
                Shape("resonance", "Hz", (800.0,), True, 200.0, 2500.0),
                Shape("damping", "", (0.1,), True, 0.01, 1.0),
            ),
            _backlash,
            nonlinear=True,
        ),
        Definition(
            "compliance",
            "mechanics",
            "frequency",
            (Amplitude("load_share", "", (0.3,), 0.0, 0.95),),
            (
                Shape("resonance", "Hz", FREQUENCIES, True, 50.0, 2500.0),
                Shape("damping", "", (0.03,), True, 0.002, 1.0),
                Shape("load_friction", "", (0.8,), True, 0.01, 1.0),
            ),
            _compliance,
            resonant=True,
        ),
        Definition(
            "base_vibration",
            "mechanics",
            "frequency",
            (Amplitude("ratio", "", (0.05,), 0.0, 1.0),),
            (Shape("frequency", "Hz", _modes(s)), Shape("damping", "", (0.03,), True, 0.002, 1.0)),
            lambda p, v: put(
                p,
                "mechanics.base",
                p.mechanics.base._replace(ratio=v["ratio"], frequency=v["frequency"], damping=v["damping"]),
            ),
        ),
    ]


def _modes(s: Scales) -> tuple[float, ...]:
    """Where the logs ring, and a grid for what rings in no line of its own."""
    return (*s.modes, *(f for f in MODES if all(abs(f - seen) > 0.05 * f for seen in s.modes)))


def _backlash(p: Stage, v: Values) -> Stage:
    if v["gap"] <= 0.0:
        return p
    changed = p.mechanics.transmission._replace(
        backlash=v["gap"],
        load_share=v["load_share"],
        load_friction=v["load_friction"],
        resonance=v["resonance"],
        damping=v["damping"],
    )
    return put(p, "mechanics.transmission", changed)


def _compliance(p: Stage, v: Values) -> Stage:
    if v["load_share"] <= 0.0:
        return p
    changed = p.mechanics.transmission._replace(
        load_share=v["load_share"],
        resonance=v["resonance"],
        damping=v["damping"],
        load_friction=v["load_friction"],
    )
    return put(p, "mechanics.transmission", changed)
