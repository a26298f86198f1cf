"""A scene for every effect: a size that machines have, and a motion of the battery that shows it.

The machine is the ball-screw stage of the paper.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

from stagectl.gap.effects.effect import Scales, definition
from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.effects.stage_changes import put
from stagectl.kernels import stage
from stagectl.kernels.friction import Stribeck
from stagectl_studies.effect_pictures.measured_effect import COMMAND, CURRENT, Scene

TURN = 2.0 * math.pi
UM = TURN / 12e-3 * 1e-6  # rad of the motor for a micrometre of table travel
ORDERS = {"cogging": (8.0,), "current_ripple": (24.0,), "ball_pass_ripple": (5.37,), "encoder_interpolation": (512.0,)}
SIZES = Scales(  # of the ball-screw stage and the battery on it
    coulomb=1.0,
    viscous=0.14,
    force_constant=0.72,
    length=15.0 * UM,
    speed=80e3 * UM,
    centre=0.0,
    stroke=47.5e3 * UM,
    current=12.75,
    pitch=TURN,
    dt=0.0005,
    session=(0.0, 200.0),
    voltage=50.0,
    delay=0.0005,
    lag=0.000159,
    rotates=True,  # gravity is shown as a beam on the motor's shaft would feel it
    orders=ORDERS,
)
FULL_BAND = 1e9  # Hz
# Part of a micro-sine after its first reversal (s), and displacement after each reversal (um).
AFTER_REVERSAL: dict[str, Any] = {"part": (0.6, math.inf), "zoom": (0.8, 24.0)}
SLOPES = (-0.45, 0.45)  # A/ms
FALL = 4e3 * UM  # rad/s, Stribeck velocity
COGGED = {"order": 7.0, "multiple_2": 2.0, "multiple_3": 3.0, "multiple_4": 4.0} | {
    f"{part}_{k}": 0.02 / k * (part == "sine") for k in range(1, 5) for part in ("sine", "cosine")
}
LEAD = {"sine": 0.05, "cosine": 0.0, "second_sine": 0.0, "second_cosine": 0.0, "order": 1.0}
RIPPLE = {"order": 8.0, "multiple_2": 2.0, "multiple_3": 3.0} | {
    f"{part}_{k}": 0.02 * (part == "sine" and k == 1) for k in range(1, 4) for part in ("sine", "cosine")
}
UNEVEN = {"gain": -0.1, "gain_asymmetry": 0.04, "offset": 0.0, "directed_offset": 0.1}
WARMING = (0.0, 60.0, 120.0, 180.0, 240.0, 300.0, 420.0, 540.0)  # s


def change(name: str, values: dict[str, float]) -> Callable[[stage.Stage], stage.Stage]:
    """What the effect with these values does to a stage model; without values, nothing.

    An effect that is not searched for has one value, that of its place.
    """
    effect = EFFECTS[name]
    parameters = definition(effect, SIZES)
    if parameters is not None:
        return lambda p: parameters.apply(p, values)
    return lambda p: functools.reduce(lambda q, place: put(q, place, values["value"]), effect.places, p)


def _with_windings(p: stage.Stage) -> stage.Stage:
    """A motor whose voltage rises with its speed."""
    return p._replace(drive=p.drive._replace(resistance=1.0, back_emf=0.72))


def _with_stribeck(p: stage.Stage) -> stage.Stage:
    """A model that has the Stribeck curve, but not its lag."""
    return put(p, "friction.stribeck", Stribeck(0.3, FALL, 1.0))


def _scene(name: str, motion: str, across: str, values: dict[str, float], **more: Any) -> Scene:
    return Scene(name, change(name, values), motion, across, **more)


def scenes() -> dict[str, Scene]:
    """By the effects' names, in the order of the manual."""
    parts = (_parameters(), _friction(), _place(), _time(), _mechanics(), _drive(), _sensor())
    return {scene.name: scene for part in parts for scene in part}


def _parameters() -> tuple[Scene, ...]:
    return (
        _scene("inertia", "sine-medium", "acceleration", {"size": 0.1}),
        _scene("viscous", "stairs", "velocity", {"size": 0.1}),
        _scene("coulomb", "stairs", "velocity", {"size": 0.1}),
        _scene("presliding", "micro-above", "since", {"size": 0.5}, opposing=True, **AFTER_REVERSAL),
        _scene("force_constant", "sine-strong", "current", {"size": 0.05}, colours="gain"),
        _scene("bias", "stairs", "velocity", {"effort": 0.1}),
    )


def _friction() -> tuple[Scene, ...]:
    lagging: dict[str, float] = {"rise": 0.3, "velocity": FALL, "shape": 1.0, "lag": 0.01}
    aged = {"rise": 0.05, "time": 0.1, "length": 4.0 * UM}
    return (
        _scene("coulomb_asymmetry", "stairs", "velocity", {"size": 0.05}),
        _scene("viscous_asymmetry", "stairs", "velocity", {"size": 0.15}),
        _scene("viscous_nonlinear", "stairs", "velocity", {"size": 0.2, "exponent": 2.0}),
        _scene("stribeck", "stairs-creep", "speed", {"rise": 0.2, "velocity": 1.5e3 * UM, "shape": 1.0}),
        _scene(
            "friction_lag",
            "swing-three-rates",
            "pace",
            lagging,
            colours="gain",
            base=_with_stribeck,
            opposing=True,
            zoom=(1.0, 14.0),
        ),
        _scene("dwell", "dwells-short", "since", aged, colours="rest", opposing=True, **AFTER_REVERSAL),
        _scene("load_friction", "speeds-by-acceleration", "load", {"share": 0.05}, opposing=True),
    )


