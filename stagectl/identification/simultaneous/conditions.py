"""What a capture must contain to tell inertia, viscous and rolling friction apart; what does not is refused.

The paper's two restrictions: the motion reverses, so that the rolling friction appears; and somewhere velocity and
acceleration have the same sign, as else ``dJ a = -dD w`` may hide both errors (Simultaneous Identification ...,
section IV.B).
"""

from __future__ import annotations

import math

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.simultaneous.regressors import acceleration, knots, position_noise, shortest_knots
from stagectl.identification.simultaneous.slip_range import Range
from stagectl.identification.simultaneous.smoothing import HALF, KNOTS, window
from stagectl.number_format import duration, length

SHORTEST = 0.2  # s of record
STEPS = 100.0  # standard deviations of the position's noise that a motion must exceed
TURN = 0.05  # of the stroke, travel on both sides of a reversal
SLOW, WEAK = 0.02, 0.05  # of the largest: below it a velocity or an acceleration has no sign
NOISE = 4.0  # standard deviations of an acceleration that is none
BRAKED = -0.3  # correlation of current and velocity
AVERAGED = 0.12  # s
LOST = 0.1  # of the acceleration that may be noise
SAMPLED = 2e-3  # s, a sampling time at which the window is short enough
SETTLED = 0.5  # of the friction below a tenth of the longest slip: then it did settle, and something else changes
SAME = 10  # rows with velocity and acceleration of one sign


def usable(captures: list[Capture], file: StageFile) -> tuple[list[Capture], list[str]]:
    """Captures that meet the conditions, and why the others are left out.

    Raises IdentificationError where none does.
    """
    if not captures:
        raise IdentificationError("no capture to identify from; give at least one")
    wrong = {index: reason for index, one in enumerate(captures) if (reason := refusal(one, file))}
    if len(wrong) == len(captures):
        raise IdentificationError("; ".join(wrong.values()))
    used = [one for index, one in enumerate(captures) if index not in wrong]
    return used, [f"left out: {reason}" for reason in wrong.values()]


def refusal(capture: Capture, file: StageFile) -> str:
    """Why a capture cannot be used; empty where it can."""
    duration = len(capture.position) * capture.dt
    if duration < SHORTEST or len(capture.position) < 4 * HALF + 2:
        return (
            f"{capture.name} lasts {duration:.3g} s; must last at least {SHORTEST:g} s: record half a period of a "
            "motion there and back, better ten periods"
        )
    stroke, noise = float(np.ptp(capture.position)), position_noise(capture)
    if stroke <= STEPS * noise or stroke == 0.0:
        return (
            f"{capture.name} is at rest: it moves by {_travel(stroke, file)}, {stroke / max(noise, 1e-300):.3g} times "
            f"the noise of its position; must be more than {STEPS:g} times: record a motion with reversals"
        )
    turns = reversals(capture.position, TURN * stroke)
    if turns == 0:
        return (
            f"{capture.name} has 0 reversals of its motion; must have at least 1, as without one the rolling friction "
            "does not appear (first condition of the paper): record a motion there and back, such as a current sine"
        )
    if not _same_sign(capture):
        return (
            f"{capture.name} has no span in which velocity and acceleration have the same sign; must have one, as an "
            "error of the inertia and one of the viscous friction cancel otherwise (second condition of the paper): "
            "record the start of the motion, too, or a sine"
        )
    return _lost(capture, file) or _power(capture)


