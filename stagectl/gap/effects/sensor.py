"""Effects between the true position and the logged one."""

from __future__ import annotations

from stagectl.gap.effects import grids
from stagectl.gap.effects.effect import FREQUENCY, POSITION, SENSOR, TURN, Data, Effect, Parameters, Scales
from stagectl.gap.effects.stage_changes import harmonic_parameters

_PER_TURN, _PER_PERIOD = grids.ENCODER_ERRORS


def _eccentricity(s: Scales) -> Parameters:
    return harmonic_parameters("encoder.eccentricity", "rad | m", _PER_TURN * s.pitch, (1.0,))


def _interpolation(s: Scales) -> Parameters | None:
    orders = (s.periods,) if s.periods else s.orders.get("encoder_interpolation", ())
    if not orders:
        return None
    return harmonic_parameters("encoder.interpolation", "rad | m", _PER_PERIOD * s.pitch, orders)


EFFECTS = (
    Effect(
        "encoder_eccentricity",
        "encoder eccentricity",
        "encoder and record",
        SENSOR,
        TURN,
        seen_over=(TURN,),
        places=("encoder.eccentricity",),
        experiments=("scan", "constant-speed-long", "constant-speed-fast", "scans-at-two-speeds", "second sensor"),
        parameters=_eccentricity,
        look_alikes={"cogging": Data.FEW_MOTIONS},
        kin=("angle",),
    ),
    Effect(
        "encoder_interpolation",
        "encoder interpolation error",
        "encoder and record",
        SENSOR,
        TURN,
        seen_over=(TURN, POSITION, FREQUENCY),
        places=("encoder.interpolation",),
        experiments=("micro", "creep", "micro-slow", "second sensor"),
        parameters=_interpolation,
    ),
)
