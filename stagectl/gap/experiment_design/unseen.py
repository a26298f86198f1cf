"""Motions on which a closed gap is judged: neither a diagnosis nor a tuning has seen their like."""

from stagectl.config.stage_file import Setup
from stagectl.gap.experiment_design import thresholds
from stagectl.gap.experiment_design.experiment import HELD_OUT, Experiment, Recipe, made
from stagectl.gap.experiment_design.motions import sine
from stagectl.gap.experiment_design.stage_scale import (
    StageScale,
    largest_acceleration,
    largest_amplitude,
    largest_speed,
    rounded,
    scale_of,
)
from stagectl.trajectories import Dwell, Sequence
from stagectl.trajectories.periodic import Sine
from stagectl.trajectories.profiles import SCurve

_SHARE = 0.35  # of current and limits that the motions take; chosen: room for the feedback of a wrong model
_JERK_TIME = 0.04  # s in which the acceleration rises; chosen: as a machine's moves
_STROKE, _STEP = 0.4, 0.03  # of the shorter way to an end; chosen


def unseen(setup: Setup) -> tuple[Experiment, ...]:
    """A sine, strokes of limited jerk, and stop and go, made for this stage.

    Raises GapError where the stage has no room to move.
    """
    return tuple(map(_at_rest_first, made(scale_of(setup), _RECIPES, HELD_OUT)))


def judged(one: Experiment) -> tuple[float, float]:
    """The window (s) of its tracking error: from the end of the preconditioning reversal on.

    Until then the error is that of a friction state which earlier motions left, and which no model can know.
    """
    motion = one.trajectory
    assert isinstance(motion, Sequence)
    rest, reversal, *_ = motion.parts
    return rest.duration + reversal.duration, motion.duration


def _at_rest_first(one: Experiment) -> Experiment:
    """The same after a standstill: no current comes before the delay is over, whatever a model knows.

    Without it a jump of the acceleration in the first period is the largest error of all that follows.
    """
    motion = one.trajectory
    assert isinstance(motion, Sequence)
    return one._replace(trajectory=Sequence((Dwell(thresholds.REST), *motion.parts)))


def _sine(p: StageScale) -> tuple[Sine, ...]:
    return (sine(p, largest_amplitude(p, _SHARE, 1.15), 1.15, 3.0),)


def moves(p: StageScale, distance: float, dwell: float, count: int, one_way: bool) -> tuple[SCurve, ...]:
    """Strokes of limited jerk over a `distance` (m | rad), with a `dwell` (s) after each."""
    speed = largest_speed(p, _SHARE)
    slope = largest_acceleration(p, _SHARE, speed)
    return (SCurve(distance, rounded(speed), rounded(slope), rounded(slope / _JERK_TIME), dwell, count, one_way),)


_RECIPES = {
    "unseen-sine": Recipe("A sine of a frequency that no experiment has.", _sine),
    "unseen-strokes": Recipe(
        "Long strokes of limited jerk.", lambda p: moves(p, rounded(_STROKE * p.reach), 0.1, 2, False)
    ),
    "unseen-stop-and-go": Recipe(
        "Short moves in one direction, with stops.", lambda p: moves(p, rounded(_STEP * p.reach), 0.2, 6, True)
    ),
}
