"""What a standstill takes off the friction: held while at rest, given up over the way that loads it again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stagectl.compensation.legs import Array
from stagectl.config.stage_file import Setup
from stagectl.design import design
from stagectl.kernels import cascade, feedback, friction, friction_bristle, friction_path, law, unloading
from stagectl.kernels.plant import Friction

P = unloading.Unloading(against=4.0, along=0.5, range=8.0)
INTEGRATING = feedback.Pid(0.0, 1.0, 0.0, 0.0)  # the error of each period is integrated half at a time
MOVING, RESTING = law.Setpoint(0.0, 0.0, 0.0, 1.0, 0.25), law.Setpoint(0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("held", "velocity", "change"),
    [
        (-3.0, 0.25, 1.0),
        (3.0, -0.25, -1.0),
        (3.0, 0.25, -3.0 * (1.0 - math.exp(-0.5 * 0.25 / 8.0))),
        (-3.0, -0.25, 3.0 * (1.0 - math.exp(-0.5 * 0.25 / 8.0))),
        (-0.5, 2.0, 0.5),
        (0.0, 2.0, 0.0),
    ],
)
def test_it_is_given_up_by_the_way_and_never_beyond_zero(held: float, velocity: float, change: float) -> None:
    assert unloading.given_up(P, unloading.State(0.0, held, 1.0), velocity) == pytest.approx(change, rel=1e-12)
    assert unloading.given_up(unloading.ABSENT, unloading.State(0.0, held, 1.0), velocity) == 0.0


BUNDLE, DAHL = friction.bundle([0.5] * 8, [1e-4 * 1.6**j for j in range(8)]), friction_bristle.Bristle(2.0, 1e3)
RUBBING = {
    "stop operators": Friction(BUNDLE, friction.Stribeck()),
    "Dahl": Friction(friction.bundle([0.0], [1.0]), friction.Stribeck(), DAHL),
}
STEP, TURNED_BACK = 2e-6, 2e-5  # rad


@pytest.mark.parametrize(
    ("name", "way", "within"),
    [("stop operators", 1.0, 1e-9), ("stop operators", -1.0, 0.27), ("Dahl", 1.0, 1e-2), ("Dahl", -1.0, 1e-2)],
)
def test_it_gives_up_what_the_friction_takes_again(ball_screw: Setup, name: str, way: float, within: float) -> None:
    """Friction that a standstill did not turn back, less friction that it did, along the next motion.

    For stop operators that reverse, the exponential is a mean: at any place within 27 % of what was held at first.
    """
    moved = np.concatenate([[0.0], 1.0 + way * STEP * np.arange(4001)])
    rested = np.concatenate([[0.0, 1.0], 1.0 - TURNED_BACK + way * STEP * np.arange(4001)])
    missing = _force(name, moved)[1:] - _force(name, rested)[2:]
    p = design(ball_screw.stage._replace(friction=RUBBING[name]), ball_screw.file.control).law.unloading
    held, velocity = missing / ball_screw.stage.motor.force_constant, way * STEP / ball_screw.dt
    x = unloading.State(0.0, -float(held[0]), 1.0)
    for current in held[1:]:
        x = unloading.after(p, x, velocity, unloading.given_up(p, x, velocity), 0.0)
        assert -x.unloaded == pytest.approx(current, abs=within * held[0])


def _force(name: str, path: Array) -> Array:
    """Friction (n,) along a path, from rest."""
    p = RUBBING[name]
    if p.bristle.coulomb == 0.0:
        out = np.empty(len(path))
        friction_path.gms(friction.Gms(p.operators, p.stribeck), friction.relaxed(p.operators), path, 1.0, out)
        return out
    columns = np.empty((len(path), 2))
    friction_path.bristle(p.bristle, path, 1.0, columns)
    return columns[:, 0]


def test_what_changes_at_rest_is_held_and_what_was_carried_before_stays() -> None:
    """A weight of 2 A is carried while it moves, and 3 A are taken away at rest."""
    p = law.Law(INTEGRATING, math.inf, unloading=P)
    x = law.AT_REST._replace(feedback=feedback.State(0.0, 2.0, 0.0))
    _, x = law.step(p, x, MOVING, 0.0)
    _, x = law.step(p, x, RESTING, 1.5)
    output, x = law.step(p, x, RESTING, 1.5)
    _, x = law.step(p, x, RESTING, 0.0)
    assert x.feedback.integral == -4.0 and x.unloading == unloading.State(2.0, -6.0, 1.0)
    given = []
    for _ in range(8):
        output, x = law.step(p, x, MOVING, 0.0)
        given.append(output.integral)
    assert given == [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 2.0, 2.0]


@pytest.mark.parametrize(
    ("sense", "carrying", "unloaded"), [(1.0, 3.0, 0.0), (-1.0, -3.0, 0.0), (1.0, -30.0, -8.0), (-1.0, 30.0, 8.0)]
)
def test_what_friction_cannot_have_changed_is_a_load_and_stays(sense: float, carrying: float, unloaded: float) -> None:
    """A change in the sense of the last motion, or by more than friction has."""
    state = unloading.after(P, unloading.State(0.0, 0.0, sense), 0.0, 0.0, carrying)
    assert state == unloading.State(0.0, unloaded, sense)


def test_an_axis_that_has_not_moved_yet_gives_nothing_up() -> None:
    """Its integral carries a weight, and nobody knows how much of it is friction."""
    p, x = law.Law(INTEGRATING, math.inf, unloading=P), law.AT_REST
    _, x = law.step(p, x, RESTING, -2.0)
    _, x = law.step(p, x, RESTING, 0.0)
    for _ in range(3):
        output, x = law.step(p, x, MOVING, 0.0)
        assert output.integral == 4.0


def test_a_cascade_gives_up_as_well() -> None:
    p = law.Law(feedback.ABSENT, math.inf, cascade.Cascade(1.0, 1.0, 0.5, dt=1.0), True, unloading=P)
    x = law.AT_REST._replace(unloading=unloading.State(0.0, -3.0, 1.0))
    with_it, _ = law.step(p, x, MOVING, 0.0)
    without, _ = law.step(p._replace(unloading=unloading.ABSENT), x, MOVING, 0.0)
    assert with_it.integral == without.integral + 1.0
    bare, _ = law.step(p, x, MOVING._replace(friction=0.0), 0.0)
    assert bare.integral == without.integral  # no friction is fed forward: nothing was laid out too high
