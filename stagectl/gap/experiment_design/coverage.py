"""What the logs of a session never showed, and the experiment of the recommended battery that shows it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from stagectl.gap.experiment_design import battery, scale
from stagectl.gap.experiment_design.experiment import Experiment
from stagectl.gap.experiment_design.operating_range import WINDOW, Room
from stagectl.gap.experiment_design.trajectory_text import number
from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.residuals.half_strokes import standstills
from stagectl.gap.residuals.thresholds import SHORTEST_REST

SPEEDS = 5  # below, curvature of viscous friction and a Stribeck rise look alike
HELD = 0.1  # s for which a speed counts as held
EVEN = 0.05  # share by which it may change meanwhile
APART = 1.25  # ratio of two speeds that are not one
DWELLS = 2.0  # ratio of two dwells that are not one
SLOW = 0.25  # of the largest speed: a scan is slower
WIDE = 0.8  # of the travel: a scan covers it


class Way(NamedTuple):
    """The motion of one log, by its reference where it is known."""

    position: Array  # (n,) rad | m
    velocity: Array  # (n,) rad/s | m/s
    injected: bool
    dt: float  # s


class Check(NamedTuple):
    """Something that logs may never show."""

    lacking: Callable[[Session, list[Way]], str]  # in words; empty where it was shown
    experiment: str  # of the battery


def uncovered(session: Session) -> tuple[str, ...]:
    """What no log to find effects from has shown, in words, the most telling first."""
    return tuple(words for words, _ in _gaps(session))


def advised(session: Session, space: Room) -> tuple[Experiment, str] | None:
    """The experiment of the battery for the first of `uncovered`, which is told with it; None where all was shown."""
    gaps = _gaps(session)
    if not gaps:
        return None
    words, name = gaps[0]
    return next(one for one in battery.made(space.scale) if one.name == name), f"{words[0].upper()}{words[1:]}."


def _gaps(session: Session) -> list[tuple[str, str]]:
    ways = [_way(log, session.dt) for log in session.logs if not log.held_out]
    found = [(check.lacking(session, ways), check.experiment) for check in CHECKS]
    return [(words, name) for words, name in found if words]


def _way(log: Log, dt: float) -> Way:
    path = log.position if log.reference is None else log.reference
    window = max(round(WINDOW / dt), 1)
    velocity = np.zeros(len(path))
    velocity[: len(path) - window] = (path[window:] - path[:-window]) / (window * dt)
    injected = log.injection is not None and bool(np.any(log.injection))
    return Way(path, velocity, injected, dt)


def held(way: Way, slowest: float) -> list[float]:
    """Velocities, with their signs, above `slowest` that were held for `HELD` at least."""
    rows, found = max(round(HELD / way.dt), 1), []
    for begin in range(0, len(way.velocity) - rows, rows // 2 or 1):
        part = way.velocity[begin : begin + rows]
        mean = float(part.mean())
        if abs(mean) > slowest and float(np.ptp(part)) < EVEN * abs(mean):
            found.append(mean)
    return found


def _distinct(values: list[float], ratio: float) -> int:
    """How many of these differ by at least `ratio` from the next."""
    count, last = 0, 0.0
    for one in sorted(values):
        if one > last * ratio:
            count, last = count + 1, one
    return count


def _top(ways: list[Way]) -> float:
    return max((float(np.abs(way.velocity).max()) for way in ways), default=0.0)


def _speeds(session: Session, ways: list[Way]) -> str:
    both = [one for way in ways for one in held(way, 1e-3 * _top(ways))]
    up, down = (_distinct([abs(one) for one in both if one * sign > 0.0], APART) for sign in (1.0, -1.0))
    if min(up, down) >= SPEEDS:
        return ""
    if max(up, down) >= SPEEDS:
        return "speeds were held in one direction only: what differs between the directions cannot be told from bias"
    return (
        f"{max(up, down) or 'no'} speed{'s were' if max(up, down) != 1 else ' was'} held, and curvature of viscous "
        f"friction is not told from a Stribeck rise below {SPEEDS}"
    )


def _dwells(session: Session, ways: list[Way]) -> str:
    rests = [
        (end - begin) * way.dt
        for way in ways
        for begin, end in standstills(way.position, way.dt)
        if begin > 0 and end < len(way.position) - round(2.0 * WINDOW / way.dt)
    ]
    if _distinct([one for one in rests if one > 2.0 * SHORTEST_REST], DWELLS) >= 2:
        return ""
    return "no motion follows standstills of different lengths: friction that grows at rest is not seen"


def _reversals(session: Session, ways: list[Way]) -> str:
    length = max(scale.presliding(session.stage.friction), scale.COARSEST * session.stage.encoder.step)
    if any(0.0 < _shortest(way) <= length for way in ways) or length == 0.0:
        return ""
    per, unit = session.travel_per_unit, session.travel_unit
    return (
        f"no stroke stays within presliding ({number(length * per, unit)}): backlash and the shape of rolling "
        "friction are not told apart"
    )


def _shortest(way: Way) -> float:
    """Shortest stroke between two reversals; 0 without any."""
    step = np.diff(way.position)
    moving = np.flatnonzero(np.abs(step) > 1e-9 * max(float(np.abs(step).max(initial=0.0)), 1e-300))
    turns = moving[1:][np.diff(np.sign(step[moving])) != 0.0]
    return float(np.abs(np.diff(way.position[turns])).min(initial=math.inf)) if len(turns) > 1 else 0.0


def _scanned(session: Session, ways: list[Way]) -> str:
    travel = max((float(way.position.max()) for way in ways), default=0.0) - min(
        (float(way.position.min()) for way in ways), default=0.0
    )
    slow = SLOW * _top(ways)
    for way in ways:
        there = way.position[(np.abs(way.velocity) < slow) & (np.abs(way.velocity) > 1e-3 * slow)]
        if len(there) and float(np.ptp(there)) > WIDE * travel and len(held(way, 1e-3 * slow)) > 1:
            return ""
    return "the stroke was not scanned slowly: what depends on the place is not told from what depends on speed"


def _frequencies(session: Session, ways: list[Way]) -> str:
    if any(way.injected for way in ways):
        return ""
    return "no current was injected: resonances, delays and the current loop lie above what the motions excite"


CHECKS = (
    Check(_speeds, "stairs"),
    Check(_dwells, "steps-large"),
    Check(_reversals, "micro-within"),
    Check(_frequencies, "multisine-middle"),
    Check(_scanned, "scan"),
)
