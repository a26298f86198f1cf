"""The method `simultaneous`: inertia, viscous friction, rolling friction and delay from any motion with reversals.

::

    Kt i(t - tau) = J a + D w + b + sum_j alpha_j S_j(x)        alpha_j >= 0

The paper adjusts J and D by hand until the loop of ``T_d = Kt i - J a - D w`` over the position lies flat and only the
rolling friction remains.  Written with stop operators ``S_j`` the same condition is linear in everything but the
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
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal, accepted
from stagectl.identification.result import Characteristic, IdentificationResult, Note, Parameter, Progress, Topic
from stagectl.identification.simultaneous import conditions, notes, uncertainty
from stagectl.identification.simultaneous.delay_search import Fit, Problem, fitted, kept, widest
from stagectl.identification.simultaneous.errors_in_variables import (
    equations,
    follows_reference,
    instruments,
    projected,
)
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
from stagectl.identification.simultaneous.slip_distribution import SlipRange, evened, grid, located
from stagectl.units import ROTARY


class Solved(NamedTuple):
    """The last fit, and how well it is known."""

    problem: Problem
    fit: Fit
    known: uncertainty.Uncertainty
    ripple: bool


class _Given(NamedTuple):
    """What the search for parameters is given."""

    delay: float | None  # s; None: fitted
    instruments: bool  # made from the reference


def identify(
    captures: list[Capture],
    file: StageFile,
    delay: float | None = None,
    progress: Progress = lambda done, total: None,
) -> IdentificationResult:
    """Parameters of `file`'s axis from all `captures` together; `delay` (s) is fitted where it is None.

    `delay` is the time by which the force follows the capture's current column, less that by which the position is
    late; it may be negative.  Raises IdentificationError where no capture meets the paper's two conditions, and where
    the friction does not settle within the motion.
    """
    used, left_out = accepted(captures, lambda capture: conditions.checked(capture, file))
    progress(1, 5)
    solved, choice = _preferred(used, file, delay)
    progress(4, 5)
    result = _result(solved, file, delay is None, [*left_out, *choice])
    progress(5, 5)
    return result


def _preferred(captures: list[Capture], file: StageFile, delay: float | None) -> tuple[Solved, list[Note]]:
    """The plain fit, or that by instruments where there is a reference and the two differ by more than chance."""
    if not all(follows_reference(capture) for capture in captures):
        return _solved(captures, file, _Given(delay, False)), []
    plain, failure = None, ""
    try:
        plain = _solved(captures, file, _Given(delay, False))
    except IdentificationError as error:
        failure = str(error)
    instrumental = _solved(captures, file, _Given(delay, True), plain)
    if plain is None:
        text = f"reference: used as an instrument, as nothing is found without it: {failure}"
        return instrumental, [Note(Topic.REFERENCE, text)]
    choice = uncertainty.preferred((plain.fit, plain.known), (instrumental.fit, instrumental.known))
    if not choice.plain:
        return instrumental, [choice.note]
    wider = plain.known.covariance + np.outer(choice.difference, choice.difference)
    return plain._replace(known=plain.known._replace(covariance=wider)), [choice.note]


def _solved(captures: list[Capture], file: StageFile, given: _Given, other: Solved | None = None) -> Solved:
    """Where the friction lies, then the fit there.

    The range includes that of an `other` fit: on a range that ends too early the delay makes up for the rest.
    """
    coarse = _problem(captures, file, grid(captures), given, thresholds.COARSE_ROWS)
    ends = located(coarse, given.delay, _may_ripple(captures, file))
    conditions.check_inertia(ends.inertia, captures)
    conditions.check_settles(captures, ends, file)
    if other is not None:
        low, high = float(other.problem.slip[0]), float(other.problem.slip[-1])
        ends = ends._replace(low=min(ends.low, low), high=max(ends.high, high))
    solved = _refined(captures, file, ends, given)
    conditions.check_inertia(float(solved.fit.theta[0]), captures)
    return solved


def _problem(captures: list[Capture], file: StageFile, slip: Array, given: _Given, most: int) -> Problem:
    """Regressors of all captures that move far enough for the longest `slip`; at most `most` rows."""
    room = widest(max(capture.dt for capture in captures)) * 1.5 if given.delay is None else abs(given.delay)
    knot = shortest_knots if given.instruments else knots
    parts = [part(capture, knot(capture), float(slip[-1]), room) for capture in captures]
    parts = thinned([rows for rows in parts if rows.rows >= thresholds.FIT_LEAST_ROWS], most)
    if not parts:
        raise IdentificationError(
            f"{captures[0].name}: fewer than {thresholds.FIT_LEAST_ROWS} rows are left once the friction's state is "
            "known; record longer: a second of a motion there and back is enough",
            Refusal.TOO_SHORT,
            capture=captures[0].name,
            admissible=f"[{thresholds.FIT_LEAST_ROWS}, inf)",
        )
    stacked = np.vstack([columns(rows, slip) for rows in parts])
    source = instruments(parts, slip) if given.instruments else None
    seen = stacked if source is None else projected(source, stacked)
    return Problem(parts, stacked, seen, source, equations(seen, FREE), slip, file.motor.force_constant)


def _refined(captures: list[Capture], file: StageFile, ends: SlipRange, given: _Given) -> Solved:
    """Fit on a fine grid between `ends`; widened while its longest slip carries weight."""
    high, free_delay = ends.high, given.delay is None
    for _ in range(thresholds.WIDENINGS + 1):
        slip = np.geomspace(ends.low, high, thresholds.FINE_SLIPS)
        problem = _problem(captures, file, slip, given, thresholds.MOST_ROWS)
        fit = fitted(problem, kept(problem, ripple=False), given.delay, ends.delay)
        weight = fit.theta[FREE:]
        if weight[-1] <= thresholds.LAST_SLIP * weight.sum():
            break
        high *= thresholds.SLIP_RATIO
    known = uncertainty.assess(problem, fit, False, free_delay)
    if not _may_ripple(captures, file) or len(fit.residual) < thresholds.RIPPLE_ROWS:
        return Solved(problem, fit, known, False)
    rippled = _with_ripple(problem, fit, given.delay)
    if rippled is not None and rippled.known.ripple > thresholds.RIPPLE:
        return rippled
    bias = None if rippled is None else _half(rippled.known, 0) + abs(float(rippled.fit.theta[0] - fit.theta[0]))
    return Solved(problem, fit, known._replace(ripple_bias=bias), False)


def _half(known: uncertainty.Uncertainty, index: int) -> float:
    """Half of a 95 % interval."""
    return thresholds.NORMAL_95 * math.sqrt(known.covariance[index, index])


def _may_ripple(captures: list[Capture], file: StageFile) -> bool:
    """Whether the motion goes far enough round to separate a torque ripple once per revolution."""
    travel = max(float(np.ptp(capture.position)) for capture in captures)
    return file.axis.kind == ROTARY and travel >= thresholds.RIPPLE_TRAVEL


def _with_ripple(problem: Problem, fit: Fit, delay: float | None) -> Solved | None:
    """The same with a torque ripple; None where the inertia cannot be determined with it."""
    try:
        other = fitted(problem, kept(problem, ripple=True), delay, fit)
    except IdentificationError:  # with two more columns the acceleration cannot be separated from its noise
        return None
    known = uncertainty.assess(problem, other, True, delay is None)
    return Solved(problem, other, known, True)


def _result(solved: Solved, file: StageFile, free_delay: bool, before: list[Note]) -> IdentificationResult:
    fit, slip = solved.fit, solved.problem.slip
    short = uncertainty.unresolved(solved.problem, fit)
    wider = solved.known.covariance + np.outer(short.error, short.error)
    solved = solved._replace(known=solved.known._replace(covariance=wider))
    weight = evened(solved.problem, fit)
    carrying = weight > thresholds.CARRYING * weight.sum()
    values = [*fit.theta[:2], weight.sum(), fit.theta[ONE], fit.delay]
    parameters = {
        name: Parameter.named(name, file.axis.kind, float(value), _half(solved.known, index))
        for index, (name, value) in enumerate(zip(uncertainty.NAMES, values, strict=True))
    }
    table = _table(weight[carrying], slip[carrying])
    changes: dict[str, Any] = {
        "mechanics.inertia": parameters["inertia"].value,
        "mechanics.viscous": parameters["viscous"].value,
        "friction": table.block,
    }
    withheld = uncertainty.withheld(parameters, short)
    details = _details(solved, free_delay)
    fitted_axis = notes.FittedAxis(
        solved.problem,
        fit,
        solved.known,
        parameters,
        file,
        free_delay,
        solved.ripple,
        details["force_residual_percent"],
    )
    return IdentificationResult(
        parameters,
        table,
        details,
        (*before, *withheld.values(), *notes.written(fitted_axis)),
        {name: value for name, value in changes.items() if name not in withheld},
    )


def _table(weight: Array, slip: Array) -> Characteristic:
    """Reversal table to 1.1 times the displacement at which the last element slips."""
    displacement = np.linspace(0.0, 2.2 * float(slip[-1]), 221)
    force = np.clip(weight[:, None] * (displacement / slip[:, None] - 1.0), None, weight[:, None]).sum(axis=0)
    return Characteristic(displacement, np.asarray(force, dtype=np.float64), weight, slip)


def _details(solved: Solved, free_delay: bool) -> dict[str, Any]:
    problem, fit = solved.problem, solved.fit
    force = fit.residual + problem.columns @ fit.theta
    deviations = np.sqrt(np.diag(solved.known.covariance))
    names = uncertainty.NAMES if free_delay else uncertainty.NAMES[:-1]
    size = len(names)
    correlation = solved.known.covariance[:size, :size] / np.outer(deviations[:size], deviations[:size])
    return {
        "force_residual_percent": 100.0 * float(np.linalg.norm(fit.residual) / np.linalg.norm(force)),
        "rows": len(force),
        "captures": [rows.capture.name for rows in problem.parts],
        "current_column": sorted({rows.capture.current_column for rows in problem.parts}),
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
    """Columns of the first capture that the figures draw: at most `DRAWN_ROWS` rows."""
    problem, fit = solved.problem, solved.fit
    first = problem.parts[0]
    rows = slice(0, min(first.rows, thresholds.DRAWN_ROWS))
    index = first.places.start + first.places.step * np.arange(first.rows)[rows]
    curves = {
        "time": first.capture.time[index],
        "position": first.capture.position[index],
        "force": force[rows],
        "acceleration": problem.columns[rows, ACCELERATION],
        "velocity": problem.columns[rows, VELOCITY],
        "friction": (problem.columns[rows, FREE:] @ fit.theta[FREE:]),
        "residual": fit.residual[rows],
    }
    return {name: np.asarray(values).tolist() for name, values in curves.items()}
