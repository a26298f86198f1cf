"""Effects of friction: factors on what slips."""

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
    harmonic,
    put,
)
from stagectl.kernels.stage import Stage

STATIONS = 24  # instants at which a step of the friction is looked for
WIPING = (0.15, 0.4, 1.0)  # of the rolling zone: about the mean slip of its elements, and 2.5 times less and more


def definitions(s: Scales) -> list[Definition]:
    """Friction effects for a machine of these sizes."""
    return [*_of_speed(s), *_of_place(s), *_of_time(s)]


def _of_speed(s: Scales) -> list[Definition]:
    zone, speeds = s.length, tuple(s.speed * f for f in (0.001, 0.004, 0.015, 0.06, 0.2))
    return [
        Definition(
            "coulomb_asymmetry",
            "mechanics",
            "direction",
            (Amplitude("size", "", (0.03,), -0.9, 0.9),),
            (),
            added(size="friction.asymmetry"),
        ),
        Definition(
            "stribeck",
            "mechanics",
            "speed",
            (Amplitude("rise", "", (0.1,), -0.5, 3.0),),
            (Shape("velocity", "rad/s | m/s", speeds), Shape("shape", "", (1.0,))),
            _stribeck,
        ),
        Definition(
            "friction_lag",
            "mechanics",
            "acceleration",
            (Amplitude("rise", "", (0.1,), 0.0, 3.0),),
            (
                Shape("velocity", "rad/s | m/s", speeds[1:4]),
                Shape("shape", "", (1.0,)),
                Shape("lag", "s", (0.003, 0.012)),
            ),
            _lagged,
        ),
        Definition(
            "dwell",
            "mechanics",
            "time",
            (Amplitude("rise", "", (0.03,), 0.0, 1.0),),
            (
                Shape("time", "s", (0.03, 0.2)),
                Shape("length", "rad | m", tuple(f * zone for f in WIPING), True, 0.05 * zone, 3.0 * zone),
            ),
            lambda p, v: put(
                p, "friction.dwell", p.friction.dwell._replace(rise=v["rise"], time=v["time"], length=v["length"])
            ),
        ),
        Definition(
            "load_friction",
            "mechanics",
            "current",
            (Amplitude("share", "", (0.03,), -0.2, 0.5),),
            (),
            added(share="friction.load"),
        ),
    ]


def _stribeck(p: Stage, v: Values) -> Stage:
    changed = p.friction.stribeck._replace(rise=v["rise"], velocity=v["velocity"], shape=v["shape"])
    return put(put(p, "friction.stribeck", changed), "friction.bristle.stribeck", changed)


def _lagged(p: Stage, v: Values) -> Stage:
    return put(_stribeck(p, v), "friction.lag", v["lag"])


def _of_place(s: Scales) -> list[Definition]:
    pair = (Amplitude("sine", "", (0.03,)), Amplitude("cosine", "", (0.03,)))
    return [
        Definition(
            "position_friction",
            "mechanics",
            "position",
            (
                Amplitude("slope", "1/rad | 1/m", (0.1 / s.stroke,)),
                Amplitude("bow", "1/rad^2 | 1/m^2", (0.1 / s.stroke**2,)),
            ),
            (),
            lambda p, v: put(
                p,
                "friction.along",
                p.friction.along._replace(slope=v["slope"], bow=v["bow"], centre=s.centre),
            ),
        ),
        Definition(
            "lead_friction",
            "mechanics",
            "position_mod_pitch",
            pair,
            (Shape("order", "", (1.0, *s.orders.get("lead_friction", ())), False),),
            harmonic("friction.lead"),
        ),
        Definition(
            "ball_pass_ripple",
            "mechanics",
            "position",
            pair,
            (Shape("order", "", s.orders.get("ball_pass_ripple", ()), False),),
            harmonic("friction.ball_pass"),
        ),
    ]


def _of_time(s: Scales) -> list[Definition]:
    stations = _thinned(s.session[1:])
    found = [
        Definition(
            "thermal_coulomb",
            "mechanics",
            "time",
            (Amplitude("rise", "", (0.1,), -0.9, 5.0),),
            (Shape("time", "s", (30.0, 100.0, 300.0, 1000.0)),),
            lambda p, v: put(p, "friction.warming", p.friction.warming._replace(rise=v["rise"], time=v["time"])),
            time_variation=TimeVariation({"rise": "coulomb"}, cold),
        )
    ]
    if stations:
        found.append(
            Definition(
                "friction_step",
                "mechanics",
                "time",
                (Amplitude("coulomb", "", (0.1,), -0.9, 5.0), Amplitude("viscous", "", (0.1,), -0.9, 5.0)),
                (Shape("at", "s", stations, False),),
                _stepped,
                time_variation=TimeVariation(
                    {"coulomb": "coulomb", "viscous": "viscous"}, lambda v, t: (t >= v["at"]) * 1.0
                ),
            )
        )
    return found


def _thinned(stations: tuple[float, ...]) -> tuple[float, ...]:
    """At most `STATIONS` of them, evenly: a step in between is told by its neighbours, too."""
    if len(stations) <= STATIONS:
        return stations
    return tuple(stations[round(k * (len(stations) - 1) / (STATIONS - 1))] for k in range(STATIONS))


def _stepped(p: Stage, v: Values) -> Stage:
    p = put(p, "friction.step", p.friction.step._replace(share=v["coulomb"], at=v["at"]))
    return put(p, "mechanics.viscous_step", p.mechanics.viscous_step._replace(share=v["viscous"], at=v["at"]))
