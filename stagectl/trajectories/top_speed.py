"""Moves that stay far below their own velocity: a unit is mistaken there more often than it is meant."""

from __future__ import annotations

from stagectl.number_format import length
from stagectl.trajectories.profiles import SCurve, Trapezoid, top_speed

_FAR_BELOW = 0.2  # of the velocity; chosen: a short move that is a triangle comes closer


def unreached(motion: object, unit: str) -> list[str]:
    """A note on each such move in a trajectory; `unit` is that of its travel."""
    if isinstance(motion, Trapezoid | SCurve):
        top = top_speed(motion)
        return [_words(motion, top, f"{unit}/s")] if top < _FAR_BELOW * motion.velocity else []
    return list(dict.fromkeys(words for part in getattr(motion, "parts", ()) for words in unreached(part, unit)))


def _words(move: Trapezoid | SCurve, top: float, unit: str) -> str:
    others = "acceleration" if isinstance(move, Trapezoid) else "acceleration and jerk"
    return (
        f"velocity = {length(move.velocity, unit)} is never reached, the top is {length(top, unit)}, and all of it "
        f"takes {move.duration:.3g} s: check the units of distance, velocity, {others}"
    )
