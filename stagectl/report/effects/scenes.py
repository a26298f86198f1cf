"""Every effect at a size that machines have, with a motion of the battery that shows it.

The machine is the ball-screw stage of the paper; the sizes are those of the design of the diagnosis, section 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from stagectl.gap.effects import library_drive, library_friction, library_mechanics, library_sensor
from stagectl.gap.effects.library import Definition, Scales, put
from stagectl.kernels import stage
from stagectl.kernels.friction import Stribeck
from stagectl.report.effects.measured_effect import COMMAND, CURRENT, Scene

TURN = 2.0 * math.pi
UM = TURN / 12e-3 * 1e-6  # rad of the motor for a micrometre of table travel
ORDERS = {"cogging": (8.0,), "current_ripple": (24.0,), "ball_pass_ripple": (5.37,), "encoder_interpolation": (512.0,)}
SIZES = Scales(  # of the ball-screw stage and the battery on it
    coulomb=1.0,
    viscous=0.14,
    inertia=0.01,
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
    orders=ORDERS,
)
FULL = 1e9  # Hz: all that is there
# After the reversal that comes before a micro-sine (s), and the way after each reversal (um).
CLOSE: dict[str, Any] = {"part": (0.6, math.inf), "zoom": (0.8, 24.0)}
SLOPES = (-0.45, 0.45)  # A/ms
FALL = 4e3 * UM  # rad/s: speed over which a Stribeck curve falls
WARMING = (0.0, 60.0, 120.0, 180.0, 240.0, 300.0, 420.0, 540.0)  # s


def _definitions() -> dict[str, Definition]:
    parts = (
        library_mechanics.parameters(SIZES),
        *(part.definitions(SIZES) for part in (library_drive, library_mechanics, library_friction, library_sensor)),
    )
    return {one.name: one for part in parts for one in part}


FAULT_TYPES = _definitions()


def effect(name: str, **values: float) -> Callable[[stage.Stage], stage.Stage]:
    """The change of the stage model that the diagnosis knows by this name."""
    return lambda p: FAULT_TYPES[name].apply(p, values)


def _volts(p: stage.Stage) -> stage.Stage:
    """A motor that needs more voltage the faster it turns."""
    return p._replace(drive=p.drive._replace(resistance=1.0, back_emf=0.72))


def _falling(p: stage.Stage) -> stage.Stage:
    """A friction whose Stribeck curve is known, but not that it lags."""
    return put(p, "friction.stribeck", Stribeck(0.3, FALL, 1.0))


def _scene(name: str, motion: str, across: str, values: dict[str, float], **more: Any) -> Scene:
    return Scene(name, effect(name, **values), motion, across, **more)


def scenes() -> dict[str, Scene]:
    """By the effects' names, in the order of the manual."""
    every = (*_parameters(), *_friction(), *_place(), *_time(), *_mechanics(), *_drive(), *_sensor())
    return {one.name: one for one in every}


def _parameters() -> tuple[Scene, ...]:
    return (
        _scene("inertia", "sine-medium", "acceleration", {"size": 0.1}),
        _scene("viscous", "stairs", "velocity", {"size": 0.1}),
        _scene("coulomb", "stairs", "velocity", {"size": 0.1}),
        _scene("presliding", "micro-above", "since", {"size": 0.5}, opposing=True, **CLOSE),
        _scene("force_constant", "sine-strong", "current", {"size": 0.05}, colours="gain"),
        _scene("bias", "stairs", "velocity", {"effort": 0.1}),
    )


def _friction() -> tuple[Scene, ...]:
    lagging: dict[str, float] = {"rise": 0.3, "velocity": FALL, "shape": 1.0, "lag": 0.01}
    aged = {"rise": 0.05, "time": 0.1, "length": 4.0 * UM}
    return (
        _scene("coulomb_asymmetry", "stairs", "velocity", {"size": 0.05}),
        _scene("viscous_asymmetry", "stairs", "velocity", {"size": 0.15}),
        _scene("viscous_nonlinear", "stairs", "velocity", {"size": 0.2, "root": 0.0}),
        _scene("stribeck", "stairs-creep", "speed", {"rise": 0.2, "velocity": 1.5e3 * UM, "shape": 1.0}),
        _scene(
            "friction_lag",
            "swing-three-rates",
            "pace",
            lagging,
            colours="gain",
            base=_falling,
            opposing=True,
            zoom=(1.0, 14.0),
        ),
        _scene("dwell", "dwells-short", "since", aged, colours="rest", opposing=True, **CLOSE),
        _scene("load_friction", "speeds-by-acceleration", "load", {"share": 0.05}, opposing=True),
    )


