"""Effects between the command and the motor's current, and in what the drive reports of it."""

from __future__ import annotations

from stagectl.gap.effects.library import Amplitude, Definition, Scales, Shape, Values, added, put
from stagectl.kernels.stage import Stage

# Of the largest current (voltage) in the logs, by which a limit lies below it.  Where the drive did run into one, the
# largest that it gave is the limit, but for the noise of the measurement.
DEPTHS = (0.01, 0.05, 0.25)


def definitions(s: Scales) -> list[Definition]:
    """Drive effects for a machine of these sizes."""
    found = [
        Definition(
            "dead_time",
            "drive",
            "frequency",
            (Amplitude("time", "s", (0.0006,), 0.0, 4.0 * s.dt),),
            (),
            added(time="drive.dead_time"),
        ),
        Definition(
            "current_loop",
            "drive",
            "frequency",
            (Amplitude("lag", "s", (0.0002,), -0.001, 0.005),),
            (),
            _slower,
        ),
        Definition(
            "current_gain",
            "drive",
            "current",
            (Amplitude("size", "", (0.02,), -0.2, 0.2),),
            (),
            added(size="drive.telemetry.gain"),
        ),
        Definition(
            "current_offset",
            "drive",
            "none",
            (Amplitude("current", "A", (0.03,)),),
            (Shape("reported", "", (0.0, 1.0), False),),
            _offset,
        ),
        Definition(
            "current_saturation",
            "drive",
            "current",
            (Amplitude("depth", "", DEPTHS, 0.0, 0.9),),
            (Shape("continuous", "", (0.0, 1.0), False),),
            lambda p, v: _saturated(p, v, s),
        ),
    ]
    if s.voltage > 0.0:
        found.append(
            Definition(
                "voltage_saturation",
                "drive",
                "current",
                (Amplitude("depth", "", DEPTHS, 0.0, 0.9),),
                (),
                lambda p, v: put(p, "drive.voltage_limit", s.voltage * (1.0 - v["depth"])),
            )
        )
    return found


def _slower(p: Stage, v: Values) -> Stage:
    return put(p, "drive.current_lag", max(p.drive.current_lag + v["lag"], 0.0))


def _offset(p: Stage, v: Values) -> Stage:
    place = "drive.telemetry.offset" if v["reported"] else "drive.offset"
    return added(current=place)(p, v)


def _saturated(p: Stage, v: Values, s: Scales) -> Stage:
    limit = s.current * (1.0 - v["depth"])
    if v["depth"] <= 0.0:
        return p
    return put(p, "drive.continuous_current" if v["continuous"] else "drive.current_limit", limit)
