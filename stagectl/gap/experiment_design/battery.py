"""The recommended battery, and the one that is held out: every effect has a motion in it that shows it.

Three sines alone hide what follows standstill, position and the base; so each coordinate has an experiment of its own:
speed (stairs), position (scan), displacement since reversal (micro-sines), rest (steps), frequency (multisine).
"""

from __future__ import annotations

from stagectl.config.stage_file import Setup
from stagectl.gap.effects.library import excited_by
from stagectl.gap.experiment_design import motions
from stagectl.gap.experiment_design.experiment import HELD_OUT, Experiment
from stagectl.gap.experiment_design.scale import Scale, scale_of, sine_effort
from stagectl.trajectories import Dwell, Sine, Trajectory

REPEATS, HELD_OUT_REPEATS = 3, 2


def battery(setup: Setup) -> tuple[Experiment, ...]:
    """What finds the effects: about 80 s of motion on a stage of 100 mm."""
    return made(scale_of(setup))


def made(p: Scale) -> tuple[Experiment, ...]:
    """The same, made for a stage of this scale."""
    return (*_sines(p), *_speed_and_place(p), *_micro(p), *_steps(p), *_multisines(p))


def held_out(setup: Setup) -> tuple[Experiment, ...]:
    """What checks them: other amplitudes, frequencies, speeds, dwells and phases; never used to find anything."""
    p = scale_of(setup)
    top, pre = motions.top_speed(p), p.presliding
    speeds = motions.logarithmic(top / 25.0, 0.85 * top, 4)
    slow = motions.sine(p, 0.22 * p.reach, 0.55, 2.0)
    found = (
        _sine(p, "check-sine-slow", slow, "A slower, longer sine than any that was used."),
        _sine(
            p, "check-sine-fast", motions.at_speed(p, 0.8 * _speed(p), 2.3, 4.0), "Between the sines that were used."
        ),
        _sine(p, "check-sine-strong", motions.strong(p, 0.7, 4.2), "Less current than the strong sine, and slower."),
        _made(p, "check-stairs", "Speeds between those of the stairs.", "stairs", *motions.stairs(p, speeds, 0.7)),
        _made(p, "check-scan", "The stroke, faster than the scan.", "scan", *motions.scan(p, 3.5, 0.08)),
        _made(p, "check-micro", "Between the micro-sines.", "micro", Dwell(0.1), motions.micro(p, 1.3, 70.0, 2.6)),
        _made(p, "check-steps", "Other steps, after other dwells.", "steps", *motions.steps(p, 2.5 * pre, (0.6, 2.0))),
        _carried(p, "check-multisine", motions.Place(0.55, 11, 0.08, 5.0, 400.0), "Other phases, lines and place."),
    )
    return tuple(one._replace(use=HELD_OUT) for one in found)


def _speed(p: Scale) -> float:
    """Peak speed of the sines (m/s)."""
    return p.speed / 6.0


def _sines(p: Scale) -> tuple[Experiment, ...]:
    share = "inertia grows with frequency, viscous friction does not"
    return (
        _sine(
            p, "sine-slow", motions.at_speed(p, _speed(p), 0.8, 2.0), f"Three sines of about one peak speed: {share}."
        ),
        _sine(p, "sine-medium", motions.at_speed(p, _speed(p), 1.6), f"Three sines of about one peak speed: {share}."),
        _sine(p, "sine-fast", motions.at_speed(p, 0.8 * _speed(p), 3.2, 4.0), f"The fastest of three sines: {share}."),
        _strong(p),
    )


def _strong(p: Scale) -> Experiment:
    """Near the current limit, or as near as the other limits allow; its words say how near."""
    motion = motions.strong(p, 0.85, 5.0)
    share = sine_effort(p, motion.amplitude, motion.frequency) / p.effort
    words = (
        f"A sine at {100.0 * share:.0f} % of the current limit: what scales with current, and what a drive cannot give."
    )
    return _made(p, "sine-strong", words, "sine-strong", motion)


def _speed_and_place(p: Scale) -> tuple[Experiment, ...]:
    top = motions.top_speed(p)
    speeds = motions.stairs(p, motions.logarithmic(top / 40.0, top, 6), 0.7)
    return (
        _made(
            p,
            "stairs",
            "Six speeds both ways: friction over speed, its curvature, and its two sides.",
            "stairs",
            *speeds,
        ),
        _made(p, "scan", "The stroke, slowly, both ways: what depends on the position.", "scan", *motions.scan(p, 6.0)),
    )


def _micro(p: Scale) -> tuple[Experiment, ...]:
    words = "A sine {} presliding: a dead zone shows no force first, rolling friction the most stiffness."
    sizes = (("above", 3.8, 200.0, "beyond"), ("within", 0.6, 60.0, "within"), ("deep", 0.15, 20.0, "deep within"))
    return tuple(
        _made(p, f"micro-{name}", words.format(where), "micro", Dwell(0.1), motions.micro(p, ratio, counts))
        for name, ratio, counts, where in sizes
    )


def _steps(p: Scale) -> tuple[Experiment, ...]:
    dwells = (0.3, 1.0, 3.0)
    small, large = motions.steps(p, 1.5 * p.presliding, dwells), motions.steps(p, p.short, dwells)
    rest = "after dwells of 0.3, 1 and 3 s: friction that grows at rest, and what rings after a step"
    return (
        _made(p, "steps-small", f"Steps of about the presliding length {rest}.", "steps", *small),
        _made(p, "steps-large", f"Steps far beyond presliding {rest}.", "steps", *large),
    )


def _multisines(p: Scale) -> tuple[Experiment, ...]:
    words = "All frequencies at once on a moving axis: resonances, delays, the current loop, at the {} of the stroke."
    places = (("low", 0.05, "low end", 1), ("middle", 0.375, "middle", 2), ("high", 0.7, "high end", 3))
    return tuple(
        _carried(p, f"multisine-{name}", motions.Place(share, seed, periods=1.5), words.format(where))
        for name, share, where, seed in places
    )


def _sine(p: Scale, name: str, motion: Sine, words: str) -> Experiment:
    return _made(p, name, words, "sine", motion)


def _made(p: Scale, name: str, words: str, family: str, *parts: Trajectory) -> Experiment:
    return Experiment(name, words, excited_by(family), motions.preconditioned(p, *parts), p.unit)


def _carried(p: Scale, name: str, place: motions.Place, words: str) -> Experiment:
    return Experiment(name, words, excited_by("multisine"), motions.carried(p, place), p.unit)
