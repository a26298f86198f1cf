"""Inertia, viscous friction, rolling friction and delay at once, from any motion with reversals.

::

    Kt i(t - tau) = J a + D w + b + sum_j alpha_j S_j(x)        alpha_j >= 0

The paper turns J and D by hand until the loop of ``T_d = Kt i - J a - D w`` over the position lies flat and only the
rolling friction is left.  Written with stop operators ``S_j`` the same condition is linear in everything but the
delay: a convex problem, without a search for reversals.  The slips are not tuned to an axis: a coarse grid from what
the motion resolves to a quarter of its stroke finds where the friction lies, and a fine one covers that.

Source: Simultaneous Identification of Linear Parameters and Nonlinear Rolling Friction for Ball Screw Driven Stage,
section IV.B; the operators as in `kernels.friction`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.result import Characteristic, Found, Parameter, Progress
from stagectl.identification.simultaneous import conditions, errors_in_columns, intervals, notes, tikhonov_weights
from stagectl.identification.simultaneous.delay_search import Fit, Problem, fitted, kept, widest
from stagectl.identification.simultaneous.hausman_test import preferred
from stagectl.identification.simultaneous.instruments import follow, instruments, projected
from stagectl.identification.simultaneous.regressors import (
    ACCELERATION,
    FREE,
    ONE,
    VELOCITY,
    columns,
    knots,
    part,
    shortest_knots,
    thinned,
)
from stagectl.identification.simultaneous.resolution import unresolved, withheld
from stagectl.identification.simultaneous.slip_range import RATIO, Range, grid, located
from stagectl.identification.standard_errors import SURE
from stagectl.units import LINEAR, ROTARY

FINE = 24  # slips of the second one
END = 0.05  # of the friction that the longest slip may carry; with more, the grid is widened
WIDENED = 3
RIPPLE = 12.0  # Wald's statistic above which a ripple is believed; by chance once in four hundred
RIPPLE_ROWS = 1000  # below, the statistic is not worth its name
RIPPLE_TRAVEL = 1.5  # rad, least travel that tells a ripple from the rest
COARSE_ROWS, MOST_ROWS = 20000, 120000  # of long captures, for a first look and for the answer
LEAST_ROWS = 60  # at least two for each unknown


class Solved(NamedTuple):
    """The last fit, and how well it is known."""

    problem: Problem
    fit: Fit
    known: intervals.Known
    ripple: bool


def identify(
    captures: list[Capture], file: StageFile, delay: float | None = None, progress: Progress | None = None
) -> Found:
    """Parameters of `file`'s axis from all `captures` together; `delay` (s) is fitted where it is None.

    `delay` is the time by which the force follows the capture's current column, less that by which the position is
    late; it may be negative.  Raises IdentificationError where no capture meets the paper's two conditions, and where
    the friction does not settle within the motion.
    """
    tell = progress or (lambda done, total: None)
    used, left_out = conditions.usable(captures, file)
    tell(1, 5)
    solved, said = _preferred(used, file, delay)
    tell(4, 5)
    answer = _found(solved, file, delay is None, [*left_out, *said])
    tell(5, 5)
    return answer


def _preferred(captures: list[Capture], file: StageFile, delay: float | None) -> tuple[Solved, list[str]]:
    """The plain fit, or that by instruments where there is a reference and the two differ by more than chance."""
    if not all(follow(capture) for capture in captures):
        return _solved(captures, file, delay, False), []
    plain, failed = None, ""
    try:
        plain = _solved(captures, file, delay, False)
    except IdentificationError as error:
        failed = str(error)
    told = _solved(captures, file, delay, True, plain)
    if plain is None:
        return told, [f"reference: used as an instrument, as nothing is found without it: {failed}"]
    choice = preferred((plain.fit, plain.known), (told.fit, told.known))
    if not choice.plain:
        return told, [choice.note]
    wider = plain.known.covariance + np.outer(choice.difference, choice.difference)
    return plain._replace(known=plain.known._replace(covariance=wider)), [choice.note]


def _solved(
    captures: list[Capture], file: StageFile, delay: float | None, told: bool, other: Solved | None = None
) -> Solved:
    """Where the friction lies, then the fit there; by instruments where the reference is `told`.

    The range holds that of an `other` fit, too: on a range that ends too early the delay stands in for the rest.
    """
    coarse = _problem(captures, file, grid(captures), (delay, told), COARSE_ROWS)
    ends = located(coarse, delay, _may_ripple(captures, file))
    conditions.check_sign(ends.inertia, captures)
    conditions.check_settles(captures, ends, file)
    if other is not None:
        low, high = float(other.problem.slip[0]), float(other.problem.slip[-1])
        ends = ends._replace(low=min(ends.low, low), high=max(ends.high, high))
    solved = _refined(captures, file, ends, (delay, told))
    conditions.check_sign(float(solved.fit.theta[0]), captures)
    return solved


def _problem(
    captures: list[Capture], file: StageFile, slip: Array, given: tuple[float | None, bool], most: int
) -> Problem:
    """Regressors of all captures that move far enough for the longest slip; `given` are delay and reference."""
    delay, told = given
    room = widest(max(capture.dt for capture in captures)) * 1.5 if delay is None else abs(delay)
    knot = shortest_knots if told else knots
    parts = [part(capture, knot(capture), float(slip[-1]), room) for capture in captures]
    parts = thinned([one for one in parts if one.rows >= LEAST_ROWS], most)
    if not parts:
        raise IdentificationError(
            f"{captures[0].name}: fewer than {LEAST_ROWS} rows are left once the friction's state is known; record "
            "longer: a second of a motion there and back is enough"
        )
    stacked = np.vstack([columns(one, slip) for one in parts])
    source = instruments(parts, slip) if told else None
    seen = stacked if source is None else projected(source, stacked)
    equations = errors_in_columns.equations(seen, FREE)
    return Problem(parts, stacked, seen, source, equations, slip, file.motor.force_constant)


def _refined(captures: list[Capture], file: StageFile, ends: Range, given: tuple[float | None, bool]) -> Solved:
    """Fit on a fine grid between `ends`; widened while its longest slip carries weight."""
    high, delay = ends.high, given[0]
    for _ in range(WIDENED + 1):
        problem = _problem(captures, file, np.geomspace(ends.low, high, FINE), given, MOST_ROWS)
        fit = fitted(problem, kept(problem, ripple=False), delay, ends.delay)
        weight = fit.theta[FREE:]
        if weight[-1] <= END * weight.sum():
            break
        high *= RATIO
    known = intervals.known(problem, fit, False, delay is None)
    if not _may_ripple(captures, file) or len(fit.residual) < RIPPLE_ROWS:
        return Solved(problem, fit, known, False)
    rippled = _with_ripple(problem, fit, delay)
    if rippled is not None and rippled.known.ripple > RIPPLE:
        return rippled
    bias = None if rippled is None else _sure(rippled.known, 0) + abs(float(rippled.fit.theta[0] - fit.theta[0]))
    return Solved(problem, fit, known._replace(ripple_bias=bias), False)


def _sure(known: intervals.Known, index: int) -> float:
    """Half of a 95 % interval."""
    return SURE * math.sqrt(known.covariance[index, index])


def _may_ripple(captures: list[Capture], file: StageFile) -> bool:
    """Whether the motion goes far enough round to tell a torque ripple once per revolution."""
    return file.axis.kind == ROTARY and max(float(np.ptp(one.position)) for one in captures) >= RIPPLE_TRAVEL


def _with_ripple(problem: Problem, fit: Fit, delay: float | None) -> Solved | None:
    """The same with a torque ripple; None where that leaves no inertia that could be told."""
    try:
        other = fitted(problem, kept(problem, ripple=True), delay, fit)
    except IdentificationError:  # with two more columns the acceleration cannot be told from its noise
        return None
    known = intervals.known(problem, other, True, delay is None)
    return Solved(problem, other, known, True)


def _found(solved: Solved, file: StageFile, free_delay: bool, left_out: list[str]) -> Found:
    fit, slip = solved.fit, solved.problem.slip
    short = unresolved(solved.problem, fit)
    wider = solved.known.covariance + np.outer(short.error, short.error)
    solved = solved._replace(known=solved.known._replace(covariance=wider))
    weight = tikhonov_weights.evened(solved.problem, fit)
    carrying = weight > 1e-6 * weight.sum()
    values = [*fit.theta[:2], weight.sum(), fit.theta[ONE], fit.delay]
    parameters = {
        name: Parameter(float(value), float(value) - half, float(value) + half, unit)
        for name, value, half, unit in zip(
            intervals.NAMES, values, (_sure(solved.known, index) for index in range(5)), units(file), strict=True
        )
    }
    changes: dict[str, Any] = {
        "mechanics.inertia": parameters["inertia"].value,
        "mechanics.viscous": parameters["viscous"].value,
        "friction": {
            "law": "stop-operators",
            "weight": weight[carrying].tolist(),
            "slip": slip[carrying].tolist(),
        },
    }
    unfit = withheld(parameters, short)
    changes = {name: value for name, value in changes.items() if name not in unfit}
    details = _details(solved, free_delay)
    told = notes.Result(
        solved.problem,
        fit,
        solved.known,
        parameters,
        file,
        free_delay,
        solved.ripple,
        details["force_residual_percent"],
    )
    return Found(
        parameters,
        _table(weight[carrying], slip[carrying]),
        details,
        (*left_out, *unfit.values(), *notes.written(told)),
        changes,
    )


def units(file: StageFile) -> tuple[str, ...]:
    """SI units of `intervals.NAMES`."""
    if file.axis.kind == LINEAR:
        return "kg", "N s/m", "N", "N", "s"
    return "kg m^2", "N m s/rad", "N m", "N m", "s"


def _table(weight: Array, slip: Array) -> Characteristic:
    """Reversal table to 1.1 times the displacement at which the last element slips."""
    displacement = np.linspace(0.0, 2.2 * float(slip[-1]), 221)
    force = np.clip(weight[:, None] * (displacement / slip[:, None] - 1.0), None, weight[:, None]).sum(axis=0)
    return Characteristic(displacement, np.asarray(force, dtype=np.float64), weight, slip)


def _details(solved: Solved, free_delay: bool) -> dict[str, Any]:
    problem, fit = solved.problem, solved.fit
    force = fit.residual + problem.columns @ fit.theta
    deviations = np.sqrt(np.diag(solved.known.covariance))
    names = intervals.NAMES if free_delay else intervals.NAMES[:-1]
    size = len(names)
    correlation = solved.known.covariance[:size, :size] / np.outer(deviations[:size], deviations[:size])
    return {
        "force_residual_percent": 100.0 * float(np.linalg.norm(fit.residual) / np.linalg.norm(force)),
        "rows": len(force),
        "captures": [one.capture.name for one in problem.parts],
        "current_column": sorted({one.capture.current_column for one in problem.parts}),
        "delay_fitted": free_delay,
        "ripple": math.hypot(*fit.theta[ONE + 1 : FREE]) if solved.ripple else None,
        "correlation": correlation.tolist(),
        "identifiability": {
            "names": list(names),
            "correlation": correlation.tolist(),
            "per_delay": dict(zip(names, solved.known.per_delay.tolist(), strict=False)),
        },
        "curves": _curves(solved, force),
    }


def _curves(solved: Solved, force: Array) -> dict[str, list[float]]:
    """What the figures draw of the first capture: at most 4000 rows."""
    problem, fit = solved.problem, solved.fit
    one = problem.parts[0]
    rows = slice(0, min(one.rows, 4000))
    index = one.places.start + one.places.step * np.arange(one.rows)[rows]
    found = {
        "time": one.capture.time[index],
        "position": one.capture.position[index],
        "force": force[rows],
        "acceleration": problem.columns[rows, ACCELERATION],
        "velocity": problem.columns[rows, VELOCITY],
        "friction": (problem.columns[rows, FREE:] @ fit.theta[FREE:]),
        "residual": fit.residual[rows],
    }
    return {name: np.asarray(values).tolist() for name, values in found.items()}
