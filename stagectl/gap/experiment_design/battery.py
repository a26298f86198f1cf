"""The recommended battery, and the one that is held out: every effect has a motion in it that shows it.

Three sines alone hide what follows standstill, position and the base.  So each coordinate has an experiment of its own:
speed (stairs), position (scan), displacement since reversal (micro-sines), rest (steps), frequency (multisine).
"""

from __future__ import annotations

from stagectl.config.stage_file import Setup
from stagectl.gap.experiment_design import motions
from stagectl.gap.experiment_design.experiment import HELD_OUT, Experiment, Recipe, made
from stagectl.gap.experiment_design.motions import CarriedMultisine, carried, micro, scan, sine, stairs, steps, strong
from stagectl.gap.experiment_design.stage_scale import StageScale, scale_of, sine_effort
from stagectl.trajectories import Dwell, Sine

REPEATS, HELD_OUT_REPEATS = 3, 2


_GROWS = "inertia grows with frequency, viscous friction does not"
_DWELLS = (0.3, 1.0, 3.0)  # s
_AFTER = "after dwells of 0.3, 1 and 3 s: friction that grows at rest, and what rings after a step"
_AT_ONCE = "All frequencies at once on a moving axis: resonances, delays, the current loop, at the {} of the stroke."


def battery(setup: Setup) -> tuple[Experiment, ...]:
    """What finds the effects: about 80 s of motion on a stage of 100 mm."""
    return battery_for(scale_of(setup))


def battery_for(p: StageScale) -> tuple[Experiment, ...]:
    """The same, made for a stage of this scale."""
    return made(p, (*_SINES, _strong_sine(p), *_SPEED_AND_PLACE, *_MICRO_SINES, *_STEP_TRAINS, *_MULTISINES))


def held_out(setup: Setup) -> tuple[Experiment, ...]:
    """What checks them: other amplitudes, frequencies, speeds, dwells and phases; never used to find anything."""
    return made(scale_of(setup), _CHECKS, HELD_OUT)


def _of_one_speed(p: StageScale, share: float, frequency: float, periods: float = 3.0) -> tuple[Sine]:
    """A sine by its share of the peak speed of all sines, a sixth of the limit."""
    return (motions.at_speed(p, share * (p.speed / 6.0), frequency, periods),)


def _strong_sine(p: StageScale) -> Recipe:
    """Near the current limit, or as near as the other limits allow; its words say how near."""
    motion = strong(p, 0.85, 5.0)
    share = sine_effort(p, motion.amplitude, motion.frequency) / p.effort
    words = (
        f"A sine at {100.0 * share:.0f} % of the current limit: what scales with current, and what a drive cannot give."
    )
    return Recipe("sine-strong", words, lambda _: (motion,))


_SINES = (
    Recipe(
        "sine-slow",
        f"Three sines of about one peak speed: {_GROWS}.",
        lambda p: _of_one_speed(p, 1.0, 0.8, 2.0),
        family="sine",
    ),
    Recipe(
        "sine-medium",
        f"Three sines of about one peak speed: {_GROWS}.",
        lambda p: _of_one_speed(p, 1.0, 1.6),
        family="sine",
    ),
    Recipe(
        "sine-fast", f"The fastest of three sines: {_GROWS}.", lambda p: _of_one_speed(p, 0.8, 3.2, 4.0), family="sine"
    ),
)


def _speeds(p: StageScale, low: float, high: float, count: int) -> list[float]:
    top = motions.top_speed(p)
    return motions.logarithmic(top / low, high * top, count)


_SPEED_AND_PLACE = (
    Recipe(
        "stairs",
        "Six speeds both ways: friction over speed, its curvature, and its two sides.",
        lambda p: stairs(p, _speeds(p, 40.0, 1.0, 6), 0.7),
    ),
    Recipe("scan", "The stroke, slowly, both ways: all that depends on the place.", lambda p: scan(p, 6.0)),
)


def _micro(name: str, ratio: float, counts: float, where: str) -> Recipe:
    words = f"A sine {where} presliding: a dead zone shows no force first, rolling friction the most stiffness."
    return Recipe(f"micro-{name}", words, lambda p: (Dwell(0.1), micro(p, ratio, counts)), family="micro")


_MICRO_SINES = (
    _micro("above", 3.8, 200.0, "beyond"),
    _micro("within", 0.6, 60.0, "within"),
    _micro("deep", 0.15, 20.0, "deep within"),
)

_STEP_TRAINS = (
    Recipe(
        "steps-small",
        f"Steps of about the presliding length {_AFTER}.",
        lambda p: steps(p, 1.5 * p.presliding, _DWELLS),
        family="steps",
    ),
    Recipe(
        "steps-large", f"Steps far beyond presliding {_AFTER}.", lambda p: steps(p, p.short, _DWELLS), family="steps"
    ),
)


def _multisine(name: str, words: str, injection: CarriedMultisine) -> Recipe:
    return Recipe(name, words, lambda p: carried(p, injection), family="multisine")


_MULTISINES = (
    _multisine("multisine-low", _AT_ONCE.format("low end"), CarriedMultisine(0.05, 1, periods=1.5)),
    _multisine("multisine-middle", _AT_ONCE.format("middle"), CarriedMultisine(0.375, 2, periods=1.5)),
    _multisine("multisine-high", _AT_ONCE.format("high end"), CarriedMultisine(0.7, 3, periods=1.5)),
)

_CHECKS = (
    Recipe(
        "check-sine-slow",
        "A slower, longer sine than any that was used.",
        lambda p: (sine(p, 0.22 * p.reach, 0.55, 2.0),),
        family="sine",
    ),
    Recipe(
        "check-sine-fast", "Between the sines that were used.", lambda p: _of_one_speed(p, 0.8, 2.3, 4.0), family="sine"
    ),
    Recipe(
        "check-sine-strong",
        "Less current than the strong sine, and slower.",
        lambda p: (strong(p, 0.7, 4.2),),
        family="sine",
    ),
    Recipe(
        "check-stairs",
        "Speeds between those of the stairs.",
        lambda p: stairs(p, _speeds(p, 25.0, 0.85, 4), 0.7),
        family="stairs",
    ),
    Recipe("check-scan", "The stroke, faster than the scan.", lambda p: scan(p, 3.5, 0.08), family="scan"),
    Recipe("check-micro", "Between the micro-sines.", lambda p: (Dwell(0.1), micro(p, 1.3, 70.0, 2.6)), family="micro"),
    Recipe(
        "check-steps",
        "Other steps, after other dwells.",
        lambda p: steps(p, 2.5 * p.presliding, (0.6, 2.0)),
        family="steps",
    ),
    _multisine("check-multisine", "Other phases, lines and place.", CarriedMultisine(0.55, 11, 0.08, 5.0, 400.0)),
)
