"""The method `constant-speed`: the mean force over whole revolutions against speed.

::

    F                   ____----  F = D v + c+        v > 0
    |          ____----
    | c+ ----
    +---------------------- v     c+ = T_c + offset
      ----___                     c- = T_c - offset
             ----____  F = D v - c-                   v < 0

At constant speed no force goes into the inertia, and over whole revolutions ripple averages out, so that each span
gives one mean.  A straight line with one slope and an intercept for each direction is fitted by least squares, each
span weighted by its duration.  Spans of constant speed are found in the position itself.

Source: Simultaneous Identification ..., section IV.A.1 and Fig. 5.
"""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal, check_excited, each
from stagectl.identification.result import IdentificationResult, Note, Parameter, Progress, Topic
from stagectl.number_format import percent
from stagectl.units import ROTARY, unit_on


class SpeedSpan(NamedTuple):
    """A piece of constant speed, settling and any broken revolution left out."""

    name: str
    start: float  # s
    duration: float  # s
    revolutions: int  # 0: averaged over time
    speed: float  # rad/s | m/s, signed
    force: float  # N m | N
    deviation: float  # N m | N, of the mean, from its own course
    acceleration: float  # rad/s^2 | m/s^2, that remains
    clipped: float  # share of the samples at the current limit


def identify(
    captures: list[Capture], file: StageFile, progress: Progress = lambda done, total: None
) -> IdentificationResult:
    """Viscous friction, Coulomb friction and offset from all spans of constant speed in `captures`.

    Raises IdentificationError where they are too few, or of one speed only.
    """
    all_spans = list(
        itertools.chain.from_iterable(each(captures, lambda capture: constant_spans(capture, file), progress))
    )
    spans = [span for span in all_spans if span.clipped <= thresholds.SPAN_CLIPPED]
    notes = [_clipped(span, file) for span in all_spans if span.clipped > thresholds.SPAN_CLIPPED]
    both = _check(spans, file)
    values, covariance, scatter = straight_line(spans, both)
    half = _quantile(len(spans) - len(values), len(spans), scatter) * np.sqrt(np.diag(covariance))
    parameters = {
        name: Parameter.named(name, file.axis.kind, value, wide)
        for name, value, wide in zip(("viscous", "coulomb", "offset"), values.tolist(), half.tolist(), strict=False)
    }
    details = _details(spans, parameters, scatter)
    changes = {"mechanics.viscous": parameters["viscous"].value}
    doubts = _doubts(spans, scatter, file)
    return IdentificationResult(parameters, None, details, (*notes, *doubts), changes)


