"""Captures that look wrong: an axis that did not move, units by a factor of a thousand, a clipped current.

The stage file is the measure: its limits, its encoder, and its model.  Nominal values may be wrong by a factor of three
without a complaint.
"""

import contextlib
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.config.stage_file import Setup
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal
from stagectl.identification.least_squares.method import identify as least_squares
from stagectl.identification.result import IdentificationResult, Note, Parameter, Topic
from stagectl.kernels import stage
from stagectl.number_format import duration, length
from stagectl.recording import wrong_units
from stagectl.recording.clipping import clipped
from stagectl.recording.scales import Scales
from stagectl.units import unit_on


def suspicions(capture: Capture, setup: Setup) -> list[Note]:
    """Reasons against using the capture, for the user; empty where there are none."""
    if words := wrong_units.by_pace(capture.dt):
        return [Note(Topic.UNITS, words)]
    if float(np.ptp(capture.position)) <= thresholds.MOVED_STEPS * capture.encoder_step:
        span = float(np.ptp(capture.position))
        unit = unit_on(setup.file.axis.kind, "rad | m")
        text = (
            f"the axis did not move: its positions span {span:.3g} {unit}, the encoder's step is "
            f"{capture.encoder_step:.3g} {unit}; record a motion"
        )
        return [Note(Topic.AT_REST, text)]
    if float(np.ptp(capture.current)) == 0.0:
        text = (
            f"{capture.current_column} is {capture.current[0]:g} A throughout, so it drove no motion; choose "
            "another column with --current, or record the current"
        )
        return [Note(Topic.CONSTANT_CURRENT, text)]
    motion = wrong_units.motion(capture.position, capture.current, capture.dt)
    doubts = [*_beyond_limits(capture, motion, setup), *_flat(capture, setup), *_frozen(capture, setup)]
    doubts += _swapped(capture)
    mistake = wrong_units.likely_mistake(motion, setup.stage)
    if mistake is not None:
        doubts.append(Note(Topic.UNITS, mistake.sentence))
    elif doubts and doubts[-1].topic is Topic.LIMIT:
        doubts[-1] = Note(Topic.LIMIT, f"{doubts[-1]}: {wrong_units.advice('position=3:mm')}")
    return doubts or _jumps(capture, setup)


def remarks(capture: Capture, scales: Scales) -> list[Note]:
    """What is doubtful, but may well be right."""
    step, coarse = capture.encoder_step, _position_step(capture.position)
    if step <= 0.0 or coarse < step or (_whole(coarse / step) and coarse <= thresholds.COARSE_STEPS * step):
        return []
    unit = unit_on(scales.kind, "rad | m")
    cause = (
        wrong_units.by_step(coarse / step, scales) or "the log lost digits, or its unit is not the one that it names"
    )
    text = f"positions come in steps of {coarse:.4g} {unit}, the encoder's is {step:.4g} {unit}: {cause}"
    return [Note(Topic.UNITS, text)]


def implausible(values: Mapping[str, float], nominal: stage.Stage) -> list[str]:
    """Results that are far from the stage file, and the wrong unit that would explain them; `values` in SI by name."""
    expected, far_off = force_scaled(nominal), thresholds.FAR_FROM_NOMINAL
    ratios = {name: values[name] / size for name, size in expected.items() if size > 0.0 and name in values}
    far = {name: ratio for name, ratio in ratios.items() if ratio <= 0.0 or not 1.0 / far_off < ratio < far_off}
    scale = _force_scale(ratios)
    named = ratios if scale else far
    words = [f"{name} is {values[name]:.3g}, {expected[name]:.3g} in the stage file" for name in named]
    return [f"{'; '.join(words)}: {scale or _ANOTHER}{_cause(ratios, bool(scale))}"] if words else []


def force_scaled(p: stage.Stage) -> dict[str, float]:
    """The parameters of `p` that scale with the force, in SI by name."""
    return {
        "inertia": p.mechanics.inertia,
        "viscous": p.mechanics.viscous,
        "coulomb": stage.sliding(p.friction),
    }


def contradictions(captures: Sequence[Capture], found: IdentificationResult, file: StageFile) -> list[str]:
    """Captures that fit well, each by itself, and have other parameters than the rest, beyond their intervals."""
    together = float(found.details.get("force_residual_percent", 0.0))
    if len(captures) < 2 or together < thresholds.CONTRADICTORY:
        return []
    alone = {}
    for capture in captures:
        with contextlib.suppress(IdentificationError):  # one that does not tell contradicts nothing
            by_itself = least_squares([capture], file)
            if by_itself.details["force_residual_percent"] < thresholds.APART * together:
                alone[capture.name] = by_itself.parameters
    return [words for name in _COMPARED if (words := _apart(name, alone))][:1]


