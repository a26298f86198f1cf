"""Notes on what a fit cannot separate and what is doubtful about it, judged from its intervals."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.result import Note, Parameter, Topic
from stagectl.identification.simultaneous import errors_in_variables as errors
from stagectl.identification.simultaneous.delay_search import Fit, Problem
from stagectl.identification.simultaneous.regressors import FREE, ONE
from stagectl.identification.simultaneous.uncertainty import NAMES, Uncertainty, unresolved
from stagectl.number_format import duration, length
from stagectl.units import LINEAR

COLUMNS = {
    "measured_current": "the measured current",
    "current": "the current handed to the drive",
    "command": "the command before its limit",
}


class FittedAxis(NamedTuple):
    """All that the notes are about."""

    problem: Problem
    fit: Fit
    known: Uncertainty
    parameters: dict[str, Parameter]
    file: StageFile
    delay_fitted: bool
    rippled: bool
    residual_percent: float


def written(p: FittedAxis) -> tuple[Note, ...]:
    """The notes, the most general one first."""
    return (
        *_force_constant(p),
        *_offset(p),
        *_delay(p),
        *_tied(p),
        *_imprecise(p),
        *_friction(p),
        *_ripple(p),
        *_residual(p),
    )


def _effort(p: FittedAxis) -> str:
    return "N" if p.file.axis.kind == LINEAR else "N m"


def _percent(p: FittedAxis, name: str, half: float) -> str:
    return f"{100.0 * half / max(abs(p.parameters[name].value), 1e-300):.2g} %"


def _force_constant(p: FittedAxis) -> Iterator[Note]:
    yield Note(
        Topic.FORCE_CONSTANT,
        f"force constant: not identified; {p.problem.force_constant:g} {_effort(p)}/A is the stage file's. An error "
        "of 1 % there is one of 1 % in inertia, viscous and Coulomb friction alike",
    )


def _offset(p: FittedAxis) -> Iterator[Note]:
    value, half = p.parameters["offset"].value, p.parameters["offset"].half
    if abs(value) <= half:
        text = (
            f"offset: none beyond its interval of ±{half:.2g} {_effort(p)}; gravity and a Coulomb friction that "
            "differs between the directions could only hide by cancelling each other"
        )
    else:
        text = (
            f"offset: {value:.3g} ± {half:.2g} {_effort(p)} is gravity, a Coulomb friction that differs between the "
            f"directions by {2.0 * abs(value):.3g} {_effort(p)}, or an offset of the current: one column for all three"
        )
    yield Note(Topic.OFFSET, text)


def _delay(p: FittedAxis) -> Iterator[Note]:
    value, half = p.parameters["delay"].value, p.parameters["delay"].half
    columns = {part.capture.current_column for part in p.problem.parts}
    current = " and ".join(COLUMNS.get(name, name) for name in sorted(columns))
    if not p.delay_fitted:
        change = abs(p.known.per_delay[0]) * 1e-4
        text = (
            f"delay: taken as {duration(value)} from {current} to the position; 0.1 ms more or less would change the "
            f"inertia by {_percent(p, 'inertia', change)}"
        )
        yield Note(Topic.DELAY, text)
        return
    negative = ", and is negative where the column itself is late" if value < 0.0 else ""
    yield Note(
        Topic.DELAY,
        f"delay: {1e3 * value:.3g} ± {1e3 * half:.2g} ms, from {current} to the position; it holds for that column "
        f"only{negative}",
    )
    if any(part.capture.reference is None for part in p.problem.parts):
        text = (
            "reference: missing in at least one capture; if a controller moved the axis there, its response to the "
            "position's noise shifts delay and inertia together: record the reference, or give --delay"
        )
        yield Note(Topic.REFERENCE, text)
    if len(columns) > 1:
        text = "delay: the captures hold different current columns with different delays; identify them separately"
        yield Note(Topic.DELAY, text)


def _tied(p: FittedAxis) -> Iterator[Note]:
    covariance = p.known.covariance
    names = NAMES if p.delay_fitted else NAMES[:-1]
    for j, name in enumerate(names):
        for k in range(j + 1, len(names)):
            size = math.sqrt(covariance[j, j] * covariance[k, k])
            correlation = float(covariance[j, k]) / size if size > 0.0 else 0.0
            if abs(correlation) < thresholds.TIED:
                continue
            half = p.parameters[name].half
            alone = half * math.sqrt(max(0.0, 1.0 - correlation * correlation))
            advice = "; give --delay from a capture of a position sine" if names[k] == "delay" else ""
            text = (
                f"{name} and {names[k]}: tied to each other in this motion (correlation {correlation:+.2f}); with "
                f"{names[k]} known, {name} would be known to ±{_percent(p, name, alone)} instead of "
                f"±{_percent(p, name, half)}{advice}"
            )
            yield Note(Topic.TIED, text)


def _imprecise(p: FittedAxis) -> Iterator[Note]:
    for name in ("inertia", "viscous", "coulomb"):
        if p.parameters[name].half > thresholds.UNSURE * abs(p.parameters[name].value):
            text = (
                f"{name}: known to ±{_percent(p, name, p.parameters[name].half)} only; record longer, with larger "
                "accelerations for the inertia and higher speeds for the viscous friction"
            )
            yield Note(Topic.PRECISION, text)
    viscous = p.parameters["viscous"].value
    if viscous < 0.0:
        text = (
            f"viscous: {viscous:.3g} is negative, which no bearing is; friction that falls with speed (Stribeck) "
            "looks like this"
        )
        yield Note(Topic.PRECISION, text)


def _friction(p: FittedAxis) -> Iterator[Note]:
    short = unresolved(p.problem, p.fit)
    if short.share > thresholds.SHORTEST_ELEMENT:
        place = length(short.slip * p.file.axis.travel_per_unit, p.file.axis.travel_unit)
        text = (
            f"friction: {100.0 * short.share:.0f} % of it lies in an element of {place}, the shortest that sampling, "
            "encoder and speed of reversal resolve; the true slip may be shorter"
        )
        yield Note(Topic.SAMPLING, text)
    if np.any(short.error != 0.0):
        dt = max(part.capture.dt for part in p.problem.parts)
        text = (
            f"friction and viscous: cannot be separated well at a sampling time of {duration(dt)}, as most of the "
            f"friction reverses between two rows; up to {abs(short.error[2]):.2g} {_effort(p)} may belong to the "
            "other, which their intervals include: sample faster, or reverse more slowly"
        )
        yield Note(Topic.SAMPLING, text)


def _ripple(p: FittedAxis) -> Iterator[Note]:
    if p.rippled:
        amplitude = math.hypot(*p.fit.theta[ONE + 1 : FREE])
        text = (
            f"ripple: {amplitude:.3g} {_effort(p)} once per revolution, found and taken out of the other parameters; "
            f"the motion covers {_turns(p):.2g} revolutions"
        )
    elif p.known.ripple_bias is not None:
        text = (
            f"ripple: none is seen over {_turns(p):.2g} revolutions, so none is taken out; one too small to be seen "
            f"may change the inertia by {_percent(p, 'inertia', p.known.ripple_bias)}"
        )
    else:
        return
    yield Note(Topic.RIPPLE, text)


def _turns(p: FittedAxis) -> float:
    return max(float(np.ptp(part.capture.position)) for part in p.problem.parts) / (2.0 * math.pi)


def _residual(p: FittedAxis) -> Iterator[Note]:
    residual: Array = p.fit.residual
    ratio = float(np.mean(residual * residual)) / max(float(np.mean(errors.noise(residual))), 1e-300)
    poor = thresholds.POOR_FIT
    if p.residual_percent > poor or (ratio > thresholds.MISFIT and p.residual_percent > 0.2 * poor):
        text = (
            f"residual: {p.residual_percent:.2g} % of the force is not explained, {ratio:.2g} times its noise: "
            "the axis does something that the model does not describe, and the intervals do not cover that"
        )
        yield Note(Topic.RESIDUAL, text)
