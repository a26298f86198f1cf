"""The effects, blocks and coordinates by their names, as a person calls them."""

from __future__ import annotations

from collections.abc import Mapping

EFFECTS: Mapping[str, str] = {
    "inertia": "inertia",
    "force_constant": "force constant",
    "viscous": "viscous friction",
    "viscous_nonlinear": "nonlinear viscous friction",
    "coulomb": "Coulomb friction",
    "coulomb_asymmetry": "Coulomb asymmetry",
    "viscous_asymmetry": "viscous asymmetry",
    "stribeck": "Stribeck friction",
    "presliding": "presliding friction",
    "dwell": "friction that grows at rest",
    "friction_lag": "friction lag",
    "load_friction": "friction that grows with the load",
    "position_friction": "friction that changes along the stroke",
    "lead_friction": "friction once per revolution",
    "cogging": "cogging",
    "current_ripple": "current ripple",
    "ball_pass_ripple": "ball-pass ripple",
    "encoder_eccentricity": "encoder eccentricity",
    "encoder_interpolation": "encoder interpolation error",
    "current_quantisation": "current quantisation",
    "dead_time": "dead time",
    "jitter": "jitter",
    "current_loop": "current-loop lag",
    "current_saturation": "current saturation",
    "voltage_saturation": "voltage saturation",
    "current_gain": "gain of the reported current",
    "current_offset": "current offset",
    "bias": "constant force on the axis",
    "cable_spring": "cable spring",
    "cable_hysteresis": "cable hysteresis",
    "thermal_viscous": "thermal viscous friction",
    "thermal_coulomb": "thermal Coulomb friction",
    "friction_step": "step of the friction",
    "backlash": "backlash",
    "compliance": "compliance",
    "base_vibration": "vibration of the base",
    "time_shift": "time shift of current to position",
    "controller": "controller",
}
_COORDINATES: Mapping[str, str] = {
    "displacement_since_reversal": "displacement since the reversal",
    "position_mod_pitch": "position modulo the pitch",
    "none": "no coordinate",
}


def effect(name: str) -> str:
    """``viscous asymmetry`` for ``viscous_asymmetry``; a name that is not known is shown as it is, with blanks."""
    return EFFECTS.get(name, name.replace("_", " "))


def coordinate(name: str) -> str:
    """``position modulo the pitch`` for ``position_mod_pitch``."""
    return _COORDINATES.get(name, name.replace("_", " "))
