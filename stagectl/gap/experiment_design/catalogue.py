"""The catalogue that the next experiment is chosen from: each separates effects that others leave ambiguous."""

import tomllib
from pathlib import Path
from typing import NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.gap.effects.library import excited_by
from stagectl.gap.experiment_design import motions
from stagectl.gap.experiment_design.experiment import Experiment, Recipe, made, multisines
from stagectl.gap.experiment_design.motions import CarriedMultisine, carried, micro, steps
from stagectl.gap.experiment_design.stage_scale import scale_of
from stagectl.trajectories import Dwell


def library(setup: Setup) -> tuple[Experiment, ...]:
    """All of them, made for this stage.  Raises GapError where the stage has no room or no current to move."""
    return made(scale_of(setup), RECIPES)


_SPREAD = "Speeds in both directions, log-spaced over {}: "
_LINES = "An odd multisine of 3 to 500 Hz on a moving axis, at the {} of the stroke: resonance against delay."

RECIPES = {
    "sines-of-one-speed": Recipe(
        "A slow and a fast sine of one peak speed: inertia acts in the fast one alone, friction in both.",
        motions.equal_speed_sines,
    ),
    "stairs-wide": Recipe(
        _SPREAD.format("two decades") + "viscous friction, its curvature and the Stribeck rise.",
        lambda p: motions.speeds(p, 0.01, 1.0, 9, 0.8),
    ),
    "stairs-creep": Recipe(
        _SPREAD.format("the slowest decade and a half") + "a Stribeck rise ends there, curvature has not begun.",
        lambda p: motions.speeds(p, 0.002, 0.06, 6, 1.5),
    ),
    "stairs-fast": Recipe(
        _SPREAD.format("the fastest quarter") + "curvature of viscous friction, and how the directions differ.",
        lambda p: motions.speeds(p, 0.25, 1.0, 6, 0.8),
    ),
    "creep": Recipe("A slow creep: the encoder's periods and the steps of the command, one at a time.", motions.creep),
    "constant-speed-long": Recipe(
        "Most of the stroke at constant speed: what does not repeat with the turn of the screw drifts relative to it.",
        lambda p: motions.constant(p, 0.2),
    ),
    "constant-speed-fast": Recipe(
        "Most of the stroke at two speeds: errors of the encoder grow with speed squared, forces do not.",
        lambda p: motions.constant(p, 0.35, 0.9),
    ),
    "scan-slow": Recipe(
        "The whole stroke, slowly, in both directions: a spring pushes in one direction, friction opposes both.",
        lambda p: motions.scan(p, 15.0),
    ),
    "scans-at-two-speeds": Recipe(
        "The stroke at two speeds, in both directions: what depends on the position, and what on the speed.",
        lambda p: (*motions.scan(p, 8.0), *motions.scan(p, 3.0)),
    ),
    "scan-at-two-loads": Recipe(
        "A few pitches at little and at much current: ripple grows with current, cogging does not.", motions.two_loads
    ),
    "speeds-by-acceleration": Recipe(
        "One speed reached at accelerations over a decade: friction that follows the load is not inertia.",
        motions.accelerations,
    ),
    "strokes": Recipe(
        "Three strokes of the millimetre range: a cable's hysteresis is longer than rolling friction's.",
        motions.strokes,
    ),
    "micro-sweep": Recipe(
        "Micro-sines, smaller and smaller: play is first slack and then stiff, rolling friction the opposite.",
        lambda p: motions.sizes(p, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.12),
    ),
    "micro-slow": Recipe(
        "A slow sine within presliding: steps of command and encoder stand out.",
        lambda p: (Dwell(0.1), micro(p, 0.5, 20.0, 0.3, 2.0)),
    ),
    "micro-fast": Recipe(
        "A fast sine just beyond presliding: separates what lags behind velocity from what follows displacement.",
        lambda p: (Dwell(0.1), micro(p, 3.0, 20.0, 8.0, 12.0)),
    ),
    "reversals": Recipe(
        "Turning round at rates over two decades: rolling friction follows displacement, a lag follows time.",
        motions.reversals,
    ),
    "dwells": Recipe(
        "Steps after 0.1, 1, 5 and 30 s of rest: only friction that grows with time at rest makes them differ.",
        lambda p: steps(p, p.short, (0.1, 1.0, 5.0, 30.0)),
    ),
    "dwells-short": Recipe(
        "Small steps after 0.1, 0.3 and 1 s of rest: dwell within presliding.",
        lambda p: steps(p, 2.0 * p.presliding, (0.1, 0.3, 1.0)),
    ),
    "swing-one-way": Recipe(
        "One way at a swinging speed: at one speed it passes accelerating and braking, so a lag opens a loop.",
        lambda p: motions.swings(p, 0.06, 2.0),
    ),
    "swing-three-rates": Recipe(
        "One way at a speed that swings at three rates: the loop of a lag grows with the rate.",
        lambda p: motions.swings(p, 0.1, 1.0, 3.0, 9.0),
    ),
    **multisines("resonance", _LINES, 21, 3.0),
    "resonance-of-the-base": Recipe(
        "An odd multisine of 5 to 60 Hz on a moving axis: a base that moves, against a compliance within the axis.",
        lambda p: carried(p, CarriedMultisine(0.375, 24, 0.15, 5.0, 60.0, 3.0)),
    ),
    "step-and-settle": Recipe(
        "Stops from speed and time to ring out: the base goes on moving when the axis stands still.",
        lambda p: motions.settling(p, 0.75),
    ),
    "strong-sine": Recipe(
        "A long sine at nine tenths of the current, or of the limit that it meets first: what a drive cannot give.",
        lambda p: (motions.strong(p, 0.9, 5.0, 10.0),),
    ),
    "fast-cruise": Recipe(
        "As fast as travel and current allow: a voltage limit shows with speed, a current limit does not.",
        motions.fast_cruise,
    ),
    "rest": Recipe("Standing still for 10 s: noise, steps of the command, limit cycles.", lambda _: (Dwell(10.0),)),
    "rest-at-places": Recipe(
        "Rest at seven places, reached from below and above: a constant force, a spring, and friction's two sides.",
        motions.places,
    ),
    "one-stroke-again": Recipe(
        "One stroke again and again for 40 s: a change from one moment to the next, within a run.",
        lambda p: motions.warm_up(p, 40.0),
        "warm-up",
    ),
    "warm-up": Recipe(
        "The same for 5 minutes; run it cold, and again after a break: what changes with time, and what does not.",
        lambda p: motions.warm_up(p, 300.0),
    ),
}


class ManualExperiment(NamedTuple):
    """A change by hand, or a reading, in words for the user."""

    name: str
    words: str  # what to do
    duration: float  # s, about

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that it separates."""
        return excited_by(self.name)


_BY_HAND = tomllib.loads((Path(__file__).parent / "by_hand.toml").read_text(encoding="utf-8"))
MANUAL = tuple(ManualExperiment(name, **record) for name, record in _BY_HAND.items())
