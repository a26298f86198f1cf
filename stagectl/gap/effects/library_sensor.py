"""Effects between the true position and the logged one."""

from __future__ import annotations

from stagectl.gap.effects.library import Amplitude, Definition, Scales, Shape, harmonic

ARCSECOND = 7.7e-7  # of a pitch


def definitions(s: Scales) -> list[Definition]:
    """Encoder effects for a machine of these sizes."""
    coarse, fine = 30.0 * ARCSECOND * s.pitch, 3.0 * ARCSECOND * s.pitch
    found = [
        Definition(
            "encoder_eccentricity",
            "sensor",
            "position_mod_pitch",
            (Amplitude("sine", "rad | m", (coarse,)), Amplitude("cosine", "rad | m", (coarse,))),
            (Shape("order", "", (1.0,), False),),
            harmonic("encoder.eccentricity"),
        )
    ]
    orders = (s.periods,) if s.periods else s.orders.get("encoder_interpolation", ())
    if orders:
        found.append(
            Definition(
                "encoder_interpolation",
                "sensor",
                "position_mod_pitch",
                (Amplitude("sine", "rad | m", (fine,)), Amplitude("cosine", "rad | m", (fine,))),
                (Shape("order", "", orders, False),),
                harmonic("encoder.interpolation"),
            )
        )
    return found
