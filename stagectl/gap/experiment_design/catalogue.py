"""The catalogue that the next experiment is chosen from: each separates effects that others leave ambiguous."""

from __future__ import annotations

from stagectl.config.stage_file import Setup
from stagectl.gap.experiment_design import motions
from stagectl.gap.experiment_design.experiment import Experiment, Recipe, made
from stagectl.gap.experiment_design.motions import CarriedMultisine, carried, micro, steps
from stagectl.gap.experiment_design.stage_scale import scale_of
from stagectl.trajectories import Dwell


def library(setup: Setup) -> tuple[Experiment, ...]:
    """All of them, made for this stage.

    Raises GapError where the stage has no room or no current to move.
    """
    return made(scale_of(setup), RECIPES)


_SPREAD = "Speeds both ways, log-spaced over {}: "
_LINES = "An odd multisine of 3 to 500 Hz on a moving axis, at the {} of the stroke: resonance against delay."

RECIPES = (
    Recipe(
        "sines-of-one-speed",
        "A slow and a fast sine of one peak speed: inertia acts in the fast one alone, friction in both.",
        motions.equal_speed_sines,
    ),
    Recipe(
        "stairs-wide",
        _SPREAD.format("two decades") + "viscous friction, its curvature and the Stribeck rise.",
        lambda p: motions.speeds(p, 0.01, 1.0, 9, 0.8),
    ),
    Recipe(
        "stairs-creep",
        _SPREAD.format("the slowest decade and a half") + "a Stribeck rise ends there, curvature has not begun.",
        lambda p: motions.speeds(p, 0.002, 0.06, 6, 1.5),
    ),
    Recipe(
        "stairs-fast",
        _SPREAD.format("the fastest quarter") + "curvature of viscous friction, and its two sides.",
        lambda p: motions.speeds(p, 0.25, 1.0, 6, 0.8),
    ),
    Recipe(
        "creep",
        "A slow creep: the encoder's periods and the steps of the command, one at a time.",
        motions.creep,
    ),
    Recipe(
        "constant-speed-long",
        "Most of the stroke at constant speed: what does not repeat with the turn of the screw drifts relative to it.",
        lambda p: motions.constant(p, 0.2),
    ),
    Recipe(
        "constant-speed-fast",
        "Most of the stroke at two speeds: errors of the encoder grow with speed squared, forces do not.",
        lambda p: motions.constant(p, 0.35, 0.9),
    ),
    Recipe(
        "scan-slow",
        "The stroke both ways, slowly: a spring pushes one way, friction opposes both.",
        lambda p: motions.scan(p, 15.0),
    ),
    Recipe(
        "scans-at-two-speeds",
        "The stroke at two speeds both ways: what stays in place, and what moves with speed.",
        motions.two_scans,
    ),
    Recipe(
        "scan-at-two-loads",
        "A few pitches at little and at much current: ripple grows with current, cogging does not.",
        motions.two_loads,
    ),
    Recipe(
        "speeds-by-acceleration",
        "One speed reached at accelerations over a decade: friction that follows the load is not inertia.",
        motions.accelerations,
    ),
    Recipe(
        "strokes",
        "Three strokes of the millimetre range: a cable's hysteresis is longer than rolling friction's.",
        motions.strokes,
    ),
    Recipe(
        "micro-sweep",
        "Micro-sines, smaller and smaller: play is first slack and then stiff, rolling friction the opposite.",
        lambda p: motions.sizes(p, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.12),
    ),
    Recipe(
        "micro-slow",
        "A slow sine within presliding: steps of command and encoder stand out.",
        lambda p: (Dwell(0.1), micro(p, 0.5, 20.0, 0.3, 2.0)),
    ),
    Recipe(
        "micro-fast",
        "A fast sine just beyond presliding: separates what lags behind velocity from what follows displacement.",
        lambda p: (Dwell(0.1), micro(p, 3.0, 20.0, 8.0, 12.0)),
    ),
    Recipe(
        "reversals",
        "Turning round at rates over two decades: rolling friction follows displacement, a lag follows time.",
        motions.reversals,
    ),
    Recipe(
        "dwells",
        "Steps after 0.1, 1, 5 and 30 s of rest: only friction that grows with time at rest makes them differ.",
        lambda p: steps(p, p.short, (0.1, 1.0, 5.0, 30.0)),
    ),
    Recipe(
        "dwells-short",
        "Small steps after 0.1, 0.3 and 1 s of rest: dwell within presliding.",
        lambda p: steps(p, 2.0 * p.presliding, (0.1, 0.3, 1.0)),
    ),
    Recipe(
        "swing-one-way",
        "One way at a swinging speed: at one speed it passes accelerating and braking, so a lag opens a loop.",
        lambda p: motions.swings(p, 0.06, 2.0),
    ),
    Recipe(
        "swing-three-rates",
        "One way at a speed that swings at three rates: the loop of a lag grows with the rate.",
        lambda p: motions.swings(p, 0.1, 1.0, 3.0, 9.0),
    ),
    Recipe(
        "resonance-low",
        _LINES.format("low end"),
        lambda p: carried(p, CarriedMultisine(0.05, 21, periods=3.0)),
        family="resonance",
    ),
    Recipe(
        "resonance-middle",
        _LINES.format("middle"),
        lambda p: carried(p, CarriedMultisine(0.375, 22, periods=3.0)),
        family="resonance",
    ),
    Recipe(
        "resonance-high",
        _LINES.format("high end"),
        lambda p: carried(p, CarriedMultisine(0.7, 23, periods=3.0)),
        family="resonance",
    ),
    Recipe(
        "resonance-of-the-base",
        "An odd multisine of 5 to 60 Hz on a moving axis: a base that moves, against a compliance within the axis.",
        lambda p: carried(p, CarriedMultisine(0.375, 24, 0.15, 5.0, 60.0, 3.0)),
    ),
    Recipe(
        "step-and-settle",
        "Stops from speed and time to ring out: the base goes on moving when the axis stands still.",
        lambda p: motions.settling(p, 0.75),
    ),
    Recipe(
        "strong-sine",
        "A long sine at nine tenths of the current, or of the limit that it meets first: what a drive cannot give.",
        lambda p: (motions.strong(p, 0.9, 5.0, 10.0),),
    ),
    Recipe(
        "fast-cruise",
        "As fast as travel and current allow: a voltage limit shows with speed, a current limit does not.",
        motions.fast_cruise,
    ),
    Recipe(
        "rest",
        "Standing still for 10 s: noise, steps of the command, limit cycles.",
        motions.rest(10.0),
    ),
    Recipe(
        "rest-at-places",
        "Rest at seven places, reached from below and above: a constant force, a spring, and friction's two sides.",
        motions.places,
    ),
    Recipe(
        "one-stroke-again",
        "One stroke again and again for 40 s: a change from one moment to the next, within a run.",
        lambda p: motions.warm_up(p, 40.0),
        family="warm-up",
    ),
    Recipe(
        "warm-up",
        "The same for 5 minutes; run it cold, and again after a break: what changes with time, and what does not.",
        lambda p: motions.warm_up(p, 300.0),
    ),
)
