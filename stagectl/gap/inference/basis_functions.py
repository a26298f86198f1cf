"""Smooth functions of one coordinate, filtered like the residuals: an unknown gap is tried with them.

A function is a sum of hats over the coordinate, or of sines over the pitch.  Each may work even or odd in the direction
of motion, or with the acceleration: friction that depends on the position is the odd part of the position.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from stagectl.gap.effects.effect import Scales
from stagectl.gap.inference import thresholds
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, tracker_response, whitening
from stagectl.gap.residuals.gram_matrices import Columns, Products
from stagectl.gap.residuals.half_strokes import Run, without_drift_at_rest
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.residuals.thresholds import KEPT
from stagectl.parallel import in_parallel

EVEN, ODD, INERTIAL, LOOP = "even", "odd", "inertial", "loop"
ALL = (EVEN, ODD, INERTIAL, LOOP)  # EVEN + ODD: any function of coordinate and direction
TIME = "time"
SIDE, VELOCITY = (tuple(f"{TIME}.{name}.{k}" for k in range(thresholds.CLOCK_KNOTS)) for name in ("side", "velocity"))
CLOCK = (*SIDE, *VELOCITY)  # columns over the session's clock
OF_A_DRIVE = ("current", "speed", "acceleration")  # coordinates that a current may depend on

Basis = Callable[[Array], Array]  # (n,) of a coordinate to (k, n)


class RunMotion(NamedTuple):
    """The motion of one run at its kept rows, (m,) each."""

    position: Array  # rad | m
    velocity: Array  # rad/s | m/s
    acceleration: Array  # rad/s^2 | m/s^2
    since: Array  # rad | m, from the last reversal, without sign
    current: Array  # A, of the command


class CoordinateBasis(NamedTuple):
    """Functions of one coordinate."""

    coordinate: str
    place: Callable[[RunMotion], Array]  # the coordinate of a run
    basis: Basis
    low: float  # of the coordinate
    high: float


class BasisColumns(NamedTuple):
    """All functions of single coordinates on one session's data."""

    filter: ResidualFilter
    runs: Sequence[Run]
    size: Scales
    motions: Sequence[RunMotion]  # of each run
    bases: Sequence[CoordinateBasis]
    known: Products  # what moves along with any function, and the null ensemble
    products: Mapping[str, Products]  # by coordinate: that, and the columns even and odd
    clock: Products | None  # the same over the session's clock; None where nothing was repeated


def functions(
    filtering: ResidualFilter, runs: Sequence[Run], size: Scales, known: Products, efforts: Sequence[Array]
) -> BasisColumns:
    """All bases along the motions of `runs`, with their columns multiplied with those that are `known`.

    `efforts` (m,) of each run are what the base leaves of the effort.
    """
    motions = [motion_of(run, size) for run in runs]
    bases = bases_of(size, motions, place_nodes(size, motions, efforts))
    empty = BasisColumns(filtering, runs, size, motions, bases, known, {}, None)
    columns = columns_of(empty, dict.fromkeys((EVEN, ODD), bases))
    products = {}
    for basis in bases:
        own = [*names(basis, EVEN), *names(basis, ODD)]
        of_basis = [{name: of_run[name] for name in own} for of_run in columns]
        products[basis.coordinate] = gram_matrices.with_columns(known, of_basis)
    repeated = any(len(run.logs) > 1 for run in runs)
    clock = gram_matrices.with_columns(known, _over_the_clock(filtering, runs, motions)) if repeated else None
    return empty._replace(products=products, clock=clock)


def motion_of(run: Run, size: Scales) -> RunMotion:
    """The motion of `run` along the mean of its repeats."""
    position, dt = run.mean.rows[:, 1], run.mean.dt
    window = min(2 * max(round(0.5 * thresholds.DERIVATIVE_WINDOW / dt), 2) + 1, len(position) - 1 + len(position) % 2)
    velocity, acceleration = (savgol_filter(position, window, 3, deriv=k, delta=dt) for k in (1, 2))
    since = since_reversal(position, thresholds.REVERSAL_SHARE * size.length)
    columns = (position, velocity, acceleration, since, run.mean.rows[:, 0])
    return RunMotion(*(column[::KEPT] for column in columns))


