"""Smooth functions of one coordinate, brought to the ground of the residuals: what an unknown gap is tried with.

A function is a sum of hats over the coordinate, of sines over the pitch.  Each may work even or odd in the direction of
motion, or with the acceleration: a friction over the position is the position's odd part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from stagectl.gap.effects.effect import Scales
from stagectl.gap.inference import time_localisation
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, whitening
from stagectl.gap.residuals.gram_matrices import Products
from stagectl.gap.residuals.half_strokes import Run, without_drift_at_rest
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.residuals.thresholds import KEPT
from stagectl.parallel import in_parallel

WINDOW = 0.012  # s, over which velocity and acceleration are taken
STILL = 1e-3  # of the largest speed: below, there is no direction
BACK = 0.1  # of the rolling zone: a shorter way back is no reversal, as in the table of the stage model
ORDERS = 12  # of the pitch, beside those that stand out
EVEN, ODD, INERTIAL, LOOP = "even", "odd", "inertial", "loop"
ALL = (EVEN, ODD, INERTIAL, LOOP)  # EVEN + ODD: any function of coordinate and direction
TIME = "time"
KNOTS = 6  # over the session's clock: a step is between two of them
SIDE, VELOCITY = (tuple(f"{TIME}.{name}.{k}" for k in range(KNOTS)) for name in ("side", "velocity"))
CLOCK = (*SIDE, *VELOCITY)  # columns over the session's clock
OF_A_DRIVE = ("current", "speed", "acceleration")  # coordinates that a current may depend on


class Motion(NamedTuple):
    """The course of one run at its kept rows, (m,) each."""

    position: Array  # rad | m
    velocity: Array  # rad/s | m/s
    acceleration: Array  # rad/s^2 | m/s^2
    since: Array  # rad | m, from the last reversal, without sign
    current: Array  # A, of the command


class Smoother(NamedTuple):
    """Functions of one coordinate."""

    coordinate: str
    place: Callable[[Motion], Array]  # the coordinate of a run
    basis: Callable[[Array], Array]  # (n,) to (k, n)
    low: float  # of the coordinate
    high: float


def motion(run: Run, size: Scales) -> Motion:
    """The course of `run` along the mean of its repeats."""
    position, dt = run.mean.rows[:, 1], run.mean.dt
    window = min(2 * max(round(0.5 * WINDOW / dt), 2) + 1, len(position) - 1 + len(position) % 2)
    velocity, acceleration = (savgol_filter(position, window, 3, deriv=k, delta=dt) for k in (1, 2))
    since = since_reversal(position, BACK * size.length)
    course = (position, velocity, acceleration, since, run.mean.rows[:, 0])
    return Motion(*(one[::KEPT] for one in course))


def since_reversal(position: Array, back: float) -> Array:
    """Distance (n,) from the last reversal; a turn counts once the way back exceeds `back` (rad | m)."""
    turned = furthest = float(position[0])
    side = 0.0
    found = np.empty(len(position))
    for k, x in enumerate(position.tolist()):
        ahead = x - furthest
        if ahead * side > 0.0:
            furthest = x
        elif abs(ahead) > back:
            turned = furthest if side else turned
            furthest, side = x, 1.0 if ahead > 0.0 else -1.0
        found[k] = abs(x - turned)
    return found


def hats(nodes: Array) -> Callable[[Array], Array]:
    """Triangles over `nodes` (k,), flat beyond the ends; together they are one."""
    each = np.eye(len(nodes))
    return lambda x: np.stack([np.interp(x, nodes, one) for one in each])


def waves(pitch: float, orders: Sequence[float]) -> Callable[[Array], Array]:
    """Sine and cosine of each order of the pitch."""

    def basis(x: Array) -> Array:
        angle = 2.0 * np.pi / pitch * np.multiply.outer(np.asarray(orders), x)
        return np.concatenate([np.sin(angle), np.cos(angle)])

    return basis


def smoothers(size: Scales, motions: Sequence[Motion]) -> list[Smoother]:
    """One for each coordinate of a motion, on grids that suit this machine's sizes; time has its own."""
    # Friction changes over decades of speed, and of the way since a reversal.
    speeds = np.concatenate([[0.0], np.geomspace(0.002, 1.0, 11)]) * size.speed
    ways = np.concatenate([[0.0], size.length * np.geomspace(0.03, 3.0, 10)])
    ways = np.concatenate([ways, np.geomspace(6.0 * size.length, max(size.stroke, 12.0 * size.length), 4)])
    largest = float(np.percentile(np.concatenate([np.abs(one.acceleration) for one in motions]), 99.9))
    places = np.linspace(size.centre - size.stroke, size.centre + size.stroke, 25)
    accelerations, currents = np.linspace(-largest, largest, 11), np.linspace(-size.current, size.current, 15)
    orders = sorted({*range(1, ORDERS + 1), *(n for n in size.orders.get("cogging", ()) if n > ORDERS)})
    return [
        _over("speed", lambda m: np.abs(m.velocity), speeds),
        _over("acceleration", lambda m: m.acceleration, accelerations),
        Smoother("direction", lambda m: m.velocity, lambda x: np.ones((1, len(x))), -size.speed, size.speed),
        _over("displacement_since_reversal", lambda m: m.since, ways),
        _over("position", lambda m: m.position, places),
        Smoother("position_mod_pitch", lambda m: m.position, waves(size.pitch, orders), 0.0, size.pitch),
        _over("current", lambda m: m.current, currents),
    ]


