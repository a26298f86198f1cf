"""Speed and acceleration of a move, as somebody has typed them: what no move may have, and what is a slip of a unit."""

from __future__ import annotations

from stagectl.config.stage_file import Setup
from stagectl.motion_limits import LIMIT_SLACK
from stagectl.number_format import length
from stagectl.problem import Problem, ProblemKind
from stagectl.service.limits import PLANNED_ROWS
from stagectl.trajectories import SCurve
from stagectl.trajectories.profiles import unreached
from stagectl.units import StageError

LEAST = 1e-9  # m/s | m/s^2, rad/s | rad/s^2 of travel: the least that a profile is computed with


class ServiceError(StageError):
    """An order that the service cannot carry out: why, and what to do instead."""


def check_pace(axis: str, setup: Setup, speed: float | None, acceleration: float | None) -> None:
    """Raise ServiceError for a speed or an acceleration (m | rad of travel) that no move of the `axis` may have."""
    limits, scale, travel = setup.file.limits, setup.file.axis.travel_per_unit, setup.file.axis.travel_unit
    for name, value, most, per in (
        ("speed", speed, limits.speed * scale, "s"),
        ("acceleration", acceleration, limits.acceleration * scale, "s^2"),
    ):
        unit = f"{travel}/{per}"
        if value is not None and not LEAST <= value <= most * (1.0 + LIMIT_SLACK):
            interval, shown = f"[{LEAST:g}, {most:g}]", f"[{length(LEAST, unit)}, {length(most, unit)}]"
            problem = Problem("", ProblemKind.RANGE, name, length(value, unit), unit, interval, admissible=shown)
            raise ServiceError(problem._replace(remedy=f"limits.{name} of {axis}"))


def check_time(axis: str, setup: Setup, move: SCurve, stated: tuple[bool, bool]) -> None:
    """Refuse a move that a speed, an acceleration or both, where they are `stated`, make absurdly slow: a slip.

    Raises ServiceError.
    """
    unit, longest, (paced, sloped) = setup.file.axis.travel_unit, PLANNED_ROWS * setup.dt, stated
    if paced and sloped and (words := unreached(move, unit)):
        raise ServiceError(f"{axis}: {words[0]}; nothing has moved")
    if move.duration <= longest or not (paced or sloped):
        return
    name = "speed" if paced else "acceleration"
    value = length(move.velocity, f"{unit}/s") if paced else length(move.acceleration, f"{unit}/s^2")
    reason = f"the move takes {move.duration:.3g} s, and {longest:g} s is the longest"
    raise ServiceError(Problem(reason, ProblemKind.LIMIT, name, value, remedy="nothing has moved; check the unit"))
