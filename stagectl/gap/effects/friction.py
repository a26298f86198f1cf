"""Effects of friction: factors on what slips."""

from stagectl.gap.effects import grids
from stagectl.gap.effects.effect import Amplitude, Parameters, ParametersOf, Scales, Shape, TimeVariation, Values
from stagectl.gap.effects.stage_changes import filled, harmonic_parameters, put, sized, warming, with_double
from stagectl.kernels.stage import Stage


def _stribeck(s: Scales) -> Parameters:
    speeds = tuple(s.speed * f for f in grids.STRIBECK_SPEEDS)
    shapes = (Shape("velocity", "rad/s | m/s", speeds), Shape("shape", "", (1.0,)))
    return Parameters((Amplitude("rise", "", (0.1,), 0.0, 3.0),), shapes, _with_stribeck)


def _with_stribeck(p: Stage, v: Values) -> Stage:
    changed = p.friction.stribeck._replace(rise=v["rise"], velocity=v["velocity"], shape=v["shape"])
    return put(put(p, "friction.stribeck", changed), "friction.bristle.stribeck", changed)


def _lag(s: Scales) -> Parameters:
    prompt = _stribeck(s)
    velocity, shape = prompt.shapes
    shapes = (velocity._replace(grid=velocity.grid[1:4]), shape, Shape("lag", "s", grids.FRICTION_LAGS))
    return prompt._replace(shapes=shapes, apply=lambda p, v: put(_with_stribeck(p, v), "friction.lag", v["lag"]))


def _dwell(s: Scales) -> Parameters:
    zone, slips = s.length, tuple(f * s.length for f in grids.DWELL_SLIPS)
    return Parameters(
        (Amplitude("rise", "", (0.03,), 0.0, 1.0),),
        (Shape("time", "s", grids.DWELL_TIMES), Shape("length", "rad | m", slips, True, 0.05 * zone, 3.0 * zone)),
        filled("friction.dwell", rise="rise", time="time", length="length"),
    )


def _position(s: Scales) -> Parameters:
    def apply(p: Stage, v: Values) -> Stage:
        along = p.friction.along._replace(slope=v["slope"], bow=v["bow"], centre=s.centre)
        return put(p, "friction.along", along)

    slope = Amplitude("slope", "1/rad | 1/m", (0.1 / s.stroke,))
    return Parameters((slope, Amplitude("bow", "1/rad^2 | 1/m^2", (0.1 / s.stroke**2,))), (), apply)


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


PARAMETERS: dict[str, ParametersOf] = {
    "coulomb_asymmetry": sized(Amplitude("size", "", (0.03,), -0.9, 0.9), "friction.asymmetry"),
    "stribeck": _stribeck,
    "friction_lag": _lag,
    "dwell": _dwell,
    "load_friction": sized(Amplitude("share", "", (0.03,), 0.0, 0.5), "friction.load"),
    "position_friction": _position,
    "lead_friction": lambda _: with_double("friction.lead", "", 0.03, (1.0,), 0.7),
    "ball_pass_ripple": lambda s: harmonic_parameters(
        "friction.ball_pass", "", 0.03, s.orders.get("ball_pass_ripple", ()), 0.7
    ),
    "thermal_coulomb": warming("friction.warming", "coulomb", 0.1),
    "friction_step": _step,
}