_COMPARED = ("inertia", "coulomb", "viscous")  # the one that varies least from day to day first


def _apart(name: str, alone: Mapping[str, Mapping[str, Parameter]]) -> str:
    """What to say where the intervals of the parameter `name` have no value in common; empty where they have."""
    by_value = sorted((found[name].value, capture, found[name]) for capture, found in alone.items())
    if len(by_value) < 2 or by_value[0][2].high >= by_value[-1][2].low:
        return ""
    (low, first, one), (high, second, _) = by_value[0], by_value[-1]
    return (
        f"the captures contradict each other: by itself {first} has {name} = {low:.3g} {one.unit}, {second} has "
        f"{high:.3g}: another machine, load or unit; identify them apart"
    )


def check_possible(values: Mapping[str, Parameter]) -> None:
    """Raise IdentificationError where the whole interval of the inertia is below 0: no machine has that.

    A Coulomb friction that is clearly above 0 speaks for the columns and their signs.
    """
    inertia, coulomb = values.get("inertia"), values.get("coulomb")
    if inertia is not None and inertia.high < 0.0:
        rubs = coulomb is not None and coulomb.low > 0.0
        text = (
            f"inertia = {inertia.value:.3g} {inertia.unit} ({inertia.low:.3g} to {inertia.high:.3g}); must be above 0: "
            f"{_FORCE_LACKING if rubs else _EXCHANGED}"
        )
        reason = Refusal.ILL_CONDITIONED if rubs else Refusal.IMPLAUSIBLE
        raise IdentificationError(text, reason, value=f"{inertia.value:.3g}", admissible="(0, inf)")


_EXCHANGED = "the columns of position and current may be exchanged, or one of them has the opposite sign"
_FORCE_LACKING = (
    "the friction is clear, so columns and signs are right; a force that is not in the model goes with the "
    "acceleration and hides that of the inertia (gravity, another joint, a late current): record larger "
    "accelerations, or go on with --doubtful for the friction"
)
_ANOTHER = "not the same machine, or a wrong unit"


def _force_scale(ratios: Mapping[str, float]) -> str:
    """What to say where all `ratios` to the stage file are one factor: that of the force; empty where they are not."""
    low, high = min(ratios.values(), default=0.0), max(ratios.values(), default=0.0)
    if len(ratios) < 3 or low <= 0.0 or high > thresholds.ONE_FACTOR * low:
        return ""
    off = math.exp(sum(map(math.log, ratios.values())) / len(ratios))
    if 1.0 / thresholds.FORCE_SCALE < off < thresholds.FORCE_SCALE:
        return ""
    size = f"{max(off, 1.0 / off):.3g} times too {'large' if off > 1.0 else 'small'}"
    scales = "the unit of its column, drive.wire.rated_current for one in %, motor.force_constant for a torque"
    return f"all of them are {size}, so it is the scale of the force, or another machine: check {scales}"


def _cause(ratios: Mapping[str, float], of_force: bool) -> str:
    """The mistakes that give what was found these `ratios` to the stage file's values; of the force's column alone."""
    if min(ratios.values()) <= 0.0:
        return ""
    possible = [each for each in wrong_units.MISTAKES if each.current > 0.0 and (each.current != 1.0 or not of_force)]
    off = {mistake: _decades(mistake, ratios) for mistake in possible}
    most = min(min(off.values()) + thresholds.ALIKE_DECADES, thresholds.CAUSE_DECADES)
    causes = [mistake.words for mistake, decades in off.items() if decades <= most]
    return f": it fits if {', or '.join(causes)}" if causes else ""


def _decades(mistake: wrong_units.Mistake, ratios: Mapping[str, float]) -> float:
    """Powers of ten by which a mistake misses the worst of the `ratios`."""
    return max(abs(math.log10(ratio / mistake.on_parameters[name])) for name, ratio in ratios.items())


def _jumps(capture: Capture, setup: Setup) -> list[Note]:
    """A step between two rows that no motion makes: a misread row, or lost rows that the times do not show."""
    steps = np.diff(capture.position)
    np.abs(steps, out=steps)
    row, usual = int(np.argmax(steps)), float(np.quantile(steps, 0.99))
    if steps[row] <= max(thresholds.JUMP * usual, thresholds.BEYOND_LIMIT * setup.file.limits.speed * capture.dt):
        return []
    axis = setup.file.axis
    size = length(axis.travel_per_unit * float(steps[row]), axis.travel_unit)
    text = (
        f"its position jumps by {size} within {duration(capture.dt)} at "
        f"{capture.time[row]:.6g} s: a misread value, or lost rows that the times do not show; cut the log there"
    )
    return [Note(Topic.JUMP, text)]


