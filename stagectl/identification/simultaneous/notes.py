"""What a fit cannot separate, and what is doubtful about it, in words: judged from its intervals, not fixed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array
from stagectl.identification.result import Parameter
from stagectl.identification.simultaneous import errors_in_columns as errors
from stagectl.identification.simultaneous.delay_search import Fit, Problem
from stagectl.identification.simultaneous.intervals import NAMES, Known
from stagectl.identification.simultaneous.regressors import FREE, ONE
from stagectl.identification.simultaneous.resolution import unresolved
from stagectl.number_format import duration, length
from stagectl.units import LINEAR

TIED = 0.95  # correlation from which two parameters are said to be tied to each other
UNSURE = 0.05  # half of an interval over its value
UNRESOLVED = 0.05  # of the friction, in the shortest element
MISFIT = 2.0  # residual's variance over that of its noise
POOR = 5.0  # percent of the force
COLUMNS = {
    "measured_current": "the measured current",
    "current": "the current handed to the drive",
    "command": "the command before its limit",
}


class Result(NamedTuple):
    """All that the words are about."""

    problem: Problem
    fit: Fit
    known: Known
    parameters: dict[str, Parameter]
    file: StageFile
    delay_fitted: bool
    rippled: bool
    residual_percent: float


def written(p: Result) -> tuple[str, ...]:
    """The notes, the most general one first."""
    return (*_scale(p), *_offset(p), *_delay(p), *_tied(p), *_unsure(p), *_friction(p), *_ripple(p), *_misfit(p))


def _effort(p: Result) -> str:
    return "N" if p.file.axis.kind == LINEAR else "N m"


def _half(p: Result, name: str) -> float:
    return 0.5 * (p.parameters[name].high - p.parameters[name].low)


def _percent(p: Result, name: str, half: float) -> str:
    return f"{100.0 * half / max(abs(p.parameters[name].value), 1e-300):.2g} %"


def _scale(p: Result) -> Iterator[str]:
    yield (
        f"force constant: not identified; {p.problem.force_constant:g} {_effort(p)}/A is the stage file's, and an "
        "error of 1 % there is one of 1 % in inertia, viscous and Coulomb friction alike"
    )


def _offset(p: Result) -> Iterator[str]:
    value, half = p.parameters["offset"].value, _half(p, "offset")
    if abs(value) <= half:
        yield (
            f"offset: none beyond its interval of ±{half:.2g} {_effort(p)}; gravity and a Coulomb friction that "
            "differs between the directions could only hide by cancelling each other"
        )
    else:
        yield (
            f"offset: {value:.3g} ± {half:.2g} {_effort(p)} is gravity, a Coulomb friction that differs between the "
            f"directions by {2.0 * abs(value):.3g} {_effort(p)}, or an offset of the current: one column for all three"
        )


def _delay(p: Result) -> Iterator[str]:
    value, half = p.parameters["delay"].value, _half(p, "delay")
    columns = {one.capture.current_column for one in p.problem.parts}
    what = " and ".join(COLUMNS.get(name, name) for name in sorted(columns))
    change = abs(p.known.per_delay[0]) * 1e-4
    if not p.delay_fitted:
        yield (
            f"delay: taken as {duration(value)} from {what} to the position; 0.1 ms more or less would change the "
            f"inertia by {_percent(p, 'inertia', change)}"
        )
        return
    yield (
        f"delay: {1e3 * value:.3g} ± {1e3 * half:.2g} ms, from {what} to the position; it holds for that column only"
        + (", and is negative where the column itself is late" if value < 0.0 else "")
    )
    if any(one.capture.reference is None for one in p.problem.parts):
        yield (
            "reference: missing in at least one capture; if a controller moved the axis there, its answer to the "
            "position's noise shifts delay and inertia together: record the reference, or give --delay"
        )
    if len(columns) > 1:
        yield "delay: the captures hold different current columns, which have different delays; identify them apart"


def _tied(p: Result) -> Iterator[str]:
    covariance = p.known.covariance
    names = NAMES if p.delay_fitted else NAMES[:-1]
    for j, one in enumerate(names):
        for k in range(j + 1, len(names)):
            size = math.sqrt(covariance[j, j] * covariance[k, k])
            correlation = float(covariance[j, k]) / size if size > 0.0 else 0.0
            if abs(correlation) >= TIED:
                half = _half(p, one)
                alone = half * math.sqrt(max(0.0, 1.0 - correlation * correlation))
                yield (
                    f"{one} and {names[k]}: tied to each other in this motion (correlation {correlation:+.2f}); with "
                    f"{names[k]} known, {one} would be known to ±{_percent(p, one, alone)} instead of "
                    f"±{_percent(p, one, half)}"
                    + ("; give --delay from a capture of a position sine" if names[k] == "delay" else "")
                )


def _unsure(p: Result) -> Iterator[str]:
    for name in ("inertia", "viscous", "coulomb"):
        if _half(p, name) > UNSURE * abs(p.parameters[name].value):
            yield (
                f"{name}: known to ±{_percent(p, name, _half(p, name))} only; record longer, with larger accelerations "
                "for the inertia and higher speeds for the viscous friction"
            )
    if p.parameters["viscous"].value < 0.0:
        yield (
            f"viscous: {p.parameters['viscous'].value:.3g} is negative, which no bearing is; friction that falls with "
            "speed (Stribeck) looks so"
        )


def _friction(p: Result) -> Iterator[str]:
    short = unresolved(p.problem, p.fit)
    if short.share > UNRESOLVED:
        place = length(short.slip * p.file.axis.travel_per_unit, p.file.axis.travel_unit)
        yield (
            f"friction: {100.0 * short.share:.0f} % of it lies in an element of {place}, the shortest that sampling, "
            "encoder and speed of reversal resolve; it may be shorter in truth"
        )
    if np.any(short.error != 0.0):
        dt = max(one.capture.dt for one in p.problem.parts)
        yield (
            f"friction and viscous: cannot be told apart well at a sampling time of {duration(dt)}, as most of the "
            f"friction turns round between the rows of a reversal; up to {abs(short.error[2]):.2g} {_effort(p)} may "
            "belong to the other, which their intervals hold: sample faster, or reverse more slowly"
        )


def _ripple(p: Result) -> Iterator[str]:
    if p.rippled:
        amplitude = math.hypot(*p.fit.theta[ONE + 1 : FREE])
        yield (
            f"ripple: {amplitude:.3g} {_effort(p)} once per revolution, found and taken out of the other parameters; "
            f"the motion covers {_turns(p):.2g} revolutions"
        )
    elif p.known.ripple_bias is not None:
        yield (
            f"ripple: none is seen over {_turns(p):.2g} revolutions, so none is taken out; one too small to be seen "
            f"may change the inertia by {_percent(p, 'inertia', p.known.ripple_bias)}"
        )


def _turns(p: Result) -> float:
    return max(float(np.ptp(one.capture.position)) for one in p.problem.parts) / (2.0 * math.pi)


def _misfit(p: Result) -> Iterator[str]:
    residual: Array = p.fit.residual
    ratio = float(np.mean(residual * residual)) / max(float(np.mean(errors.noise(residual))), 1e-300)
    if p.residual_percent > POOR or (ratio > MISFIT and p.residual_percent > 0.2 * POOR):
        yield (
            f"residual: {p.residual_percent:.2g} % of the force is not explained, {ratio:.2g} times its noise: "
            "the axis does something that the model does not hold, and the intervals do not cover that"
        )
