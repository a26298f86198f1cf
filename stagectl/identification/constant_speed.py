"""Constant-speed examination: the mean force over whole revolutions against speed.

::

    F                   ____----  F = D v + c+        v > 0
    |          ____----
    | c+ ----
    +---------------------- v     c+ = T_c + offset
      ----___                     c- = T_c - offset
             ----____  F = D v - c-                   v < 0

At constant speed inertia asks for nothing, and over whole revolutions ripple averages to nothing, so one mean a span
is left; a straight line with one slope and an intercept for each direction goes through them by least squares, each
span weighted by its duration.  Spans of constant speed are found in the position itself.

Source: Simultaneous Identification ..., section IV.A.1 and Fig. 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.response.sampling import check
from stagectl.identification.result import Found, Parameter
from stagectl.units import ROTARY

BLOCK = 0.02  # s, over which a speed is taken
EVEN = 0.03  # largest deviation of a block's speed from the middle of its span's, relative
STEPS = 4.0  # encoder steps by which a block's length may err
LEVEL = 0.01  # largest difference between the thirds of a span, relative
SHORTEST = 0.1  # s, of a span
SETTLING = 0.1  # s at the start of a span in which the force still settles; at most a quarter of it
APART = 0.05  # relative difference of two speeds
SKEW = 0.02  # share of the force that may be inertial over a span
RIPPLES = 4  # waves a revolution
BATCHES = 10  # of a span, for the deviation of its mean
CLIPPED = 0.01  # largest share of a span's samples at the current limit
CROOKED = 3.0  # scatter of the means about the line, over their own deviation


class Span(NamedTuple):
    """A piece of constant speed, settling and any broken revolution left out."""

    name: str
    start: float  # s
    duration: float  # s
    revolutions: int  # 0: averaged over time
    speed: float  # rad/s | m/s, signed
    force: float  # N m | N
    deviation: float  # N m | N, of the mean, from its own course
    acceleration: float  # rad/s^2 | m/s^2, that is left
    clipped: float  # share of the samples at the current limit


def identify(
    captures: list[Capture], file: StageFile, progress: Callable[[int, int], None] = lambda done, total: None
) -> Found:
    """Viscous friction, Coulomb friction and offset from all spans of constant speed in `captures`.

    Raises IdentificationError where they are too few, or of one speed only.
    """
    spans: list[Span] = []
    notes: list[str] = []
    for k, capture in enumerate(captures):
        check(capture)
        found = constant_spans(capture, file)
        spans += [one for one in found if one.clipped <= CLIPPED]
        notes += [_clipped(one, file) for one in found if one.clipped > CLIPPED]
        progress(k + 1, len(captures))
    both = _check(spans, file)
    values, covariance, scatter = straight_line(spans, both)
    half = _quantile(len(spans) - len(values), len(spans), scatter) * np.sqrt(np.diag(covariance))
    rotary = file.axis.kind == ROTARY
    names = {"viscous": "N m s/rad" if rotary else "N s/m", "coulomb": "N m" if rotary else "N"}
    if both:
        names["offset"] = names["coulomb"]
    parameters = {
        name: Parameter(value, value - wide, value + wide, unit)
        for (name, unit), value, wide in zip(names.items(), values.tolist(), half.tolist(), strict=True)
    }
    details = _details(spans, parameters, scatter)
    changes = {"mechanics.viscous": parameters["viscous"].value}
    return Found(parameters, None, details, (*notes, *_doubts(spans, details, file, rotary)), changes)


def constant_spans(capture: Capture, file: StageFile) -> list[Span]:
    """All spans of constant speed in one capture."""
    size = max(2, round(BLOCK / capture.dt))
    edges = np.arange(0, len(capture.time), size)
    speed = np.diff(capture.position[edges]) / (size * capture.dt)
    blur = STEPS * capture.encoder_step / (size * capture.dt)
    found: list[Span] = []
    for first, last in _runs(speed.tolist(), blur):
        rows = (last - first) * size
        if rows * capture.dt >= SHORTEST and _level(speed[first:last], blur):
            change = _change(speed[first:last])
            settling = max(size, min(rows // 4, round(SETTLING / capture.dt)))
            span = (int(edges[first]) + settling, int(edges[last]) - size)  # a ramp may begin within the last block
            found.append(_span(capture, file, span, change / (rows * capture.dt)))
    return found


def _runs(speed: list[float], blur: float) -> list[tuple[int, int]]:
    """First block of each run whose speeds stay within a band, and the one after its last."""
    runs, first = [], 0
    low = high = speed[0] if speed else 0.0
    for k, v in enumerate([*speed, math.inf]):
        low, high = min(low, v), max(high, v)
        if high - low <= EVEN * abs(high + low) + 2.0 * blur:
            continue
        if k - first >= 5 and min(map(abs, speed[first:k])) > blur:
            runs.append((first, k))
        first, low, high = k, v, v
    return runs


def _level(speed: Array, blur: float) -> bool:
    """Whether the thirds of a run have the same mean, which those of a sine's peak have not; its ends left out."""
    thirds = [float(np.mean(part)) for part in np.array_split(speed[1:-1], 3)]
    return max(thirds) - min(thirds) <= LEVEL * abs(thirds[1]) + blur


