"""Low speed: the table of a 50 um sine at 0.05 Hz within 0.01 N m rms, as operators that compensate; refusals."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.identification.capture import Capture, IdentificationError, Refusal
from stagectl.identification.low_speed import Stroke, _fast, fitted, full_strokes, identify
from stagectl.identification.result import Characteristic, IdentificationResult, Topic, topics
from stagectl.kernels import friction
from tests.identification.virtual import MICRON, STAGE_A, Array, Machine, held

SETUP = load_stage(STAGE_A)
FILE, TC = SETUP.file, 1.0


def slow(machine: Machine, amplitude: float = 50.0, frequency: float = 0.05, seconds: float = 60.0) -> Capture:
    """A position sine (um) in closed loop, from rest."""
    t = machine.setup.dt * np.arange(round(seconds / machine.setup.dt))
    return held(machine, amplitude * MICRON * np.sin(2.0 * np.pi * frequency * t))


def truth(displacement: Array, operators: friction.StopOperators = SETUP.stage.friction.operators) -> Array:
    """The reversal table of the virtual stage's own operators."""
    weight, slip = np.array(operators.weight), np.array(operators.slip)
    return np.asarray(np.clip(displacement[:, None] / slip - 1.0, -1.0, 1.0) @ weight, dtype=np.float64)


@pytest.fixture(scope="module")
def identified() -> IdentificationResult:
    return identify([slow(Machine(SETUP))], FILE)


def check_table(result: IdentificationResult, rms: float) -> None:
    table = result.table
    assert table is not None
    error = table.force - truth(table.displacement)
    assert math.sqrt(np.mean(error**2)) <= rms
    assert np.max(np.abs(error)) <= 0.06


def test_table_within_a_hundredth(identified: IdentificationResult) -> None:
    check_table(identified, 0.01)
    for seed in (2, 3):
        check_table(identify([slow(Machine(SETUP, acting=0.0, sensed=0.045, seed=seed), seconds=35.0)], FILE), 0.01)


def test_coulomb_and_offset_with_their_intervals(identified: IdentificationResult) -> None:
    coulomb, offset = identified.parameters["coulomb"], identified.parameters["offset"]
    assert coulomb.value == pytest.approx(TC, abs=2e-3) and offset.value == pytest.approx(0.0, abs=2e-3)
    assert 1e-4 < coulomb.high - coulomb.value < 2e-3
    assert identified.details["settled"] == pytest.approx(10.3 * MICRON, rel=0.08)  # of the true table
    json.dumps(identified.details, allow_nan=False)


def test_the_interval_holds_the_viscous_force_of_the_motion() -> None:
    """A sine of 100 um adds D v: more than the ends of the strokes scatter."""
    coulomb = identify([slow(Machine(SETUP), amplitude=100.0, seconds=35.0)], FILE).parameters["coulomb"]
    assert coulomb.value > TC + 1e-3 and coulomb.low <= TC


def test_the_table_is_what_its_operators_make(identified: IdentificationResult) -> None:
    """Run by the kernel: saturated one way, then the other way."""
    table = identified.table
    assert table is not None and np.all(table.weight > 0.0)
    assert identified.changes["friction"] == {
        "law": "stop-operators",
        "weight": table.weight.tolist(),
        "slip": table.slip.tolist(),
    }
    p = friction.bundle(table.weight, table.slip)
    state = friction.relaxed(p)
    friction.stops(p, state, -1.0)
    moves = np.diff(table.displacement, prepend=0.0)
    assert [friction.stops(p, state, dx) for dx in moves.tolist()] == pytest.approx(table.force.tolist(), abs=1e-12)
    assert np.all(np.diff(table.force, 2) < 1e-9)  # bends one way only


def test_a_partial_reversal_is_compensated(identified: IdentificationResult) -> None:
    """2 um back and forth, where a plain table of displacement would be wrong: against the stage's own operators."""
    table = identified.table
    assert table is not None
    ours, own = friction.bundle(table.weight, table.slip), SETUP.stage.friction.operators
    states = friction.relaxed(ours), friction.relaxed(own)
    moves = np.diff(np.concatenate([[0.0, 60.0], 60.0 + 2.0 * (np.cos(np.linspace(0.0, 20.0, 400)) - 1.0)])) * MICRON
    forces = np.array([[friction.stops(ours, states[0], dx), friction.stops(own, states[1], dx)] for dx in moves])
    assert math.sqrt(np.mean((forces[:, 0] - forces[:, 1]) ** 2)) < 0.02


def test_gravity_is_the_offset() -> None:
    p = SETUP.stage
    machine = Machine(SETUP._replace(stage=p._replace(mechanics=p.mechanics._replace(bias=-0.3))))
    result = identify([slow(machine, seconds=35.0)], FILE)
    assert result.parameters["offset"].value == pytest.approx(0.3, abs=5e-3)
    check_table(result, 0.01)


