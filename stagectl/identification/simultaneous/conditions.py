"""What a capture must contain to separate inertia, viscous and rolling friction; other captures are refused.

The paper's two restrictions: the motion reverses, so that the rolling friction appears; and somewhere velocity and
acceleration have the same sign, as otherwise ``dJ a = -dD w`` may hide both errors (Simultaneous Identification ...,
section IV.B).
"""

import math

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal
from stagectl.identification.simultaneous.windows import (
    HALF,
    KNOTS,
    acceleration,
    knots,
    position_noise,
    shortest_knots,
    window,
)
from stagectl.number_format import duration, length, percent


def checked(capture: Capture, file: StageFile) -> Capture:
    """The capture, if it meets the conditions.

    Raises IdentificationError where it cannot be used.
    """
    _check_motion(capture, file)
    _check_reversals(capture)
    _check_acceleration(capture, file)
    _check_power(capture)
    return capture


def _check_motion(capture: Capture, file: StageFile) -> None:
    """The record is long enough, and its motion exceeds the noise of its position."""
    seconds = len(capture.position) * capture.dt
    if seconds < thresholds.SHORTEST_RECORD or len(capture.position) < 4 * HALF + 2:
        raise IdentificationError(
            f"it lasts {seconds:.3g} s; must last at least {thresholds.SHORTEST_RECORD:g} s: record half "
            "a period of a motion there and back, better ten periods",
            Refusal.TOO_SHORT,
            value=seconds,
            unit="s",
            admissible=f"[{thresholds.SHORTEST_RECORD:g}, inf)",
        )
    stroke, noise = float(np.ptp(capture.position)), position_noise(capture)
    span = 2.0 * math.sqrt(2.0 * math.log(len(capture.position)))  # of as many normal values, in their deviations
    if stroke <= span * noise or stroke == 0.0:
        raise IdentificationError(
            f"the axis is at rest: it moves by {_travel(stroke, file)}, {stroke / max(noise, 1e-300):.3g} times "
            f"the noise of its position; must be more than {span:.2g} times: record a motion with "
            "reversals",
            Refusal.AT_REST,
            value=stroke / max(noise, 1e-300),
            admissible=f"({span:.2g}, inf)",
        )


def _check_reversals(capture: Capture) -> None:
    """The paper's two conditions."""
    stroke = float(np.ptp(capture.position))
    if reversals(capture.position, thresholds.REVERSAL_TRAVEL * stroke) == 0:
        text = (
            "the motion has 0 reversals; must have at least 1, as without one the rolling friction "
            "does not appear (first condition of the paper): record a motion there and back, such as a current sine"
        )
        raise IdentificationError(text, Refusal.NO_REVERSAL, value=0, admissible="[1, inf)")
    if not _same_sign(capture):
        raise IdentificationError(
            "the motion has no span in which velocity and acceleration have the same sign; must have one, as an "
            "error of the inertia and one of the viscous friction cancel otherwise (second condition of the paper): "
            "record the start of the motion, too, or a sine",
            Refusal.NO_SAME_SIGN,
        )


def _check_acceleration(capture: Capture, file: StageFile) -> None:
    """The acceleration must not be lost in noise, nor in the window that noise or sampling require."""
    share, span, rows = _noise_share(capture), 2.0 * KNOTS * knots(capture) * capture.dt, shortest_knots(capture)
    widest = _widest(capture)
    if span <= widest and share <= thresholds.LOST_ACCELERATION:
        return
    moved = f"the axis moves by {_travel(float(np.ptp(capture.position)), file)}"
    lost, most = percent(share), percent(thresholds.LOST_ACCELERATION)
    longest = f"{1e3 * widest:.0f} ms"
    larger = (
        "the motion must go beyond presliding (first condition of the paper), and be fast enough to determine the "
        "inertia: record a larger or faster one, or use least-squares, which filters more of it"
    )
    reason = Refusal.NOISE
    if thresholds.LEAST_KNOT_ROWS * rows * capture.dt > thresholds.LONGEST_KNOTS:
        reason = Refusal.SAMPLING
        text = (
            f", sampled every {duration(capture.dt)}; averaged over {1e3 * span:.3g} ms, {2 * KNOTS} sampling times "
            f"or more, {lost} of its acceleration is noise of the position (at most {most}, over at most "
            f"{longest}): sampled too slowly to resolve its reversals; sample every "
            f"{duration(thresholds.FAST_SAMPLING)} or faster, or use least-squares"
        )
    elif span > widest:
        text = (
            f"; its acceleration must be averaged over {1e3 * span:.3g} ms to rise above the noise of the position, "
            f"and reversals as frequent as its own can be seen with at most {longest}: {larger}"
        )
    else:
        text = (
            f"; averaged over {1e3 * span:.3g} ms, {lost} of its acceleration is noise of the position; must be at "
            f"most {most}: {larger}"
        )
    limit = f"[0, {thresholds.LOST_ACCELERATION:g}]"
    raise IdentificationError(moved + text, reason, value=share, admissible=limit)