def constant_spans(capture: Capture, file: StageFile) -> list[SpeedSpan]:
    """All spans of constant speed in one capture.

    Raises IdentificationError where it holds no motion.
    """
    check_excited(capture)
    size = max(2, round(thresholds.SPEED_BLOCK / capture.dt))
    edges = np.arange(0, len(capture.time), size)
    speed = np.diff(capture.position[edges]) / (size * capture.dt)
    blur = thresholds.SPEED_BLOCK_STEPS * capture.encoder_step / (size * capture.dt)
    spans: list[SpeedSpan] = []
    for first, last in _runs(speed.tolist(), blur):
        rows = (last - first) * size
        if rows * capture.dt >= thresholds.SHORTEST_SPAN and _level(speed[first:last], blur):
            change = _change(speed[first:last])
            settling = max(size, min(rows // 4, round(thresholds.SPAN_SETTLING / capture.dt)))
            span = (int(edges[first]) + settling, int(edges[last]) - size)  # a ramp may begin within the last block
            spans.append(_span(capture, file, span, change / (rows * capture.dt)))
    return spans


def _runs(speed: list[float], blur: float) -> list[tuple[int, int]]:
    """First block of each run whose speeds stay within a band, and the one after its last."""
    runs, first = [], 0
    low = high = speed[0] if speed else 0.0
    for k, v in enumerate([*speed, math.inf]):
        low, high = min(low, v), max(high, v)
        if high - low <= thresholds.SPAN_EVEN * abs(high + low) + 2.0 * blur:
            continue
        if k - first >= 5 and min(map(abs, speed[first:k])) > blur:
            runs.append((first, k))
        first, low, high = k, v, v
    return runs


def _level(speed: Array, blur: float) -> bool:
    """Whether the thirds of a run have the same mean, which those of a sine's peak have not; its ends left out."""
    thirds = [float(np.mean(part)) for part in np.array_split(speed[1:-1], 3)]
    return max(thirds) - min(thirds) <= thresholds.SPAN_LEVEL * abs(thirds[1]) + blur


def _change(speed: Array) -> float:
    """By how much a straight line through the speeds changes from the first to the last."""
    slope, _ = np.polyfit(np.arange(len(speed)), speed, 1)
    return float(slope) * len(speed)


def _span(capture: Capture, file: StageFile, rows: tuple[int, int], acceleration: float) -> SpeedSpan:
    """The span of `rows`, cut to whole revolutions from its end backwards."""
    start, end = rows
    turned = np.abs(capture.position[start:end] - capture.position[end - 1])
    revolutions = int(turned[0] / (2.0 * math.pi)) if file.axis.kind == ROTARY else 0
    if revolutions:
        start += int(np.argmin(np.abs(turned - 2.0 * math.pi * revolutions)))
    duration = (end - 1 - start) * capture.dt
    force = file.motor.force_constant * capture.current[start : end - 1]
    return SpeedSpan(
        capture.name,
        float(capture.time[start]),
        duration,
        revolutions,
        float(capture.position[end - 1] - capture.position[start]) / duration,
        float(np.mean(force)),
        _deviation(force, capture.position[start : end - 1], revolutions),
        acceleration,
        float(
            np.mean(np.abs(capture.current[start : end - 1]) > thresholds.AT_CURRENT_LIMIT * file.drive.current_limit)
        ),
    )


def _deviation(force: Array, angle: Array, revolutions: int) -> float:
    """Standard deviation of the mean: from the means of consecutive batches, ripple removed."""
    rest = force - np.mean(force)
    if revolutions:
        turn = angle[:, None] * np.arange(1, thresholds.RIPPLES + 1)
        ripple = np.hstack([np.cos(turn), np.sin(turn)])
        rest = rest - ripple @ np.linalg.lstsq(ripple, rest, rcond=None)[0]
    size = len(rest) // thresholds.SPAN_BATCHES
    means = rest[: size * thresholds.SPAN_BATCHES].reshape(thresholds.SPAN_BATCHES, size).mean(axis=1)
    return float(np.std(means, ddof=1)) / math.sqrt(thresholds.SPAN_BATCHES)


def _unit(file: StageFile) -> str:
    """Of the axis's speeds."""
    return unit_on(file.axis.kind, "rad/s | m/s")


def _clipped(span: SpeedSpan, file: StageFile) -> Note:
    return Note(
        Topic.CLIPPED,
        f"{span.name}: the span at {span.speed:.4g} {_unit(file)} from {span.start:.4g} s on is left out: its "
        f"current is at the drive's limit of {file.drive.current_limit:g} A for {100.0 * span.clipped:.0f} % of it",
    )


def straight_line(spans: list[SpeedSpan], both: bool) -> tuple[Array, NDArray[np.float64], float]:
    """Values (D, T_c and, of `both` directions, the offset), their covariance, and the scatter of the spans.

    The scatter is relative to that expected from the spans' own deviations; above 1 it widens the covariance.
    """
    speed = np.array([span.speed for span in spans])
    columns = [speed, np.sign(speed), np.ones(len(spans))]
    regressor = np.column_stack(columns if both else columns[:2])
    root = np.sqrt(np.array([span.duration for span in spans]))
    noise = float(np.sqrt(np.mean([span.deviation**2 * span.duration for span in spans])))  # of span second
    scaled = regressor * root[:, None]
    force = np.array([span.force for span in spans]) * root
    values, *_ = np.linalg.lstsq(scaled, force, rcond=None)
    freedom = len(spans) - len(values)
    residual = float(np.sqrt(np.sum((force - scaled @ values) ** 2) / freedom)) if freedom else 0.0
    covariance = np.linalg.inv(scaled.T @ scaled) * max(noise, residual) ** 2
    return np.asarray(values, dtype=np.float64), covariance, residual / noise if noise else 1.0


def _quantile(freedom: int, spans: int, scatter: float) -> float:
    """Student's for 95 %: the batches of all spans count where the line scatters no more than expected from them."""
    plain = freedom == 0 or scatter**2 * freedom <= stats.chi2.ppf(0.95, freedom)
    return float(
        stats.t.ppf(thresholds.QUANTILE_95, freedom + spans * (thresholds.SPAN_BATCHES - 1) if plain else freedom)
    )


def _check(spans: list[SpeedSpan], file: StageFile) -> bool:
    """Whether the spans have both directions; raises IdentificationError where they do not determine the parameters."""
    listed = ", ".join(f"{span.speed:.4g}" for span in spans) or "none"
    speeds = np.sort(np.abs([span.speed for span in spans]))
    different = 1 + int(np.sum(np.diff(speeds) > thresholds.SPEEDS_APART * speeds[1:])) if len(speeds) else 0
    both = len({span.speed > 0.0 for span in spans}) == 2
    if different < 2:
        text = (
            f"{different} different speeds in spans of constant speed longer than {thresholds.SHORTEST_SPAN:g} s; must "
            f"be at least 2 (found, in {_unit(file)}: {listed}): record trapezoids there and back at several speeds, "
            "five for example, to separate slope and Coulomb friction"
        )
        raise IdentificationError(text, Refusal.NO_STEADY_SPEED, value=different, admissible="[2, inf)")
    if both and len(spans) < 3:
        text = (
            f"one span each way, at different speeds ({listed} {_unit(file)}); slope, Coulomb friction and offset need "
            "three: record both speeds in both directions"
        )
        raise IdentificationError(text, Refusal.NO_STEADY_SPEED, value=len(spans), admissible="[3, inf)")
    return both


def _details(spans: list[SpeedSpan], parameters: dict[str, Parameter], scatter: float) -> dict[str, Any]:
    coulomb = parameters["coulomb"].value
    offset = parameters["offset"].value if "offset" in parameters else 0.0
    viscous = parameters["viscous"].value
    return {
        "spans": [span._asdict() for span in spans],
        "residual": [span.force - viscous * span.speed - math.copysign(coulomb, span.speed) - offset for span in spans],
        "coulomb_positive": coulomb + offset,
        "coulomb_negative": coulomb - offset,
        "scatter": scatter,
    }


def _doubts(spans: list[SpeedSpan], scatter: float, file: StageFile) -> list[Note]:
    notes = [
        Note(Topic.FORCE_CONSTANT, "the force constant is taken from the stage file: friction scales with it"),
        _offset_note(spans),
    ]
    broken = [span for span in spans if file.axis.kind == ROTARY and not span.revolutions]
    if broken:
        text = (
            f"{len(broken)} of {len(spans)} spans ({', '.join(f'{span.speed:.3g}' for span in broken[:6])} rad/s) are "
            "shorter than a revolution and averaged over time: torque ripple biases them; travel further"
        )
        notes.append(Note(Topic.REVOLUTION, text))
    inertia = file.mechanics.inertia
    inertial = max(abs(inertia * span.acceleration / span.force) if span.force else math.inf for span in spans)
    if inertial > thresholds.SPAN_INERTIAL:
        text = (
            f"the speed still changes within a span: by the stage file's inertia {percent(inertial)} of the force "
            f"there is inertial; must be below {100.0 * thresholds.SPAN_INERTIAL:g} %: record longer spans"
        )
        notes.append(Note(Topic.UNSETTLED, text))
    if scatter > thresholds.LINE_SCATTER and len(spans) > 4:
        text = (
            f"the means lie {scatter:.2g} times further from the line than expected from their noise: force over speed "
            "is not straight (Stribeck effect at low speed, lubrication, or the position along the travel); the "
            "intervals are wider for it"
        )
        notes.append(Note(Topic.RESIDUAL, text))
    return notes


def _offset_note(spans: list[SpeedSpan]) -> Note:
    if len({span.speed > 0.0 for span in spans}) == 1:
        text = (
            "all spans go one way: a constant effort such as gravity cannot be separated from Coulomb friction, and "
            "`coulomb` holds both; record the way back, too"
        )
    else:
        text = "the offset is gravity, a current sensor's zero and unequal Coulomb friction together"
    return Note(Topic.OFFSET, text)
