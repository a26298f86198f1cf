"""Effects of friction: factors on what slips."""

from __future__ import annotations

from stagectl.gap.effects import grids
from stagectl.gap.effects.effect import (
    ACCELERATION,
    CURRENT,
    DIRECTION,
    FREQUENCY,
    MECHANICS,
    NONE,
    POSITION,
    SINCE_REVERSAL,
    SPEED,
    TIME,
    TURN,
    Amplitude,
    Data,
    Effect,
    Parameters,
    Scales,
    Shape,
    TimeVariation,
    Values,
)
from stagectl.gap.effects.stage_changes import added, decay, filled, harmonic_parameters, put
from stagectl.kernels.stage import Stage

_STRIBECK = ("friction.stribeck", "friction.bristle.stribeck")


def _asymmetry(_: Scales) -> Parameters:
    return Parameters((Amplitude("size", "", (0.03,), -0.9, 0.9),), (), added(size="friction.asymmetry"))


def _stribeck(s: Scales) -> Parameters:
    speeds = tuple(s.speed * f for f in grids.STRIBECK_SPEEDS)
    shapes = (Shape("velocity", "rad/s | m/s", speeds), Shape("shape", "", (1.0,)))
    return Parameters((Amplitude("rise", "", (0.1,), -0.5, 3.0),), shapes, _with_stribeck)


def _with_stribeck(p: Stage, v: Values) -> Stage:
    changed = p.friction.stribeck._replace(rise=v["rise"], velocity=v["velocity"], shape=v["shape"])
    return put(put(p, "friction.stribeck", changed), "friction.bristle.stribeck", changed)


def _lag(s: Scales) -> Parameters:
    return Parameters(
        (Amplitude("rise", "", (0.1,), 0.0, 3.0),),
        (
            Shape("velocity", "rad/s | m/s", tuple(s.speed * f for f in grids.STRIBECK_SPEEDS[1:4])),
            Shape("shape", "", (1.0,)),
            Shape("lag", "s", grids.FRICTION_LAGS),
        ),
        lambda p, v: put(_with_stribeck(p, v), "friction.lag", v["lag"]),
    )


def _dwell(s: Scales) -> Parameters:
    zone, slips = s.length, tuple(f * s.length for f in grids.DWELL_SLIPS)
    return Parameters(
        (Amplitude("rise", "", (0.03,), 0.0, 1.0),),
        (Shape("time", "s", grids.DWELL_TIMES), Shape("length", "rad | m", slips, True, 0.05 * zone, 3.0 * zone)),
        filled("friction.dwell", rise="rise", time="time", length="length"),
    )


def _load(_: Scales) -> Parameters:
    return Parameters((Amplitude("share", "", (0.03,), -0.2, 0.5),), (), added(share="friction.load"))


def _position(s: Scales) -> Parameters:
    def apply(p: Stage, v: Values) -> Stage:
        along = p.friction.along._replace(slope=v["slope"], bow=v["bow"], centre=s.centre)
        return put(p, "friction.along", along)

    slope = Amplitude("slope", "1/rad | 1/m", (0.1 / s.stroke,))
    return Parameters((slope, Amplitude("bow", "1/rad^2 | 1/m^2", (0.1 / s.stroke**2,))), (), apply)


def _lead(s: Scales) -> Parameters:
    return harmonic_parameters("friction.lead", "", 0.03, (1.0, *s.orders.get("lead_friction", ())))


def _ball_pass(s: Scales) -> Parameters:
    return harmonic_parameters("friction.ball_pass", "", 0.03, s.orders.get("ball_pass_ripple", ()))


def _thermal_coulomb(_: Scales) -> Parameters:
    return Parameters(
        (Amplitude("rise", "", (0.1,), -0.9, 5.0),),
        (Shape("time", "s", grids.WARMING_TIMES),),
        filled("friction.warming", rise="rise", time="time"),
        TimeVariation({"rise": "coulomb"}, decay),
    )


def _step(s: Scales) -> Parameters | None:
    times = _thinned(s.session[1:])
    if not times:
        return None
    return Parameters(
        (Amplitude("coulomb", "", (0.1,), -0.9, 5.0), Amplitude("viscous", "", (0.1,), -0.9, 5.0)),
        (Shape("at", "s", times, False),),
        _stepped,
        TimeVariation({"coulomb": "coulomb", "viscous": "viscous"}, lambda v, t: (t >= v["at"]) * 1.0),
    )


def _thinned(times: tuple[float, ...]) -> tuple[float, ...]:
    """At most `MOST_STEP_TIMES`, evenly spaced: a step between two of them shows at its neighbours."""
    most = grids.MOST_STEP_TIMES
    return times if len(times) <= most else tuple(times[round(k * (len(times) - 1) / (most - 1))] for k in range(most))