def _lost(capture: Capture, file: StageFile) -> str:
    """Why the acceleration is lost: in noise, or in the window that noise or sampling ask for."""
    share, span, rows = _noise_share(capture), 2.0 * KNOTS * knots(capture) * capture.dt, shortest_knots(capture)
    moved = f"{capture.name} moves by {_travel(float(np.ptp(capture.position)), file)}"
    least = 2.0 * KNOTS * rows * capture.dt
    if span <= AVERAGED and share <= LOST:
        return ""
    if 2.0 * least > AVERAGED:
        return (
            f"{moved}, sampled every {duration(capture.dt)}; averaged over {1e3 * span:.3g} ms, {2 * KNOTS} sampling "
            f"times or more, {100.0 * share:.2g} % of its acceleration is noise of the position (at most "
            f"{100.0 * LOST:.0f} %, over at most {1e3 * AVERAGED:.0f} ms): sampled too slowly to see its reversals; "
            f"sample every {duration(SAMPLED)} or faster, or use least-squares"
        )
    told = (
        "the motion must go beyond presliding (first condition of the paper), and fast enough to tell the inertia: "
        "record a larger or faster one"
    )
    if span > AVERAGED:
        return (
            f"{moved}; its acceleration must be averaged over {1e3 * span:.3g} ms to rise above the noise of the "
            f"position, where at most {1e3 * AVERAGED:.0f} ms leave a reversal to be seen: {told}"
        )
    return (
        f"{moved}; averaged over {1e3 * span:.3g} ms, {100.0 * share:.2g} % of its acceleration is noise of the "
        f"position; must be at most {100.0 * LOST:.0f} %: {told}"
    )


def _power(capture: Capture) -> str:
    """Friction takes energy, so the current must on average push the way the axis moves."""
    q = knots(capture)
    velocity = acceleration(capture, q, 1)
    current = capture.current[HALF * q :: q][: len(velocity)]
    size = math.sqrt(float(np.mean(velocity * velocity)) * float(np.mean(current * current)))
    share = float(np.mean(velocity * current)) / size if size > 0.0 else 0.0
    if share >= BRAKED:
        return ""
    return (
        f"{capture.name}: current and velocity have opposite signs (correlation {share:.2f}; must be at least "
        f"{BRAKED:g}), which would make friction negative; positive current must move the axis towards positive "
        "positions: turn the sign of one of the two columns"
    )


def _travel(value: float, file: StageFile) -> str:
    return length(value * file.axis.travel_per_unit, file.axis.travel_unit)


def _noise_share(capture: Capture) -> float:
    """Noise of the position in the acceleration over all of it, rms, with the window that is taken."""
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
    least = max(WEAK * float(np.abs(a).max()), NOISE * noise)
    moving = (np.abs(v) > SLOW * float(np.abs(v).max())) & (np.abs(a) > least)
    return int(np.sum(moving & (a * v > 0.0))) >= SAME


def check_settles(captures: list[Capture], ends: Range, file: StageFile) -> None:
    """Raise where the friction still changes at the end of the stroke: presliding, or friction that follows speed."""
    if ends.settles:
        return
    largest = max(captures, key=lambda one: float(np.ptp(one.position)))
    stroke, reached = _travel(float(np.ptp(largest.position)), file), _travel(ends.high, file)
    if ends.early >= SETTLED:
        raise IdentificationError(
            f"{largest.name} moves by {stroke}; {100.0 * ends.early:.0f} % of its friction settles within "
            f"{_travel(0.1 * ends.high, file)} of a reversal, and the rest still changes after {reached}; all of it "
            "must have settled after half of the motion: friction that depends on speed (Stribeck, LuGre) does this, "
            "and so does a spring or a cogging along the axis: fit the speed with friction-models; a larger motion "
            "helps only if it is rolling friction"
        )
    raise IdentificationError(
        f"{largest.name} moves by {stroke}, and the friction still rises after {reached} from "
        "a reversal; it must have settled after half of the motion, as the reversal must go beyond presliding "
        "(first condition of the paper): record a larger motion; if it stays so, the friction depends on speed "
        "(Stribeck, LuGre): fit that with friction-models"
    )


def check_sign(inertia: float, captures: list[Capture]) -> None:
    """Raise where the answer is no mechanics."""
    if inertia <= 0.0:
        raise IdentificationError(
            f"inertia = {inertia:.3g}; must be positive: position and current of {captures[0].name} do not belong to "
            "each other, or have opposite signs (positive current moves towards positive positions), or the motion "
            "stays in presliding, where friction is a spring: check the columns, or record a larger motion"
        )