@pytest.mark.parametrize(("coulomb", "stretch"), [(0.3, 0.5), (3.0, 2.0)])
def test_other_plants(coulomb: float, stretch: float) -> None:
    """Nothing in the method knows stage A: other forces, other distances."""
    p, own = SETUP.stage, SETUP.stage.friction.operators
    operators = friction.bundle([coulomb * a for a in own.weight], [stretch * d for d in own.slip])
    machine = Machine(SETUP._replace(stage=p._replace(friction=p.friction._replace(operators=operators))))
    result = identify([slow(machine, 120.0, 0.04, 75.0)], FILE)
    assert result.table is not None
    error = result.table.force - truth(result.table.displacement, operators)
    assert math.sqrt(np.mean(error**2)) <= 0.01 * max(1.0, coulomb)
    assert result.parameters["coulomb"].value == pytest.approx(coulomb, rel=0.02)


def test_its_own_model_is_solved() -> None:
    """Strokes made from three operators on the grid of slips: weights come back."""
    slip = np.geomspace(1e-3, 0.4, 28)  # the grid over strokes of 1 rad
    weight = np.zeros(28)
    weight[[3, 12, 20]] = 0.2, 0.5, 0.3
    s = np.linspace(0.0, 1.0, 4000)
    force = Characteristic.over(s, weight, slip).force
    fit = fitted([Stroke(1.0, s, force + 0.1, 1.0), Stroke(-1.0, s, force - 0.1, 1.0)], 0.0)
    assert fit.offset == pytest.approx(0.1)
    assert fit.residual < 1e-9
    assert fit.weight == pytest.approx([0.2, 0.5, 0.3]) and fit.slip == pytest.approx(slip[[3, 12, 20]])


def test_only_full_strokes_count() -> None:
    """Three periods from rest: five strokes between six reversals, up and down in turn."""
    strokes = full_strokes(slow(Machine(SETUP)), 0.72)
    assert [stroke.direction for stroke in strokes] == [-1.0, 1.0, -1.0, 1.0, -1.0]
    assert [stroke.duration for stroke in strokes] == pytest.approx([10.0] * 5, abs=0.3)
    for stroke in strokes:
        assert 94.0 * MICRON < stroke.displacement[-1] <= 95.5 * MICRON


def test_a_stroke_whose_approach_was_short_is_left_out() -> None:
    """From rest the friction is not at its end yet: half a stroke of approach will do, a third will not."""
    t = np.linspace(0.0, 60.0, 120001)
    for before, count in ((0.5, 3), (0.3, 2)):
        x = np.interp(t, [0.0, 10.0, 20.0, 40.0, 59.0, 60.0], [0.0, before, before - 1.0, before, before - 1.0, 0.1])
        capture = Capture("made", t, x * 100.0 * MICRON, np.sign(np.gradient(x)), 5e-4, encoder_step=6e-6)
        assert len(full_strokes(capture, 0.72)) == count


def test_viscous_and_inertial_force_add_up() -> None:
    """Of a sine of 0.5 rad at 4 rad/s: D X w + J X w^2."""
    mechanics = FILE.mechanics._replace(inertia=3.0, viscous=2.0)
    stroke = Stroke(1.0, np.array([0.0, 1.0]), np.zeros(2), 0.25 * math.pi)
    assert _fast([stroke], FILE._replace(mechanics=mechanics)) == pytest.approx(0.5 * (2.0 * 4.0 + 3.0 * 16.0))


def refused(**changes: Any) -> Capture:
    return slow(Machine(SETUP), 50.0, 0.2, 12.0)._replace(**changes)


def test_what_does_not_show_the_table_is_refused() -> None:
    good = refused()
    for capture, reason in (
        (slow(Machine(SETUP), seconds=9.0), Refusal.NO_REVERSAL),
        (slow(Machine(SETUP), 5.0, 0.2, 12.0), Refusal.FRICTION_UNSETTLED),
        (
            slow(Machine(SETUP), 1000.0, 4.0, 2.0),
            Refusal.TOO_FAST,
        ),
        (slow(Machine(SETUP), 0.4, 0.2, 12.0), Refusal.TOO_SHORT),
        (good._replace(current=-good.current), Refusal.OPPOSITE_SIGN),
        (good._replace(position=1e3 * good.position), Refusal.TOO_FAST),
        (good._replace(position=np.zeros(len(good.time))), Refusal.AT_REST),
    ):
        with pytest.raises(IdentificationError) as caught:
            identify([capture], FILE)
        assert caught.value.reason is reason


def test_doubts_are_noted() -> None:
    quick = identify([slow(Machine(SETUP), 50.0, 1.0, 4.0)], FILE)
    assert Topic.TOO_FAST in topics(quick.notes)
    short = identify([slow(Machine(SETUP), 15.0, 0.05, 60.0)], FILE)
    assert Topic.UNSETTLED in topics(short.notes)
