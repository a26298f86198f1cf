"""The block `limits` of a stage file; what the loop makes of it stands in realtime/envelope.py."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from stagectl.units import Quantity

Positive = "(0, 1e6]"


class Limits(NamedTuple):
    """What no trajectory may exceed and no motion leave."""

    travel: Annotated[tuple[float, float], Quantity("rad | m", "[-1e6, 1e6]", "lowest and highest position")]
    speed: Annotated[float, Quantity("rad/s | m/s", Positive, "largest speed")]
    acceleration: Annotated[float, Quantity("rad/s^2 | m/s^2", Positive, "largest acceleration")]
    following_error: Annotated[float, Quantity("rad | m", Positive, "largest error before a quick stop")]
    following_error_at_rest: Annotated[
        float | None, Quantity("rad | m", Positive, "the same at standstill, from where it ramps up to limits.speed")
    ] = None
    following_error_time: Annotated[
        float, Quantity("s", "[0, 10]", "time that it may be beyond; twice the limit stops at once")
    ] = 0.0
    deceleration: Annotated[
        float | None, Quantity("rad/s^2 | m/s^2", Positive, "with which the axis can be braked; else from the model")
    ] = None
    current: Annotated[float | None, Quantity("A", "(0, 1e4]", "largest measured current; else 1.5 times drive's")] = (
        None
    )
    continuous_current: Annotated[float | None, Quantity("A", "(0, 1e4]", "current that may flow forever (I2t)")] = None
    thermal_time: Annotated[float, Quantity("s", "(0, 1e4]", "time constant of the motor's warming (I2t)")] = 10.0
    encoder_jump: Annotated[
        float | None, Quantity("rad | m", Positive, "change that no motion explains; else a quarter of following_error")
    ] = None
    encoder_freeze: Annotated[
        float | None, Quantity("rad | m", Positive, "way without any new count; else half of following_error")
    ] = None