def _place() -> tuple[Scene, ...]:
    return (
        _scene("position_friction", "scan-slow", "position", {"slope": 0.15 / SIZES.stroke, "bow": 0.0}),
        _scene("lead_friction", "scan-slow", "turn", {"sine": 0.05, "cosine": 0.0, "order": 1.0}),
        _scene(
            "ball_pass_ripple",
            "scan-slow",
            "position",
            {"sine": 0.03, "cosine": 0.0, "order": 5.37},
            zoom=(-12.0, 12.0),
        ),
        _scene("cogging", "scan-slow", "turn", {"sine": 0.02, "cosine": 0.0, "order": 8.0}),
        _scene("current_ripple", "scan-at-two-loads", "turn", {"sine": 0.02, "cosine": 0.0, "order": 8.0}),
        _scene("cable_spring", "scan-slow", "position", {"stiffness": 0.1 / SIZES.stroke}),
        _scene("cable_hysteresis", "strokes", "since", {"effort": 0.1, "slip": 1e3 * UM}),
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
    play: dict[str, float] = {"gap": 4.0 * UM, "load_share": 0.3, "load_friction": 0.9}
    spring: dict[str, float] = {"load_share": 0.3, "load_friction": 0.8, "resonance": 250.0, "damping": 0.03}
    base: dict[str, float] = {"ratio": 0.08, "frequency": 20.0, "damping": 0.03}
    return (
        _scene("backlash", "micro-above", "since", {**play, "resonance": 800.0, "damping": 0.1}, band=200.0, **CLOSE),
        _scene("compliance", "multisine-middle", "frequency", spring, band=FULL),
        _scene("base_vibration", "step-and-settle", "time", base, above=4.0, part=(0.0, 2.85)),
    )


def _drive() -> tuple[Scene, ...]:
    quantum = Scene(
        "current_quantisation", lambda p: put(p, "drive.current_quantum", 0.05), "micro-slow", "current", CURRENT
    )._replace(zoom=(0.9, 1.2))
    jitter = Scene("jitter", lambda p: put(p, "drive.jitter", 0.0001), "sine-strong", "slope", CURRENT, zoom=SLOPES)
    deployed = Scene("controller", lambda p: p, "stairs", "error", COMMAND, gain=1.05)
    limited: dict[str, float] = {"depth": 0.15, "continuous": 0.0}
    return (
        _scene("dead_time", "sine-strong", "slope", {"time": 0.0003}, channel=CURRENT, zoom=SLOPES),
        _scene("current_loop", "multisine-middle", "frequency", {"lag": 0.0002}, channel=CURRENT),
        jitter,
        quantum._replace(base=lambda p: put(p, "drive.current_quantum", 0.0)),
        _scene("current_gain", "sine-strong", "current", {"size": 0.02}, channel=CURRENT),
        _scene("current_offset", "sine-strong", "current", {"current": 0.05, "reported": 1.0}, channel=CURRENT),
        _scene("current_saturation", "sine-strong", "current", limited, channel=CURRENT),
        _scene("voltage_saturation", "fast-cruise", "velocity", {"depth": 0.3}, channel=CURRENT, base=_volts),
        deployed,
    )


def _sensor() -> tuple[Scene, ...]:
    disc: dict[str, float] = {"sine": 30e-5, "cosine": 0.0, "order": 1.0}
    late = Scene("time_shift", lambda p: p, "sine-strong", "slope", shift=1, zoom=SLOPES)
    return (
        _scene("encoder_eccentricity", "constant-speed-fast", "turn", disc, colours="pace", band=40.0),
        _scene("encoder_interpolation", "creep", "period", {"sine": 3e-5, "cosine": 0.0, "order": 512.0}, band=FULL),
        late,
    )
