"""What a standstill takes off the friction: held while at rest, given up over the way that loads it again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stagectl.compensation import derived
from stagectl.compensation.legs import Array
from stagectl.config.stage_file import Setup
from stagectl.design import design
from stagectl.kernels import cascade, feedback, friction, friction_bristle, friction_path, law, unloading
from stagectl.kernels.plant import Friction
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.trajectories.profiles import SCurve

P = unloading.Unloading(against=4.0, along=0.5, range=8.0, stiffness=8.0, unseen=1.0)  # springs take all of it
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
    x = unloading.State(0.0, held, 1.0)
    given, after = unloading.given_up(P, x, velocity)
    assert given == pytest.approx(change, rel=1e-12) and after.unloaded == held + given
    assert unloading.given_up(unloading.ABSENT, x, velocity) == (0.0, x)


BUNDLE, NO_STOPS = friction.bundle([0.5] * 8, [1e-4 * 1.6**j for j in range(8)]), friction.bundle([0.0], [1.0])
RUBBING = {"stop operators": Friction(BUNDLE, friction.Stribeck())} | {
    f"Dahl {n:g}": Friction(NO_STOPS, friction.Stribeck(), friction_bristle.Bristle(2.0, 1e3, n))
    for n in (0.6, 1.0, 1.5, 2.0)
}
STEP, TURNED_BACK = 2e-6, 2e-5  # rad


def _resting(p: unloading.Unloading, taken: float, seen: float) -> unloading.State:
    """After a motion forward and a rest that has `taken` (A) while the axis was seen over so far (rad)."""
    moved = unloading.after(p, unloading.AT_REST._replace(left=0.0), 1.0, 0.0, 0.0)
    return unloading.after(p, moved, 0.0, seen, -taken)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("name", RUBBING)
def test_it_gives_up_what_the_friction_takes_again(ball_screw: Setup, name: str, way: float) -> None:
    """Friction that a standstill did not turn back, less friction that it did, along the next motion.

    For stop operators that reverse, the exponential is a mean: at any place within 27 % of what was held at first.
    """
    moved = np.concatenate([[0.0], 100.0 + way * STEP * np.arange(4001)])
    rested = np.concatenate([[0.0, 100.0], 100.0 - TURNED_BACK + way * STEP * np.arange(4001)])
    missing = _force(name, moved)[1:] - _force(name, rested)[2:]
    p = design(ball_screw.stage._replace(friction=RUBBING[name]), ball_screw.file.control).law.unloading
    held, velocity = missing / ball_screw.stage.motor.force_constant, way * STEP / ball_screw.dt
    x = _resting(p, float(held[0]), TURNED_BACK)
    within = {("stop operators", 1.0): 1e-9, ("stop operators", -1.0): 0.27}.get((name, way), 1e-2)
    for current in held[1:]:
        _, x = unloading.given_up(p, x, velocity)
        assert -(x.unloaded + x.bristle) == pytest.approx(current, abs=within * held[0])


def test_each_part_gives_up_by_its_own_law(ball_screw: Setup) -> None:
    """Springs what they can have given on the way that was seen, the bristle the rest; and each as it would alone."""
    both = Friction(BUNDLE, friction.Stribeck(), RUBBING["Dahl 2"].bristle)
    p = design(ball_screw.stage._replace(friction=both), ball_screw.file.control).law.unloading
    x = _resting(p, 1.0, TURNED_BACK)
    springs = p.stiffness * (TURNED_BACK + p.unseen)
    assert x.unloaded == pytest.approx(-springs) and x.bristle == pytest.approx(springs - 1.0)
    alone = design(ball_screw.stage._replace(friction=RUBBING["Dahl 2"]), ball_screw.file.control).law.unloading
    velocity = STEP / ball_screw.dt
    _, y = unloading.given_up(alone, _resting(alone, 1.0 - springs, 0.0), velocity)
    change, x = unloading.given_up(p, x, velocity)
    assert x.bristle == pytest.approx(y.bristle)
    assert change == pytest.approx(p.against * velocity + x.bristle - springs + 1.0)


def test_creep_that_the_model_does_not_foresee_is_loaded_again_as_a_bristle(ball_screw: Setup) -> None:
    """Stop operators fitted to Dahl's curve: what trembling took is no spring's, which is loaded long before."""
    creeping = design(ball_screw.stage._replace(friction=RUBBING["stop operators"]), ball_screw.file.control).law
    p, velocity = creeping.unloading, STEP / ball_screw.dt
    x = _resting(p, 1.0, 0.0)
    creep = 1.0 - p.stiffness * p.unseen
    assert x.bristle == pytest.approx(-creep)
    for k in range(1, 500):
        _, x = unloading.given_up(p, x, velocity)
        assert -x.bristle == pytest.approx(creep * math.exp(-k * p.along * velocity / p.range))


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
    assert x.feedback.integral == -4.0 and x.unloading[:4] == (2.0, -6.0, 1.0, 0.0)
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


TREMBLING = SCurve(2e-3, 20e-3, 1.0, 40.0, 0.3, 4, True)


def _error(known: Setup, machine: Setup) -> float:
    """Its rms (nm) on each start but the first, under the noise of a drive."""
    noisy = machine.having(simulation=machine.file.simulation._replace(current_noise=0.045))
    rows = simulate(known, plan(known, TREMBLING, known.controller.feedforward), known.controller.law, noisy)
    error = (rows["reference"] - rows["true_position"])[(rows["velocity"] != 0.0) & (rows["time"] > 0.3)]
    return float(np.sqrt(np.mean(error**2))) * known.file.axis.travel_per_unit * 1e9


@pytest.mark.parametrize("exponent", [0.6, 1.0, 2.0])
def test_a_standstill_under_noise_costs_no_accuracy_at_the_next_start(ball_screw: Setup, exponent: float) -> None:
    """Whatever the exponent of the bristle that is known: as with stop operators."""
    bristle = friction_bristle.Bristle(1.0, 1.0 / 2.5e-3, exponent)
    creeping = ball_screw._replace(
        stage=ball_screw.stage._replace(friction=Friction(NO_STOPS, friction.Stribeck(), bristle))
    )
    assert _error(creeping, creeping) < 1.35 * _error(ball_screw, ball_screw)


def test_a_machine_that_creeps_more_than_its_model_is_given_up_to_as_it_creeps(ball_screw: Setup) -> None:
    """Stop operators with the curve of Dahl's law, which creeps: 3.2 times the error of the right law, as springs."""
    law_of_dahl = Friction(NO_STOPS, friction.Stribeck(), friction_bristle.Bristle(1.0, 1.0 / 2.5e-3))
    elements = derived.block("gms", law_of_dahl)
    fitted = Friction(friction.bundle(elements["weight"], elements["slip"]), friction.Stribeck())
    machine, known = (ball_screw._replace(stage=ball_screw.stage._replace(friction=p)) for p in (law_of_dahl, fitted))
    assert _error(known, machine) < 1.4 * _error(machine, machine)