def _over(name: str, place: Callable[[Motion], Array], nodes: Array) -> Smoother:
    return Smoother(name, place, hats(nodes), float(nodes[0]), float(nodes[-1]))


def factor(part: str, m: Motion, size: Scales) -> Array:
    """(n,) what a function is multiplied by; LOOP: which way the speed changes, with the sign of the velocity."""
    side = np.where(np.abs(m.velocity) > STILL * size.speed, np.sign(m.velocity), 0.0)
    if part == EVEN:
        return np.ones(len(side))
    if part == ODD:
        return side
    scale = float(np.abs(m.acceleration).max(initial=0.0)) or 1.0
    return m.acceleration / scale if part == INERTIAL else np.tanh(5.0 * m.acceleration / scale)


class Ground(NamedTuple):
    """What brings an effort along a path to the ground of the residuals."""

    model: TrackedModel
    noise: whitening.Whitener

    def bring(self, run: Run) -> Callable[[Array, bool], list[Array]]:
        """Whitened (m, 2) of signals (k, m) at the kept rows of `run`: as an effort (N m | N), and as a current (A)."""
        dt, count = run.mean.dt, len(run.weight)
        lines = time_localisation.lines_of(count, dt * KEPT)
        effort, current = whitening.gains(self.noise, lines, dt)
        answer = time_localisation.tracking(self.model, lines, dt) * effort

        def columns(signals: Array, drive: bool) -> list[Array]:
            efforts = time_localisation.passed(signals, answer)
            currents = time_localisation.passed(signals, current) if drive else np.zeros_like(signals)
            # Many, and smooth: half the digits do.
            return [
                without_drift_at_rest(both, run.rests).astype(np.float32)
                for both in np.stack([efforts, currents], axis=-1)
            ]

        return columns


def names(one: Smoother, part: str) -> list[str]:
    """Names of the columns of one part."""
    count = len(one.basis(np.zeros(1)))
    return [f"{one.coordinate}.{part}.{k}" for k in range(count)]


def columns_of(
    ground: Ground, runs: Sequence[Run], of: tuple[Sequence[Motion], Scales], parts: Mapping[str, Sequence[Smoother]]
) -> list[dict[str, list[Array]]]:
    """Columns of each run for the smoothers of each part, over all cores."""
    motions, size = of

    def found(pair: tuple[Run, Motion]) -> dict[str, list[Array]]:
        run, m = pair
        columns: dict[str, list[Array]] = {}
        bring = ground.bring(run)
        for part, chosen in parts.items():
            side = factor(part, m, size)
            for one in chosen:
                signals, drive = one.basis(one.place(m)) * side, one.coordinate in OF_A_DRIVE
                columns |= {name: [x] for name, x in zip(names(one, part), bring(signals, drive), strict=True)}
        return columns

    return in_parallel(found, list(zip(runs, motions, strict=True)))


class Functions(NamedTuple):
    """All functions of single coordinates on one session's data."""

    size: Scales
    motions: list[Motion]
    tried: list[Smoother]
    known: Products  # what moves beside any function, and the null ensemble
    products: Mapping[str, Products]  # by coordinate: that, and the columns even and odd
    clock: Products | None  # the same over the session's clock; None where nothing was repeated


def functions(ground: Ground, runs: Sequence[Run], size: Scales, known: Products) -> Functions:
    """All smoothers along the runs' motions, with their columns multiplied with those that are `known`."""
    motions = [motion(run, size) for run in runs]
    tried = smoothers(size, motions)
    columns = columns_of(ground, runs, (motions, size), {EVEN: tried, ODD: tried})
    products = {}
    for one in tried:
        own = [*names(one, EVEN), *names(one, ODD)]
        products[one.coordinate] = gram_matrices.with_columns(
            known, [{name: found[name] for name in own} for found in columns]
        )
    repeated = any(len(run.logs) > 1 for run in runs)
    clock = gram_matrices.with_columns(known, _clocked(ground, runs, motions)) if repeated else None
    return Functions(size, motions, tried, known, products, clock)


def _clocked(ground: Ground, runs: Sequence[Run], motions: Sequence[Motion]) -> list[dict[str, list[Array]]]:
    """Time as a coordinate: what friction and damping change by from repeat to repeat of one experiment.

    Only differences between repeats count: over an experiment's own duration time is what the experiment is.
    """
    course, found = hats(knots(runs)), []
    for run, m in zip(runs, motions, strict=True):
        each = course(np.array([log.start for log in run.logs]))
        columns: dict[str, list[Array]] = {}
        bring = ground.bring(run)
        for names_, signal in ((SIDE, np.sign(m.velocity)), (VELOCITY, m.velocity)):
            column = bring(signal[None], False)[0]
            for name, one in zip(names_, each, strict=True):
                columns[name] = [column * x for x in (one - one.mean()).tolist()]
        found.append(columns)
    return found


def knots(runs: Sequence[Run]) -> Array:
    """(k,) s of the session's clock between which friction may change in its own way."""
    starts = [log.start for run in runs for log in run.logs]
    return np.linspace(min(starts), max(max(starts), min(starts) + 1.0), KNOTS)
