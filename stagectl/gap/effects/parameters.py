"""Parameters that every model has: a change of one is an error of the parameter, not a missing effect."""

from __future__ import annotations

from stagectl.gap.effects.effect import (
    ACCELERATION,
    CONTROLLER,
    CURRENT,
    DIRECTION,
    FREQUENCY,
    MECHANICS,
    NONE,
    POSITION,
    SENSOR,
    SINCE_REVERSAL,
    SPEED,
    Amplitude,
    Data,
    Effect,
    Parameters,
    Scales,
)
from stagectl.gap.effects.stage_changes import Change, added, coulomb, scaled, stretched

EFFORT = "N m | N"
_FRICTION = ("friction.operators", "friction.bristle")


def _share(change: Change) -> Parameters:
    """A relative change of the parameter."""
    return Parameters((Amplitude("size", "", (0.1,), -0.9, 10.0),), (), change)


def _constant_force(s: Scales) -> Parameters:
    return Parameters((Amplitude("effort", EFFORT, (0.1 * s.coulomb,)),), (), added(effort="mechanics.bias"))


EFFECTS = (
    Effect(
        "inertia",
        "inertia",
        "parameters",
        MECHANICS,
        ACCELERATION,
        seen_over=(ACCELERATION,),
        places=("mechanics.inertia",),
        experiments=(
            "sine",
            "multisine",
            "sines-of-one-speed",
            "speeds-by-acceleration",
            "swing-three-rates",
            "resonance-of-the-base",
            "added mass",
        ),
        parameters=lambda _: _share(scaled("mechanics.inertia")),
        nominal=True,
        force_scaled=True,
    ),
    Effect(
        "viscous",
        "viscous friction",
        "parameters",
        MECHANICS,
        SPEED,
        seen_over=(SPEED,),
        places=("mechanics.viscous",),
        experiments=("sine", "stairs", "sines-of-one-speed", "stairs-wide", "warm-up"),
        parameters=lambda _: _share(scaled("mechanics.viscous")),
        look_alikes={"thermal_viscous": Data.IN_OPERATION | Data.FEW_MOTIONS},
        nominal=True,
        force_scaled=True,
    ),
    Effect(
        "coulomb",
        "Coulomb friction",
        "parameters",
        MECHANICS,
        DIRECTION,
        seen_over=(SPEED, DIRECTION),
        places=_FRICTION,
        experiments=("sine", "stairs", "stairs-wide", "warm-up"),
        parameters=lambda _: _share(coulomb),
        look_alikes={"thermal_coulomb": Data.IN_OPERATION},
        nominal=True,
        force_scaled=True,
    ),
    Effect(
        "presliding",
        "presliding friction",
        "friction with memory",
        MECHANICS,
        SINCE_REVERSAL,
        seen_over=(SINCE_REVERSAL,),
        places=_FRICTION,
        experiments=(
            "sine",
            "micro",
            "creep",
            "strokes",
            "micro-sweep",
            "micro-slow",
            "micro-fast",
            "reversals",
            "dwells",
            "dwells-short",
            "swing-one-way",
        ),
        parameters=lambda _: _share(stretched),
        look_alikes={"thermal_coulomb": Data.FEW_MOTIONS},
        nominal=True,
    ),
    Effect(
        "force_constant",
        "force constant",
        "parameters",
        MECHANICS,
        NONE,
        seen_over=(CURRENT, DIRECTION, ACCELERATION, SPEED),
        places=("motor.force_constant",),
        experiments=(
            "sine-strong",
            "sines-of-one-speed",
            "speeds-by-acceleration",
            "strong-sine",
            "added mass",
            "hanging weight",
            "back-EMF",
        ),
        parameters=lambda _: _share(scaled("motor.force_constant")),
        look_alikes={"current_gain": Data.ALL},
        nominal=True,
    ),
    Effect(
        "bias",
        "constant force on the axis",
        "parameters",
        MECHANICS,
        NONE,
        seen_over=(NONE, DIRECTION, POSITION, CURRENT),
        places=("mechanics.bias",),
        experiments=(
            "scan",
            "stairs-wide",
            "scan-slow",
            "rest",
            "rest-at-places",
            "hanging weight",
            "power-off reading",
        ),
        parameters=_constant_force,
        look_alikes={
            "current_offset": Data.WITHOUT_CURRENT | Data.IN_OPERATION | Data.FEW_MOTIONS,
            "coulomb_asymmetry": Data.ONE_SPEED | Data.IN_OPERATION | Data.FEW_MOTIONS,
        },
        nominal=True,
    ),
    Effect(
        "time_shift",
        "time shift of current to position",
        "encoder and record",
        SENSOR,
        FREQUENCY,
        seen_over=(FREQUENCY, ACCELERATION),
        places=(),
        experiments=("sines-of-one-speed", "resonance", "timestamps"),
        look_alikes={"dead_time": Data.IN_OPERATION | Data.FEW_MOTIONS, "jitter": Data.FEW_MOTIONS},
        nominal=True,
        in_stage_file=False,
    ),
    Effect(
        "controller",
        "controller",
        "controller",
        CONTROLLER,
        NONE,
        seen_over=(),
        places=(),
        experiments=(),
        in_stage_file=False,
    ),
)