def _change(speed: Array) -> float:
    """By how much a straight line through the speeds changes from the first to the last."""
    slope, _ = np.polyfit(np.arange(len(speed)), speed, 1)
    return float(slope) * len(speed)


def _span(capture: Capture, file: StageFile, rows: tuple[int, int], acceleration: float) -> Span:
    """The span of `rows`, cut to whole revolutions from its end backwards."""
    start, end = rows
    turned = np.abs(capture.position[start:end] - capture.position[end - 1])
    revolutions = int(turned[0] / (2.0 * math.pi)) if file.axis.kind == ROTARY else 0
    if revolutions:
        start += int(np.argmin(np.abs(turned - 2.0 * math.pi * revolutions)))
    duration = (end - 1 - start) * capture.dt
    force = file.motor.force_constant * capture.current[start : end - 1]
    return Span(
        capture.name,
        float(capture.time[start]),
        duration,
        revolutions,
        float(capture.position[end - 1] - capture.position[start]) / duration,
        float(np.mean(force)),
        _deviation(force, capture.position[start : end - 1], revolutions),
        acceleration,
        float(np.mean(np.abs(capture.current[start : end - 1]) > 0.999 * file.drive.current_limit)),
    )


def _deviation(force: Array, angle: Array, revolutions: int) -> float:
    """Standard deviation of the mean: from the means of consecutive batches, ripple taken off."""
    rest = force - np.mean(force)
    if revolutions:
        turn = angle[:, None] * np.arange(1, RIPPLES + 1)
        ripple = np.hstack([np.cos(turn), np.sin(turn)])
        rest = rest - ripple @ np.linalg.lstsq(ripple, rest, rcond=None)[0]
    size = len(rest) // BATCHES
    means = rest[: size * BATCHES].reshape(BATCHES, size).mean(axis=1)
    return float(np.std(means, ddof=1)) / math.sqrt(BATCHES)


def _unit(file: StageFile) -> str:
    """Of the axis's speeds."""
    return "rad/s" if file.axis.kind == ROTARY else "m/s"


def _clipped(span: Span, file: StageFile) -> str:
    return (
        f"{span.name}: the span at {span.speed:.4g} {_unit(file)} from {span.start:.4g} s on is left out: its "
        f"current is at the drive's limit of {file.drive.current_limit:g} A for {100.0 * span.clipped:.0f} % of it"
    )


