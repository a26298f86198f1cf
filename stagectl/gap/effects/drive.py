"""Effects between the command and the motor's current, and in the current that the drive reports."""

from __future__ import annotations

from stagectl.gap.effects import grids
from stagectl.gap.effects.effect import (
    ACCELERATION,
    CURRENT,
    DIRECTION,
    DRIVE,
    FREQUENCY,
    NONE,
    POSITION,
    SPEED,
    TIME,
    Amplitude,
    Data,
    Effect,
    Parameters,
    Scales,
    Shape,
    Values,
)
from stagectl.gap.effects.stage_changes import added, put
from stagectl.kernels.stage import Stage


def _dead_time(s: Scales) -> Parameters:
    return Parameters((Amplitude("time", "s", (0.0006,), 0.0, 4.0 * s.dt),), (), added(time="drive.dead_time"))


def _current_loop(_: Scales) -> Parameters:
    return Parameters((Amplitude("lag", "s", (0.0002,), -0.001, 0.005),), (), _slower)


def _slower(p: Stage, v: Values) -> Stage:
    return put(p, "drive.current_lag", max(p.drive.current_lag + v["lag"], 0.0))


def _gain(_: Scales) -> Parameters:
    return Parameters((Amplitude("size", "", (0.02,), -0.2, 0.2),), (), added(size="drive.telemetry.gain"))


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

EFFECTS = (
    Effect(
        "dead_time",
        "dead time",
        "drive",
        DRIVE,
        FREQUENCY,
        seen_over=(FREQUENCY,),
        places=("drive.dead_time",),
        experiments=("multisine", "resonance", "timestamps"),
        parameters=_dead_time,
        look_alikes={
            "jitter": Data.ALL,
            "current_loop": Data.IN_OPERATION,
            "time_shift": Data.IN_OPERATION | Data.FEW_MOTIONS,
        },
        kin=("delay",),
    ),
    Effect(
        "jitter",
        "jitter",
        "drive",
        DRIVE,
        FREQUENCY,
        seen_over=(FREQUENCY, TIME),
        places=("drive.jitter",),
        experiments=("timestamps",),
        look_alikes={"dead_time": Data.ALL, "time_shift": Data.FEW_MOTIONS},
    ),
    Effect(
        "current_loop",
        "current-loop lag",
        "drive",
        DRIVE,
        FREQUENCY,
        seen_over=(FREQUENCY,),
        places=("drive.current_lag",),
        experiments=("multisine", "resonance", "object dictionary"),
        parameters=_current_loop,
        look_alikes={"dead_time": Data.IN_OPERATION},
        kin=("delay",),
    ),
    Effect(
        "current_quantisation",
        "current quantisation",
        "drive",
        DRIVE,
        CURRENT,
        seen_over=(CURRENT, FREQUENCY, TIME),
        places=("drive.current_quantum",),
        experiments=("micro", "creep", "micro-slow", "dwells-short", "rest", "object dictionary"),
        in_stage_file=False,
    ),
    Effect(
        "current_gain",
        "gain of the reported current",
        "drive",
        DRIVE,
        CURRENT,
        seen_over=(CURRENT, DIRECTION, ACCELERATION, SPEED),
        places=("drive.telemetry.gain",),
        experiments=("added mass", "hanging weight"),
        parameters=_gain,
        look_alikes={"force_constant": Data.ALL},
        kin=("current limit",),
    ),
    Effect(
        "current_offset",
        "current offset",
        "drive",
        DRIVE,
        NONE,
        seen_over=(NONE, CURRENT, DIRECTION, POSITION),
        places=("drive.telemetry.offset", "drive.offset"),
        experiments=("rest", "power-off reading"),
        parameters=_offset,
        look_alikes={
            "bias": Data.WITHOUT_CURRENT | Data.IN_OPERATION | Data.FEW_MOTIONS,
            "coulomb_asymmetry": Data.FEW_MOTIONS,
        },
    ),
    Effect(
        "current_saturation",
        "current saturation",
        "drive",
        DRIVE,
        CURRENT,
        seen_over=(CURRENT,),
        places=("drive.continuous_current", "drive.current_limit"),
        experiments=("sine-strong", "strong-sine", "fast-cruise", "object dictionary", "status word"),
        parameters=_current_limit,
        kin=("current limit",),
    ),
    Effect(
        "voltage_saturation",
        "voltage saturation",
        "drive",
        DRIVE,
        CURRENT,
        seen_over=(CURRENT, SPEED),
        places=("drive.voltage_limit",),
        experiments=("sine-strong", "stairs-fast", "strong-sine", "fast-cruise", "status word"),
        parameters=_voltage_limit,
        kin=("current limit",),
    ),
)