def _stepped(p: Stage, v: Values) -> Stage:
    p = put(p, "friction.step", p.friction.step._replace(share=v["coulomb"], at=v["at"]))
    return put(p, "mechanics.viscous_step", p.mechanics.viscous_step._replace(share=v["viscous"], at=v["at"]))


EFFECTS = (
    Effect(
        "coulomb_asymmetry",
        "Coulomb asymmetry",
        "friction over speed",
        MECHANICS,
        DIRECTION,
        seen_over=(DIRECTION, NONE, SINCE_REVERSAL),
        places=("friction.asymmetry",),
        experiments=("stairs", "stairs-wide", "stairs-fast", "reversals", "rest-at-places", "power-off reading"),
        parameters=_asymmetry,
        look_alikes={
            "bias": Data.ONE_SPEED | Data.IN_OPERATION | Data.FEW_MOTIONS,
            "current_offset": Data.FEW_MOTIONS,
        },
    ),
    Effect(
        "stribeck",
        "Stribeck friction",
        "friction over speed",
        MECHANICS,
        SPEED,
        seen_over=(SPEED, DIRECTION, SINCE_REVERSAL),
        places=_STRIBECK,
        experiments=(
            "stairs",
            "steps",
            "stairs-wide",
            "stairs-creep",
            "creep",
            "dwells",
            "dwells-short",
            "swing-one-way",
            "swing-three-rates",
        ),
        parameters=_stribeck,
        look_alikes={"viscous_nonlinear": Data.FEW_MOTIONS},
        kin=("speed",),
        generalisations=("friction_lag",),
    ),
    Effect(
        "friction_lag",
        "friction lag",
        "friction over speed",
        MECHANICS,
        ACCELERATION,
        seen_over=(SPEED, DIRECTION, ACCELERATION, SINCE_REVERSAL),
        places=(*_STRIBECK, "friction.lag"),
        experiments=("stairs-creep", "micro-fast", "reversals", "swing-one-way", "swing-three-rates"),
        parameters=_lag,
        kin=("speed",),
        extends="stribeck",
    ),
    Effect(
        "dwell",
        "friction that grows at rest",
        "friction with memory",
        MECHANICS,
        TIME,
        seen_over=(SINCE_REVERSAL, TIME),
        places=("friction.dwell",),
        experiments=("steps", "stairs-creep", "dwells", "dwells-short", "swing-one-way", "step-and-settle"),
        parameters=_dwell,
        kin=("reversal",),
    ),
    Effect(
        "load_friction",
        "friction that grows with the load",
        "friction over speed",
        MECHANICS,
        CURRENT,
        seen_over=(CURRENT, ACCELERATION),
        places=("friction.load",),
        experiments=("sine-strong", "scan-at-two-loads", "speeds-by-acceleration", "strong-sine"),
        parameters=_load,
    ),
    Effect(
        "position_friction",
        "friction that changes along the stroke",
        "over position",
        MECHANICS,
        POSITION,
        seen_over=(POSITION,),
        places=("friction.along",),
        experiments=("scan", "scan-slow", "scans-at-two-speeds", "rest-at-places"),
        parameters=_position,
        kin=("stroke",),
    ),
    Effect(
        "lead_friction",
        "friction once per revolution",
        "over position",
        MECHANICS,
        TURN,
        seen_over=(TURN,),
        places=("friction.lead",),
        experiments=(
            "scan",
            "constant-speed-long",
            "constant-speed-fast",
            "scan-slow",
            "scans-at-two-speeds",
            "second sensor",
        ),
        parameters=_lead,
        kin=("angle",),
        generalisations=("ball_pass_ripple",),
    ),
    Effect(
        "ball_pass_ripple",
        "ball-pass ripple",
        "over position",
        MECHANICS,
        POSITION,
        seen_over=(TURN, POSITION, FREQUENCY),
        places=("friction.ball_pass",),
        experiments=("constant-speed-long", "constant-speed-fast"),
        parameters=_ball_pass,
        kin=("angle",),
    ),
    Effect(
        "thermal_coulomb",
        "thermal Coulomb friction",
        "over the session",
        MECHANICS,
        TIME,
        seen_over=(TIME, SPEED, DIRECTION),
        places=("friction.warming",),
        experiments=("strokes", "warm-up"),
        parameters=_thermal_coulomb,
        look_alikes={"coulomb": Data.IN_OPERATION, "presliding": Data.FEW_MOTIONS},
        kin=("session",),
    ),
    Effect(
        "friction_step",
        "step of the friction",
        "over the session",
        MECHANICS,
        TIME,
        seen_over=(TIME, SPEED, DIRECTION),
        places=("friction.step", "mechanics.viscous_step"),
        experiments=("warm-up",),
        parameters=_step,
        kin=("session",),
    ),
)
