"""Effects between the true position and the logged one."""

from __future__ import annotations

from stagectl.gap.effects import grids
from stagectl.gap.effects.effect import Parameters, ParametersOf, Scales
from stagectl.gap.effects.stage_changes import harmonic_parameters

_PER_TURN, _PER_PERIOD = grids.ENCODER_ERRORS


def _interpolation(s: Scales) -> Parameters | None:
    orders = (s.periods,) if s.periods else s.orders.get("encoder_interpolation", ())
    if not orders:
        return None
    return harmonic_parameters("encoder.interpolation", "rad | m", _PER_PERIOD * s.pitch, orders)


PARAMETERS: dict[str, ParametersOf] = {
    "encoder_eccentricity": lambda s: harmonic_parameters(
        "encoder.eccentricity", "rad | m", _PER_TURN * s.pitch, (1.0,)
    ),
    "encoder_interpolation": _interpolation,
}
