"""What a standstill takes off the friction: held while at rest, given up over the way that loads it again."""

from __future__ import annotations

import math

import pytest

from stagectl.kernels import cascade, feedback, law, unloading

P = unloading.Unloading(against=4.0, along=0.5, range=8.0)
INTEGRATING = feedback.Pid(0.0, 1.0, 0.0, 0.0)  # the error of each period is integrated half at a time
MOVING, RESTING = law.Setpoint(0.0, 0.0, 0.0, 1.0, 0.25), law.Setpoint(0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("held", "velocity", "change"),
    [
        (-3.0, 0.25, 1.0),
        (3.0, -0.25, -1.0),
        (3.0, 0.25, -0.125),
        (-3.0, -0.25, 0.125),
        (-0.5, 2.0, 0.5),
        (0.0, 2.0, 0.0),
    ],
)
def test_it_is_given_up_by_the_way_and_never_beyond_zero(held: float, velocity: float, change: float) -> None:
    assert unloading.given_up(P, unloading.State(0.0, held, 1.0), velocity) == change
    assert unloading.given_up(unloading.ABSENT, unloading.State(0.0, held, 1.0), velocity) == 0.0


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