def since_reversal(position: Array, back: float) -> Array:
    """Distance (n,) from the last reversal; a turn counts once the way back exceeds `back` (rad | m)."""
    turned = furthest = float(position[0])
    side = 0.0
    distance = np.empty(len(position))
    for k, x in enumerate(position.tolist()):
        ahead = x - furthest
        if ahead * side > 0.0:
            furthest = x
        elif abs(ahead) > back:
            turned = furthest if side else turned
            furthest, side = x, 1.0 if ahead > 0.0 else -1.0
        distance[k] = abs(x - turned)
    return distance


def hats(nodes: Array) -> Basis:
    """Triangles over `nodes` (k,), flat beyond the ends; they sum to one."""
    identity = np.eye(len(nodes))
    return lambda x: np.stack([np.interp(x, nodes, hat) for hat in identity])


def waves(pitch: float, orders: Sequence[float]) -> Basis:
    """Sine and cosine of each order of the pitch."""

    def basis(x: Array) -> Array:
        angle = 2.0 * np.pi / pitch * np.multiply.outer(np.asarray(orders), x)
        return np.concatenate([np.sin(angle), np.cos(angle)])

    return basis


def place_nodes(size: Scales, motions: Sequence[RunMotion], efforts: Sequence[Array]) -> Array:
    """Nodes over the position: half of them evenly spaced, half where most of the `efforts` (m,) of each run is left.

    A damaged place is narrow.  Beside a reversal, what is left belongs to the friction and not to the place.
    """
    edges = np.linspace(size.centre - size.stroke, size.centre + size.stroke, thresholds.PLACES + 1)
    left = np.zeros(thresholds.PLACES)
    for motion, effort in zip(motions, efforts, strict=True):
        moved = motion.since > thresholds.WAY_FROM * size.length
        left += np.histogram(motion.position[moved], edges, weights=effort[moved] ** 2)[0]
    measure = 1.0 / thresholds.PLACES + left / max(float(left.sum()), 1e-300)
    course = np.concatenate([[0.0], np.cumsum(measure)])
    nodes: Array = np.interp(np.linspace(0.0, course[-1], thresholds.PLACE_NODES), course, edges)
    return nodes


def bases_of(size: Scales, motions: Sequence[RunMotion], over_place: Array) -> list[CoordinateBasis]:
    """One basis for each coordinate of a motion, on grids that suit this machine's sizes; time has its own.

    `over_place` (k,) are the nodes over the position.
    """
    speeds = np.concatenate([[0.0], np.geomspace(thresholds.SLOWEST_NODE, 1.0, thresholds.SPEED_NODES)]) * size.speed
    zone = np.concatenate(
        [[0.0], size.length * np.geomspace(thresholds.ZONE_FROM, thresholds.ZONE_TO, thresholds.ZONE_NODES)]
    )
    beyond = np.geomspace(
        thresholds.WAY_FROM * size.length, max(size.stroke, thresholds.WAY_TO * size.length), thresholds.WAY_NODES
    )
    measured = np.concatenate([np.abs(motion.acceleration) for motion in motions])
    largest = float(np.percentile(measured, thresholds.ACCELERATION_PERCENTILE))
    orders = sorted(
        {
            *range(1, thresholds.PITCH_ORDERS + 1),
            *(order for order in size.orders.get("cogging", ()) if order > thresholds.PITCH_ORDERS),
        }
    )
    current = _over("current", lambda m: m.current, np.linspace(-size.current, size.current, thresholds.CURRENT_NODES))
    return [
        _over("speed", lambda m: np.abs(m.velocity), speeds),
        _over("acceleration", lambda m: m.acceleration, np.linspace(-largest, largest, thresholds.ACCELERATION_NODES)),
        CoordinateBasis("direction", lambda m: m.velocity, lambda x: np.ones((1, len(x))), -size.speed, size.speed),
        _over("displacement_since_reversal", lambda m: m.since, np.concatenate([zone, beyond])),
        _over("position", lambda m: m.position, over_place),
        CoordinateBasis("position_mod_pitch", lambda m: m.position, waves(size.pitch, orders), 0.0, size.pitch),
        # Where one current is all that was logged, what a model leaves is a part of that very current.
        *([current] if size.commanded and size.measured else []),
    ]