def _widest(capture: Capture) -> float:
    """Longest time (s) over which an acceleration may be averaged: the slower the motion, the longer."""
    strokes = 1 + reversals(capture.position, thresholds.REVERSAL_TRAVEL * float(np.ptp(capture.position)))
    stroke = len(capture.position) * capture.dt / strokes
    return max(thresholds.LONGEST_WINDOW, thresholds.WINDOW_SHARE * stroke)


def _check_power(capture: Capture) -> None:
    """Friction takes energy, so on average the current must push the way the axis moves."""
    q = knots(capture)
    velocity = acceleration(capture, q, 1)
    current = capture.current[HALF * q :: q][: len(velocity)]
    size = math.sqrt(float(np.mean(velocity * velocity)) * float(np.mean(current * current)))
    share = float(np.mean(velocity * current)) / size if size > 0.0 else 0.0
    if share >= thresholds.BRAKED:
        return
    text = (
        f"current and velocity have opposite signs (correlation {share:.2f}; must be at least "
        f"{thresholds.BRAKED:g}), which would make friction negative; positive current must move the axis towards "
        "positive positions: turn the sign of one of the two columns"
    )
    raise IdentificationError(text, Refusal.OPPOSITE_SIGN, value=share, admissible=f"[{thresholds.BRAKED:g}, 1]")


def _travel(value: float, file: StageFile) -> str:
    return length(value * file.axis.travel_per_unit, file.axis.travel_unit)


def _noise_share(capture: Capture) -> float:
    """Share of the position's noise in the acceleration, rms, with the window that is used."""
    q = knots(capture)
    weights = window(q, capture.dt, 2)
    rms = float(np.sqrt(np.mean(acceleration(capture, q) ** 2)))
    return position_noise(capture) * math.sqrt(float(weights @ weights)) / max(rms, 1e-300)


def reversals(position: Array, travel: float) -> int:
    """Number of reversals with at least this `travel` before and after them."""
    count, heading, outermost = 0, 0, float(position[0])
    lowest = highest = outermost
    for x in position[:: max(1, len(position) // 5000)].tolist():
        lowest, highest = min(lowest, x), max(highest, x)
        if heading == 0:
            heading = 1 if x - lowest >= travel else -1 if highest - x >= travel else 0
            outermost = x
        elif heading * (x - outermost) > 0.0:
            outermost = x
        elif heading * (outermost - x) >= travel:
            count, heading, outermost = count + 1, -heading, x
    return count


def _same_sign(capture: Capture) -> bool:
    q = knots(capture)
    a, v = acceleration(capture, q), acceleration(capture, q, 1)
    weights = window(q, capture.dt, 2)
    noise = position_noise(capture) * math.sqrt(float(weights @ weights))
    least = max(thresholds.WEAK_ACCELERATION * float(np.abs(a).max()), thresholds.SIGNIFICANT_ACCELERATION * noise)
    moving = (np.abs(v) > thresholds.SLOW_MOTION * float(np.abs(v).max())) & (np.abs(a) > least)
    return int(np.sum(moving & (a * v > 0.0))) >= thresholds.SAME_SIGN_ROWS
