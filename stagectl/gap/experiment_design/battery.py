"""The recommended battery, and the one that is held out: every effect has a motion in it that shows it.

Three sines alone hide what follows standstill, position and the base.  So each coordinate has an experiment of its own:
speed (stairs), position (scan), displacement since reversal (micro-sines), rest (steps), frequency (multisine).
"""

from stagectl.config.stage_file import Setup
from stagectl.gap.experiment_design import motions
from stagectl.gap.experiment_design.experiment import HELD_OUT, Experiment, Recipe, made, multisines
from stagectl.gap.experiment_design.motions import CarriedMultisine, carried, micro, scan, sine, steps, strong
from stagectl.gap.experiment_design.stage_scale import StageScale, scale_of, sine_effort
from stagectl.trajectories import Dwell

_GROWS = "inertia grows with frequency, viscous friction does not"
_DWELLS = (0.3, 1.0, 3.0)  # s
_AFTER = "after dwells of 0.3, 1 and 3 s: friction that grows at rest, and what rings after a step"
_AT_ONCE = "All frequencies at once on a moving axis: resonances, delays, the current loop, at the {} of the stroke."


def battery(setup: Setup) -> tuple[Experiment, ...]:
    """What finds the effects: about 80 s of motion on a stage of 100 mm."""
    return battery_for(scale_of(setup))


def battery_for(p: StageScale) -> tuple[Experiment, ...]:
    """The same, made for a stage of this scale."""
    return made(p, {**_SINES, "sine-strong": _strong_sine(p), **_OTHERS})


def held_out(setup: Setup) -> tuple[Experiment, ...]:
    """What checks them: other amplitudes, frequencies, speeds, dwells and phases; never used to find anything."""
    return made(scale_of(setup), _CHECKS, HELD_OUT)


def _of_one_speed(share: float, frequency: float, periods: float, words: str) -> Recipe:
    """A sine by its share of the peak speed of all sines, a sixth of the limit."""
    return Recipe(words, lambda p: (motions.at_speed(p, share * (p.speed / 6.0), frequency, periods),), "sine")


def _strong_sine(p: StageScale) -> Recipe:
    """Near the current limit, or as near as the other limits allow; its words say how near."""
    motion = strong(p, 0.85, 5.0)
    share = sine_effort(p, motion.amplitude, motion.frequency) / p.effort
    words = (
        f"A sine at {100.0 * share:.0f} % of the current limit: what scales with current, and what a drive cannot give."
    )
    return Recipe(words, lambda _: (motion,))


def _micro(ratio: float, counts: float, where: str) -> Recipe:
    words = f"A sine {where} presliding: after a reversal a dead zone shows no force, rolling friction most stiffness."
    return Recipe(words, lambda p: (Dwell(0.1), micro(p, ratio, counts)), "micro")


_SINES = {
    "sine-slow": _of_one_speed(1.0, 0.8, 2.0, f"Three sines of about one peak speed: {_GROWS}."),
    "sine-medium": _of_one_speed(1.0, 1.6, 3.0, f"Three sines of about one peak speed: {_GROWS}."),
    "sine-fast": _of_one_speed(0.8, 3.2, 4.0, f"The fastest of three sines: {_GROWS}."),
}
_OTHERS = {
    "stairs": Recipe(
        "Six speeds in both directions: how friction depends on speed, and how the two directions differ.",
        lambda p: motions.speeds(p, 0.025, 1.0, 6, 0.7),
    ),
    "scan": Recipe(
        "The whole stroke, slowly, in both directions: what depends on the position.", lambda p: scan(p, 6.0)
    ),
    "micro-above": _micro(3.8, 200.0, "beyond"),
    "micro-within": _micro(0.6, 60.0, "within"),
    "micro-deep": _micro(0.15, 20.0, "deep within"),
    "steps-small": Recipe(
        f"Steps of about the presliding length {_AFTER}.", lambda p: steps(p, 1.5 * p.presliding, _DWELLS), "steps"
    ),
    "steps-large": Recipe(f"Steps far beyond presliding {_AFTER}.", lambda p: steps(p, p.short, _DWELLS), "steps"),
    **multisines("multisine", _AT_ONCE, 1, 1.5),
}
_CHECKS = {
    "check-sine-slow": Recipe(
        "A slower, longer sine than any that was used.", lambda p: (sine(p, 0.22 * p.reach, 0.55, 2.0),), "sine"
    ),
    "check-sine-fast": _of_one_speed(0.8, 2.3, 4.0, "Between the sines that were used."),
    "check-sine-strong": Recipe(
        "Less current than the strong sine, and slower.", lambda p: (strong(p, 0.7, 4.2),), "sine"
    ),
    "check-stairs": Recipe(
        "Speeds between those of the stairs.", lambda p: motions.speeds(p, 0.04, 0.85, 4, 0.7), "stairs"
    ),
    "check-scan": Recipe("The stroke, faster than the scan.", lambda p: scan(p, 3.5, 0.08), "scan"),
    "check-micro": Recipe("Between the micro-sines.", lambda p: (Dwell(0.1), micro(p, 1.3, 70.0, 2.6)), "micro"),
    "check-steps": Recipe(
        "Other steps, after other dwells.", lambda p: steps(p, 2.5 * p.presliding, (0.6, 2.0)), "steps"
    ),
    "check-multisine": Recipe(
        "Other phases, lines and place.",
        lambda p: carried(p, CarriedMultisine(0.55, 11, 0.08, 5.0, 400.0)),
        "multisine",
    ),
}