def _over(name: str, place: Callable[[RunMotion], Array], nodes: Array) -> CoordinateBasis:
    return CoordinateBasis(name, place, hats(nodes), float(nodes[0]), float(nodes[-1]))


def factor(part: str, motion: RunMotion, size: Scales) -> Array:
    """Factor (n,) of a function; LOOP: which way the speed changes, with the sign of the velocity."""
    side = np.where(np.abs(motion.velocity) > thresholds.STANDSTILL_SPEED * size.speed, np.sign(motion.velocity), 0.0)
    if part == EVEN:
        return np.ones(len(side))
    if part == ODD:
        return side
    scale = float(np.abs(motion.acceleration).max(initial=0.0)) or 1.0
    return (
        motion.acceleration / scale
        if part == INERTIAL
        else np.tanh(thresholds.LOOP_SLOPE * motion.acceleration / scale)
    )


class ResidualFilter(NamedTuple):
    """Filters an effort along a path as the residuals are filtered."""

    model: TrackedModel
    noise: whitening.Whitener

    def columns(self, run: Run) -> Callable[[Array, bool], list[Array]]:
        """Whitened (m, 2) of signals (k, m) at the kept rows of `run`: as an effort (N m | N), and as a current (A)."""
        dt, count = run.mean.dt, len(run.weight)
        lines = tracker_response.lines_of(count, dt * KEPT)
        effort, current = whitening.gains(self.noise, lines, dt)
        response = tracker_response.tracking(self.model, lines, dt) * effort

        def columns(signals: Array, drive: bool) -> list[Array]:
            efforts = tracker_response.filtered(signals, response)
            currents = tracker_response.filtered(signals, current) if drive else np.zeros_like(signals)
            # There are many, and they are smooth: single precision is enough.
            return [
                without_drift_at_rest(both, run.rests).astype(np.float32)
                for both in np.stack([efforts, currents], axis=-1)
            ]

        return columns


def names(basis: CoordinateBasis, part: str) -> list[str]:
    """Names of the columns of one part."""
    count = len(basis.basis(np.zeros(1)))
    return [f"{basis.coordinate}.{part}.{k}" for k in range(count)]


def columns_of(p: BasisColumns, parts: Mapping[str, Sequence[CoordinateBasis]]) -> Columns:
    """Columns of each run of `p` for the bases of each part, over all cores."""

    def of(pair: tuple[Run, RunMotion]) -> dict[str, list[Array]]:
        run, motion = pair
        columns: dict[str, list[Array]] = {}
        filtered = p.filter.columns(run)
        for part, bases in parts.items():
            side = factor(part, motion, p.size)
            for basis in bases:
                signals = basis.basis(basis.place(motion)) * side
                whitened = filtered(signals, basis.coordinate in OF_A_DRIVE)
                columns |= {name: [column] for name, column in zip(names(basis, part), whitened, strict=True)}
        return columns

    return in_parallel(of, list(zip(p.runs, p.motions, strict=True)))


def _over_the_clock(filtering: ResidualFilter, runs: Sequence[Run], motions: Sequence[RunMotion]) -> Columns:
    """Time as a coordinate: what friction and damping change by from repeat to repeat of one experiment.

    Only differences between repeats count: within one repeat, time is confounded with the motion.
    """
    course = hats(knots(runs))
    columns = []
    for run, motion in zip(runs, motions, strict=True):
        weights = course(np.array([log.start for log in run.logs]))
        filtered = filtering.columns(run)
        of_run: dict[str, list[Array]] = {}
        for knot_names, signal in ((SIDE, np.sign(motion.velocity)), (VELOCITY, motion.velocity)):
            column = filtered(signal[None], False)[0]
            for name, hat in zip(knot_names, weights, strict=True):
                of_run[name] = [column * weight for weight in (hat - hat.mean()).tolist()]
        columns.append(of_run)
    return columns


def knots(runs: Sequence[Run]) -> Array:
    """Instants (k,) s of the session's clock between which friction may change in its own way."""
    starts = [log.start for run in runs for log in run.logs]
    return np.linspace(min(starts), max(max(starts), min(starts) + 1.0), thresholds.CLOCK_KNOTS)
