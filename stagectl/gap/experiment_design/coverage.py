"""What the logs of a session never showed, and the experiment of the recommended battery that shows it."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.experiment_design import battery, stage_scale, thresholds
from stagectl.gap.experiment_design.experiment import Experiment, number
from stagectl.gap.experiment_design.operating_range import OperatingRange, path_of
from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.residuals.half_strokes import standstills
from stagectl.gap.residuals.thresholds import SHORTEST_REST


class ReferenceMotion(NamedTuple):
    """The motion of one log, by its reference where it is known."""

    position: Array  # (n,) rad | m
    velocity: Array  # (n,) rad/s | m/s
    injected: bool
    dt: float  # s


def advised(session: Session, within: OperatingRange) -> tuple[Experiment, str] | None:
    """The experiment of the battery for the first of `uncovered`, with its words; None where all was shown."""
    missing = uncovered(session)
    if not missing:
        return None
    words, name = missing[0]
    by_name = {experiment.name: experiment for experiment in battery.battery_for(within.scale)}
    return by_name[name], f"{words[0].upper()}{words[1:]}."


def uncovered(session: Session) -> list[tuple[str, str]]:
    """What no log to find effects from has shown, the most informative first: in words, and what would show it."""
    motions = [_motion(log, session.dt) for log in session.logs if not log.held_out]
    checked = [(missing(session, motions), experiment) for missing, experiment in CHECKS]
    return [(words, name) for words, name in checked if words]


def _motion(log: Log, dt: float) -> ReferenceMotion:
    path = path_of(log)
    window = max(round(thresholds.SPEED_WINDOW / dt), 1)
    velocity = np.zeros(len(path))
    velocity[: len(path) - window] = (path[window:] - path[:-window]) / (window * dt)
    injected = log.injection is not None and bool(np.any(log.injection))
    return ReferenceMotion(path, velocity, injected, dt)


def held_speeds(motion: ReferenceMotion, slowest: float) -> list[float]:
    """Velocities, with their signs, above `slowest` that were held for `thresholds.HELD_TIME` at least."""
    rows, speeds = max(round(thresholds.HELD_TIME / motion.dt), 1), []
    for begin in range(0, len(motion.velocity) - rows, rows // 2 or 1):
        part = motion.velocity[begin : begin + rows]
        mean = float(part.mean())
        if abs(mean) > slowest and float(np.ptp(part)) < thresholds.HELD_SPREAD * abs(mean):
            speeds.append(mean)
    return speeds


def distinct(values: Sequence[float], ratio: float) -> int:
    """How many of these differ by at least `ratio` from the next."""
    count, last = 0, 0.0
    for value in sorted(values):
        if value > last * ratio:
            count, last = count + 1, value
    return count


def _top_speed(motions: list[ReferenceMotion]) -> float:
    return max((float(np.abs(motion.velocity).max()) for motion in motions), default=0.0)


def _speeds(session: Session, motions: list[ReferenceMotion]) -> str:
    slowest = thresholds.SLOWEST_MOVING * _top_speed(motions)
    speeds = [speed for motion in motions for speed in held_speeds(motion, slowest)]
    up, down = (
        distinct([abs(v) for v in speeds if v * sign > 0.0], thresholds.DISTINCT_SPEEDS) for sign in (1.0, -1.0)
    )
    most = max(up, down)
    if min(up, down) >= thresholds.SPEED_COUNT:
        return ""
    if most >= thresholds.SPEED_COUNT:
        return (
            "speeds were held in one direction only: a difference between the directions cannot be separated from a "
            "bias"
        )
    return (
        f"the speed stayed nearly constant for {thresholds.HELD_TIME:g} s at {most or 'no'} value"
        f"{'s' if most > 1 else ''}; with fewer than {thresholds.SPEED_COUNT} a curvature of viscous friction cannot "
        "be separated from a Stribeck rise"
    )


def _dwells(session: Session, motions: list[ReferenceMotion]) -> str:
    rests = [
        (end - begin) * motion.dt
        for motion in motions
        for begin, end in standstills(motion.position, motion.dt)
        if begin > 0 and end < len(motion.position) - round(2.0 * thresholds.SPEED_WINDOW / motion.dt)
    ]
    if distinct([rest for rest in rests if rest > 2.0 * SHORTEST_REST], thresholds.DISTINCT_DWELLS) >= 2:
        return ""
    return "no motion follows standstills of different lengths: friction that grows at rest does not show"


def _reversals(session: Session, motions: list[ReferenceMotion]) -> str:
    length = stage_scale.visible_presliding(session.stage)
    if any(0.0 < shortest_stroke(motion) <= length for motion in motions) or length == 0.0:
        return ""
    per_unit, unit = session.travel_per_unit, session.travel_unit
    return (
        f"no stroke stays within presliding ({number(length * per_unit, unit)}): backlash and the shape of rolling "
        "friction cannot be separated"
    )


def shortest_stroke(motion: ReferenceMotion) -> float:
    """Shortest stroke between two reversals; 0 without any."""
    step = np.diff(motion.position)
    moving = np.flatnonzero(np.abs(step) > 1e-9 * max(float(np.abs(step).max(initial=0.0)), 1e-300))
    turns = moving[1:][np.diff(np.sign(step[moving])) != 0.0]
    return float(np.abs(np.diff(motion.position[turns])).min(initial=math.inf)) if len(turns) > 1 else 0.0


def _scanned(session: Session, motions: list[ReferenceMotion]) -> str:
    ends = [(float(motion.position.min()), float(motion.position.max())) for motion in motions]
    travel = max((high for _, high in ends), default=0.0) - min((low for low, _ in ends), default=0.0)
    slow = thresholds.SLOW_SCAN * _top_speed(motions)
    if any(_scans(motion, slow, travel) for motion in motions):
        return ""
    return "the stroke was not scanned slowly: effects of the place cannot be separated from effects of the speed"


def _scans(motion: ReferenceMotion, slow: float, travel: float) -> bool:
    speed, slowest = np.abs(motion.velocity), thresholds.SLOWEST_MOVING * slow
    there = motion.position[(speed < slow) & (speed > slowest)]
    wide = len(there) > 0 and float(np.ptp(there)) > thresholds.WIDE_SCAN * travel
    return wide and len(held_speeds(motion, slowest)) > 1


def _frequencies(session: Session, motions: list[ReferenceMotion]) -> str:
    if any(motion.injected for motion in motions):
        return ""
    return "no current was injected: resonances, delays and the current loop lie above what the motions excite"


# What logs may never show, each in words that are empty where it was shown, and the experiment of the battery for it.
CHECKS: tuple[tuple[Callable[[Session, list[ReferenceMotion]], str], str], ...] = (
    (_speeds, "stairs"),
    (_dwells, "steps-large"),
    (_reversals, "micro-within"),
    (_frequencies, "multisine-middle"),
    (_scanned, "scan"),
)
