"""Effects between the command and the motor's current, and in the current that the drive reports."""

from __future__ import annotations

from stagectl.gap.effects import grids
from stagectl.gap.effects.effect import Amplitude, Parameters, ParametersOf, Scales, Shape, Values
from stagectl.gap.effects.stage_changes import added, put
from stagectl.kernels.stage import Stage


def _offset(_: Scales) -> Parameters:
    def apply(p: Stage, v: Values) -> Stage:
        return added(current="drive.telemetry.offset" if v["reported"] else "drive.offset")(p, v)

    return Parameters((Amplitude("current", "A", (0.03,)),), (Shape("reported", "", (0.0, 1.0), False),), apply)


def _current_limit(s: Scales) -> Parameters:
    def apply(p: Stage, v: Values) -> Stage:
        if v["depth"] <= 0.0:
            return p
        place = "drive.continuous_current" if v["continuous"] else "drive.current_limit"
        return put(p, place, s.current * (1.0 - v["depth"]))

    return Parameters((_DEPTH,), (Shape("continuous", "", (0.0, 1.0), False),), apply)


def _voltage_limit(s: Scales) -> Parameters | None:
    if s.voltage <= 0.0:
        return None
    return Parameters((_DEPTH,), (), lambda p, v: put(p, "drive.voltage_limit", s.voltage * (1.0 - v["depth"])))


_DEPTH = Amplitude("depth", "", grids.LIMIT_DEPTHS, 0.0, 0.9)


PARAMETERS: dict[str, ParametersOf] = {
    "dead_time": lambda s: Parameters(
        (Amplitude("time", "s", (0.0006,), 0.0, 4.0 * s.dt),), (), added(time="drive.dead_time")
    ),
    "current_loop": lambda _: Parameters(
        (Amplitude("lag", "s", (0.0002,), -0.001, 0.005),),
        (),
        lambda p, v: put(p, "drive.current_lag", max(p.drive.current_lag + v["lag"], 0.0)),
    ),
    "current_gain": lambda _: Parameters(
        (Amplitude("size", "", (0.02,), -0.2, 0.2),), (), added(size="drive.telemetry.gain")
    ),
    "current_offset": _offset,
    "current_saturation": _current_limit,
    "voltage_saturation": _voltage_limit,
}