def straight_line(spans: list[Span], both: bool) -> tuple[Array, NDArray[np.float64], float]:
    """Values (D, T_c and, of `both` directions, the offset), their covariance, and how much the spans scatter.

    The scatter is relative to what the spans' own deviations let expect; above 1 it widens the covariance.
    """
    speed = np.array([one.speed for one in spans])
    columns = [speed, np.sign(speed), np.ones(len(spans))]
    regressor = np.column_stack(columns if both else columns[:2])
    root = np.sqrt(np.array([one.duration for one in spans]))
    noise = float(np.sqrt(np.mean([one.deviation**2 * one.duration for one in spans])))  # of one second
    scaled = regressor * root[:, None]
    force = np.array([one.force for one in spans]) * root
    values, *_ = np.linalg.lstsq(scaled, force, rcond=None)
    freedom = len(spans) - len(values)
    residual = float(np.sqrt(np.sum((force - scaled @ values) ** 2) / freedom)) if freedom else 0.0
    covariance = np.linalg.inv(scaled.T @ scaled) * max(noise, residual) ** 2
    return np.asarray(values, dtype=np.float64), covariance, residual / noise if noise else 1.0


def _quantile(freedom: int, spans: int, scatter: float) -> float:
    """Student's for 95 %: the batches of all spans count where the line scatters no more than they let expect."""
    plain = freedom == 0 or scatter**2 * freedom <= stats.chi2.ppf(0.95, freedom)
    return float(stats.t.ppf(0.975, freedom + spans * (BATCHES - 1) if plain else freedom))


def _check(spans: list[Span], file: StageFile) -> bool:
    """Whether both directions are there, once the spans tell the parameters."""
    found = ", ".join(f"{one.speed:.4g}" for one in spans) or "none"
    speeds = np.sort(np.abs([one.speed for one in spans]))
    different = 1 + int(np.sum(np.diff(speeds) > APART * speeds[1:])) if len(speeds) else 0
    both = len({one.speed > 0.0 for one in spans}) == 2
    if different < 2:
        raise IdentificationError(
            f"{different} different speeds in spans of constant speed longer than {SHORTEST:g} s; must be at least 2 "
            f"(found, in {_unit(file)}: {found}): record trapezoids there and back at several speeds, five say, so "
            "that slope and Coulomb friction can be told apart"
        )
    if both and len(spans) < 3:
        raise IdentificationError(
            f"one span each way, at different speeds ({found} {_unit(file)}); slope, Coulomb friction and offset need "
            "three: record both speeds in both directions"
        )
    return both


def _details(spans: list[Span], parameters: dict[str, Parameter], scatter: float) -> dict[str, Any]:
    coulomb = parameters["coulomb"].value
    offset = parameters["offset"].value if "offset" in parameters else 0.0
    viscous = parameters["viscous"].value
    return {
        "spans": [one._asdict() for one in spans],
        "residual": [one.force - viscous * one.speed - math.copysign(coulomb, one.speed) - offset for one in spans],
        "coulomb_positive": coulomb + offset,
        "coulomb_negative": coulomb - offset,
        "scatter": scatter,
    }


def _doubts(spans: list[Span], details: dict[str, Any], file: StageFile, rotary: bool) -> list[str]:
    notes = ["the force constant is taken from the stage file: friction scales with it"]
    if len({one.speed > 0.0 for one in spans}) == 1:
        notes.append(
            "all spans go one way: a constant effort such as gravity cannot be told from Coulomb friction, and "
            "`coulomb` holds both; record the way back, too"
        )
    else:
        notes.append("the offset is gravity, a current sensor's zero and unequal Coulomb friction together")
    broken = [one for one in spans if rotary and not one.revolutions]
    if broken:
        notes.append(
            f"{len(broken)} of {len(spans)} spans ({', '.join(f'{one.speed:.3g}' for one in broken[:6])} rad/s) are "
            "shorter than a revolution and averaged over time: torque ripple biases them; travel further"
        )
    inertia = file.mechanics.inertia
    skew = max(abs(inertia * one.acceleration / one.force) if one.force else math.inf for one in spans)
    if skew > SKEW:
        notes.append(
            f"the speed still changes within a span: by the stage file's inertia {100.0 * skew:.2g} % of the force "
            f"there is inertial; must be below {100.0 * SKEW:g} %: record longer spans"
        )
    if details["scatter"] > CROOKED and len(spans) > 4:
        notes.append(
            f"the means lie {details['scatter']:.2g} times further from the line than their noise lets expect: force "
            "over speed is not straight (Stribeck effect at low speed, lubrication, or the position along the travel); "
            "the intervals are wider for it"
        )
    return notes