def _place() -> tuple[Scene, ...]:
    return (
        _scene("position_friction", "scan-slow", "position", {"slope": 0.15 / SIZES.stroke, "bow": 0.0}),
        _scene("lead_friction", "scan-slow", "turn", LEAD),
        _scene(
            "ball_pass_ripple",
            "scan-slow",
            "position",
            {"sine": 0.03, "cosine": 0.0, "order": 5.37},
            zoom=(-12.0, 12.0),
        ),
        _scene("cogging", "scan-slow", "turn", {"sine": 0.02, "cosine": 0.0, "order": 8.0}),
        _scene("cogging_map", "scan-slow", "turn", COGGED),
        _scene("gravity", "scan-slow", "turn", {"sine": 0.3, "cosine": 0.0, "order": 1.0}),
        _scene("current_ripple", "scan-at-two-loads", "turn", RIPPLE),
        _scene("cable_spring", "scan-slow", "position", {"stiffness": 0.1 / SIZES.stroke, "centre": SIZES.centre}),
        _scene("cable_hysteresis", "strokes", "since", {"effort": 0.1, "slip": 1e3 * UM, "exponent": 1.0}),
    )


def _time() -> tuple[Scene, ...]:
    return (
        _scene("thermal_viscous", "sine-medium", "clock", {"rise": 0.4, "time": 180.0}, starts=WARMING),
        _scene("thermal_coulomb", "sine-medium", "clock", {"rise": 0.15, "time": 180.0}, starts=WARMING),
        _scene(
            "friction_step",
            "sine-medium",
            "clock",
            {"coulomb": 0.1, "viscous": 0.1, "at": 200.0},
            starts=WARMING,
        ),
    )


def _mechanics() -> tuple[Scene, ...]:
    play: dict[str, float] = {
        "gap": 4.0 * UM,
        "load_share": 0.3,
        "load_friction": 0.9,
        "resonance": 800.0,
        "damping": 0.1,
    }
    spring: dict[str, float] = {"load_share": 0.3, "load_friction": 0.8, "resonance": 250.0, "damping": 0.03}
    base: dict[str, float] = {"ratio": 0.08, "frequency": 20.0, "damping": 0.03}
    return (
        _scene(
            "backlash",
            "micro-above",
            "since",
            play,
            band=200.0,
            **AFTER_REVERSAL,
        ),
        _scene("compliance", "multisine-middle", "frequency", spring, band=FULL_BAND),
        _scene("base_vibration", "step-and-settle", "time", base, above=4.0, part=(0.0, 2.85)),
    )


def _drive() -> tuple[Scene, ...]:
    return (
        _scene("dead_time", "sine-strong", "slope", {"time": 0.0003}, channel=CURRENT, zoom=SLOPES),
        _scene("torque_path", "sine-strong", "current", UNEVEN, channel=CURRENT),
        _scene("current_loop", "multisine-middle", "frequency", {"lag": 0.0002, "damping": 5.0}, channel=CURRENT),
        _scene("jitter", "sine-strong", "slope", {"value": 0.0001}, channel=CURRENT, zoom=SLOPES),
        _scene(
            "current_quantisation",
            "micro-slow",
            "current",
            {"value": 0.05},
            channel=CURRENT,
            base=lambda p: put(p, "drive.current_quantum", 0.0),
            zoom=(0.9, 1.2),
        ),
        _scene("current_gain", "sine-strong", "current", {"size": 0.02}, channel=CURRENT),
        _scene("current_offset", "sine-strong", "current", {"current": 0.05, "reported": 1.0}, channel=CURRENT),
        _scene("current_saturation", "sine-strong", "current", {"depth": 0.15, "continuous": 0.0}, channel=CURRENT),
        _scene("voltage_saturation", "fast-cruise", "velocity", {"depth": 0.3}, channel=CURRENT, base=_with_windings),
        _scene("controller", "stairs", "error", {}, channel=COMMAND, gain=1.05),
    )


def _sensor() -> tuple[Scene, ...]:
    disc: dict[str, float] = {"sine": 30e-5, "cosine": 0.0, "order": 1.0}
    period: dict[str, float] = {"sine": 3e-5, "cosine": 0.0, "second_sine": 1e-5, "second_cosine": 0.0, "order": 512.0}
    return (
        _scene("encoder_eccentricity", "constant-speed-fast", "turn", disc, colours="pace", band=40.0),
        _scene("encoder_interpolation", "creep", "period", period, band=FULL_BAND),
        _scene("time_shift", "sine-strong", "slope", {}, shift=1, zoom=SLOPES),
    )
