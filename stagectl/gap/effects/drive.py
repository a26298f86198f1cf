"""Effects of the electronics: from the command to the motor's current and its report, and from position to its log."""

from stagectl.gap.effects import grids
from stagectl.gap.effects.effect import Amplitude, Parameters, ParametersOf, Scales, Shape, Values
from stagectl.gap.effects.stage_changes import added, delayed, harmonic_parameters, put, sized, with_double
from stagectl.kernels.stage import Stage

_PER_TURN, _PER_PERIOD = grids.ENCODER_ERRORS


def _offset(_: Scales) -> Parameters:
    def apply(p: Stage, v: Values) -> Stage:
        return added(current="drive.telemetry.offset" if v["reported"] else "drive.offset")(p, v)

    return Parameters((Amplitude("current", "A", (0.03,)),), (Shape("reported", "", (0.0, 1.0), False),), apply)


def _current_limit(s: Scales) -> Parameters | None:
    if not s.commanded:
        return None

    def apply(p: Stage, v: Values) -> Stage:
        if v["depth"] <= 0.0:
            return p
        place = "drive.continuous_current" if v["continuous"] else "drive.current_limit"
        return put(p, place, s.current * (1.0 - v["depth"]))

    return Parameters((_DEPTH,), (Shape("continuous", "", (0.0, 1.0), False),), apply)


def _voltage_limit(s: Scales) -> Parameters | None:
    if s.voltage <= 0.0 or not s.commanded:
        return None
    return Parameters((_DEPTH,), (), lambda p, v: put(p, "drive.voltage_limit", s.voltage * (1.0 - v["depth"])))


_DEPTH = Amplitude("depth", "", grids.LIMIT_DEPTHS, 0.0, 0.9)


def _dead_time(s: Scales) -> Parameters | None:
    """Where a current is measured; the baseline fit moves the delay where it is not."""
    if not s.commanded or not s.measured:
        return None
    delay = Amplitude("time", "s", (0.0006,), -s.delay, 4.0 * s.dt)
    return Parameters((delay,), (), lambda p, v: delayed(p, v["time"], s.dt))


def _current_loop(s: Scales) -> Parameters | None:
    if not s.commanded:
        return None
    lag = Amplitude("lag", "s", (0.0002,), -s.lag, 0.005)
    damping = Shape("damping", "", grids.LOOP_DAMPINGS, True, *grids.LOOP_DAMPING)

    def apply(p: Stage, v: Values) -> Stage:
        if v["lag"] == 0.0:
            return p
        drive = p.drive._replace(current_lag=max(p.drive.current_lag + v["lag"], 0.0), current_damping=v["damping"])
        return p._replace(drive=drive)

    return Parameters((lag,), (damping,), apply)


def _torque_path(s: Scales) -> Parameters | None:
    """What comes of a command, by direction; without a current it is the force constant's."""
    if not s.commanded or not s.measured:
        return None
    names = ("gain", "gain_asymmetry", "offset", "directed_offset")
    amplitudes = (
        Amplitude("gain", "", (0.05,), -0.9, 10.0),
        Amplitude("gain_asymmetry", "", (0.05,), -0.9, 0.9),
        *(Amplitude(name, "A", (0.03 * s.current,)) for name in names[2:]),
    )
    return Parameters(amplitudes, (), added(**{name: f"drive.{name}" for name in names}))


def _interpolation(s: Scales) -> Parameters | None:
    orders = (s.periods,) if s.periods else s.orders.get("encoder_interpolation", ())
    if not orders:
        return None
    return with_double("encoder.interpolation", "rad | m", _PER_PERIOD * s.pitch, orders)


PARAMETERS: dict[str, ParametersOf] = {
    "dead_time": _dead_time,
    "torque_path": _torque_path,
    "current_loop": _current_loop,
    "current_gain": sized(Amplitude("size", "", (0.02,), -0.2, 0.2), "drive.telemetry.gain"),
    "current_offset": _offset,
    "current_saturation": _current_limit,
    "voltage_saturation": _voltage_limit,
    "encoder_eccentricity": lambda s: harmonic_parameters(
        "encoder.eccentricity", "rad | m", _PER_TURN * s.pitch, (1.0,)
    ),
    "encoder_interpolation": _interpolation,
}