def _frozen(capture: Capture, setup: Setup) -> list[Note]:
    """The position does not change in any bit while a current flows that moves the axis: a dead encoder."""
    stride = max(int(0.25 * thresholds.FROZEN_ROWS * len(capture.position)), 1)  # a frozen stretch holds four of them
    if np.all(np.diff(capture.position[::stride]) != 0.0):
        return []
    edges = np.flatnonzero(np.diff(capture.position) != 0.0)
    ends = np.concatenate([[-1], edges, [len(capture.position) - 1]])
    longest = int(np.argmax(np.diff(ends)))
    first, last = int(ends[longest]) + 1, int(ends[longest + 1]) + 1
    p, still = setup.stage, capture.current[first:last]
    least = thresholds.FROZEN_FRICTION * stage.sliding(p.friction) / p.motor.force_constant
    pushed = float(np.mean(np.abs(still - still.mean()) > least)) if len(still) else 0.0
    if last - first < thresholds.FROZEN_ROWS * len(capture.position) or pushed < thresholds.PUSHED_ROWS:
        return []
    text = (
        f"its position is frozen from {capture.time[first]:.6g} s on, for {duration((last - first) * capture.dt)}, "
        f"while the current swings by up to {float(np.abs(still - still.mean()).max()):.3g} A: the encoder or its "
        "log stopped; cut the log there"
    )
    return [Note(Topic.FROZEN, text)]


def _swapped(capture: Capture) -> list[Note]:
    """A reference in steps beside a position without any, which it follows: what an encoder measured comes in steps.

    So does a reference that a controller rounds to counts; but that one leads.
    """
    if capture.reference is None or _position_step(capture.position) or not _position_step(capture.reference):
        return []
    ahead = (capture.position - capture.reference)[:-1] @ np.diff(capture.position)
    if ahead < 0.0:
        return []
    step = _position_step(capture.reference)
    words = f"its reference comes in steps of {step:.3g}, as of an encoder, its position in none: the two are swapped"
    return [Note(Topic.REFERENCE, f"{words}; exchange them in --columns or in the header, or go on with --doubtful")]


def _beyond_limits(capture: Capture, motion: wrong_units.Motion, setup: Setup) -> list[Note]:
    limits, axis = setup.file.limits, setup.file.axis
    unit, scale = axis.travel_unit, axis.travel_per_unit
    width = limits.travel[1] - limits.travel[0]
    fastest = float(np.abs(motion.velocity).max())
    peak, largest = float(np.abs(capture.current).max()), setup.file.drive.current_limit
    checks = (
        (float(np.ptp(capture.position)), width, scale, unit, "its positions span", "limits.travel is"),
        (fastest, limits.speed, scale, f"{unit}/s", "its largest speed is", "limits.speed is"),
        (peak, largest, 1.0, "A", "its largest current is", "drive.current_limit is"),
    )
    return [
        Note(Topic.LIMIT, f"{words} {factor * value:.3g} {name}, {limit_words} {factor * limit:.3g} {name}")
        for value, limit, factor, name, words, limit_words in checks
        if value > thresholds.BEYOND_LIMIT * limit
    ]


def _flat(capture: Capture, setup: Setup) -> list[Note]:
    rows = clipped(capture.current)
    if not len(rows):
        return []
    largest = float(np.abs(capture.current).max())
    known = "law" in capture.meta and capture.current_column != "command"
    if known and largest >= thresholds.AT_CURRENT_LIMIT * setup.file.drive.current_limit:
        return []  # the drive's own limit, in a current that it measured or commanded behind it
    level = abs(float(capture.current[rows[0]]))
    text = (
        f"the current is clipped: flat at {level:.4g} A in {len(rows)} of {len(capture.current)} rows, the first "
        f"at {capture.time[rows[0]]:.6g} s; the current that drove the motion there is not known: record "
        "with a smaller amplitude, or go on with --doubtful if the current was really flat"
    )
    return [Note(Topic.CLIPPED, text)]


def _position_step(position: Array) -> float:
    """The step of which all position changes are multiples; 0 where there is none.

    A change below the rounding of the positions themselves is none: every number is a multiple of it.
    """
    steps = np.abs(np.diff(position[: thresholds.STEP_ROWS]))
    rounding = float(np.spacing(np.abs(position).max())) / thresholds.WHOLE
    steps = steps[steps > 0.0]
    if len(steps) < 10 or steps.min() < rounding:
        return 0.0
    step = float(steps.min())
    return step if np.all(_whole(steps / step)) else 0.0


def _whole(counts: Array | float) -> Any:
    """Whether these are whole numbers, as far as a step is known."""
    return np.abs(counts - np.round(counts)) < thresholds.WHOLE
