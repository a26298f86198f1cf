"""The batteries and the library: runnable on every stage, to the figures of the design, and back where they began."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.gap.experiment_design.battery import battery, held_out
from stagectl.gap.experiment_design.catalogue import MANUAL, library
from stagectl.gap.experiment_design.experiment import HELD_OUT, Experiment, number, yaml_of
from stagectl.gap.experiment_design.motions import wavering
from stagectl.gap.experiment_design.stage_scale import presliding, scale_of
from stagectl.gap.logs.session import GapError
from stagectl.kernels import friction, friction_bristle, stage
from stagectl.kernels.law import Setpoint
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.trajectories import CurrentMultisine, Excited, Sequence, Sine, Sum, Trapezoid, peaks
from tests.conftest import CONFIG

STAGES = ("ball-screw", "linear-slider", "emps")
COLUMN = {name: number for number, name in enumerate(Setpoint._fields)}
ROWS = 16_000  # longer ones of the library take more time to lay out than this test has
EFFECTS = """
    inertia force_constant viscous viscous_nonlinear coulomb coulomb_asymmetry viscous_asymmetry stribeck presliding
    dwell friction_lag load_friction position_friction lead_friction cogging current_ripple ball_pass_ripple
    encoder_eccentricity encoder_interpolation current_quantisation dead_time jitter current_loop current_saturation
    voltage_saturation current_gain current_offset bias cable_spring cable_hysteresis thermal_viscous thermal_coulomb
    friction_step backlash compliance base_vibration time_shift gravity torque_path cogging_map
"""  # the controller is recomputed from any log
ANGLES = [
    ("  lead: 12 mm", "  lead: 0 mm"),
    ("shortest: 0.3 um", "shortest: 0.157 mrad"),
    ("longest: 9 um", "longest: 4.71 mrad"),
    ("travel: [-50 mm, 50 mm]", "travel: [-20 rad, 20 rad]"),
    ("speed: 300 mm/s", "speed: 150 rad/s"),
    ("acceleration: 5 m/s^2", "acceleration: 2600 rad/s^2"),
    ("following_error: 0.2 mm", "following_error: 0.1 rad"),
    ("quick_stop_deceleration: 5 m/s^2", "quick_stop_deceleration: 2600 rad/s^2"),
]


@pytest.fixture(scope="module", params=STAGES)
def setup(request: pytest.FixtureRequest) -> Setup:
    return load_stage(CONFIG / f"{request.param}.yaml")


def both(setup: Setup) -> tuple[Experiment, ...]:
    return *battery(setup), *held_out(setup)


def named(setup: Setup, name: str) -> Experiment:
    return next(experiment for experiment in (*both(setup), *library(setup)) if experiment.name == name)


def parts(experiment: Experiment) -> list[object]:
    motion = experiment.trajectory.motion if isinstance(experiment.trajectory, Excited) else experiment.trajectory
    assert isinstance(motion, Sequence)
    return list(motion.parts)


def changed(tmp_path: Path, *changes: tuple[str, str]) -> Setup:
    """Stage A with other lines."""
    text = (CONFIG / "ball-screw.yaml").read_text()
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = tmp_path / "stage.yaml"
    path.write_text(text)
    return load_stage(path)


def test_all_of_the_batteries_run_on_every_stage(setup: Setup) -> None:
    """Within its limits (`plan` refuses what is not), and back where they began, so that the next one may follow."""
    for experiment in both(setup):
        rows = experiment.setpoints(setup)
        assert len(rows) == pytest.approx(experiment.duration / setup.dt, abs=6), experiment.name
        span = np.ptp(rows[:, COLUMN["reference"]])
        assert abs(rows[-1, COLUMN["reference"]]) < 1e-12 * span, experiment.name
        assert np.all(rows[:, COLUMN["closed"]] == 1.0), experiment.name


def test_the_library_runs_on_every_stage(setup: Setup) -> None:
    for experiment in library(setup):
        if experiment.duration < ROWS * setup.dt:
            rows = experiment.setpoints(setup)[:, COLUMN["reference"]]
            assert abs(rows[-1]) < 1e-12 * max(np.ptp(rows), 1e-9), experiment.name


def test_times_are_those_of_the_design(setup: Setup) -> None:
    assert 75.0 <= sum(experiment.duration for experiment in battery(setup)) <= 90.0
    assert 35.0 <= sum(experiment.duration for experiment in held_out(setup)) <= 50.0
    assert all(1.0 < experiment.duration < 310.0 for experiment in library(setup))


def test_names_and_uses(setup: Setup) -> None:
    names = [experiment.name for experiment in (*both(setup), *library(setup))]
    assert len(set(names)) == len(names)
    assert len(library(setup)) >= 28
    assert {experiment.use for experiment in battery(setup)} == {"diagnose"}
    assert {experiment.use for experiment in held_out(setup)} == {HELD_OUT}
    used = {experiment.trajectory for experiment in battery(setup)}
    assert not used & {experiment.trajectory for experiment in held_out(setup)}


def test_every_effect_has_an_experiment(ball_screw: Setup) -> None:
    """Each effect of the design's section 4 is what some experiment, or something done by hand, is for."""
    known = set(EFFECTS.split())
    for_them = {effect for experiment in (*both(ball_screw), *library(ball_screw)) for effect in experiment.effects}
    for_them |= {effect for manual in MANUAL for effect in manual.effects}
    assert for_them - known == set()
    assert known - for_them == set()


def test_the_text_is_the_experiment(setup: Setup, tmp_path: Path) -> None:
    """Read again as `run` reads it, each is the same to the last bit."""
    path = tmp_path / "motion.yaml"
    for experiment in (*both(setup), *library(setup)):
        path.write_text(yaml_of(experiment))
        assert load_trajectory(path, axis_of(setup)) == experiment.trajectory, experiment.name
        assert all(len(line) <= 118 for line in path.read_text().splitlines() if line.startswith("#"))
    assert "held out" in yaml_of(held_out(setup)[0])


def test_an_angle_stays_an_angle(tmp_path: Path) -> None:
    setup = changed(tmp_path, *ANGLES)
    path = tmp_path / "motion.yaml"
    for experiment in both(setup):
        path.write_text(yaml_of(experiment))
        assert load_trajectory(path, axis_of(setup)) == experiment.trajectory
    named(setup, "stairs").setpoints(setup)
    named(setup, "check-multisine").setpoints(setup)
    assert "velocity: 40 rad/s, acceleration: " in yaml_of(named(setup, "stairs"))


def test_sizes_on_stage_a_are_those_of_the_design(ball_screw: Setup) -> None:
    """Sines of 50, 8 and 2 um, steps of 20 um and 1 mm after 0.3, 1 and 3 s."""
    for name, amplitude in (("above", 50e-6), ("within", 8e-6), ("deep", 2e-6)):
        (sine,) = [part for part in parts(named(ball_screw, f"micro-{name}")) if isinstance(part, Sine)]
        assert sine.amplitude == pytest.approx(amplitude, rel=0.04)
    for name, distance in (("small", 20e-6), ("large", 1e-3)):
        steps = [part for part in parts(named(ball_screw, f"steps-{name}"))[1:] if isinstance(part, Trapezoid)]
        assert [step.dwell for step in steps] == [0.3, 1.0, 3.0]
        assert all(step.distance == pytest.approx(distance, rel=0.04) for step in steps)
    frequencies = [
        part.frequency
        for name in ("slow", "medium", "fast", "strong")
        for part in parts(named(ball_screw, f"sine-{name}"))
        if isinstance(part, Sine)
    ]
    assert frequencies == [0.8, 1.6, 3.2, 5.0]


def test_the_stairs_reach_their_speeds(ball_screw: Setup) -> None:
    """Six of them from 2 to 80 mm/s at equal ratios, each held both ways for a quarter of a second at least."""
    moves = [part for part in parts(named(ball_screw, "stairs"))[1:] if isinstance(part, Trapezoid)]
    steps = [move for move in moves if not move.one_way]
    speeds = np.array([step.velocity for step in steps])
    np.testing.assert_allclose(speeds[[0, -1]], [2e-3, 80e-3], rtol=0.01)
    np.testing.assert_allclose(np.diff(np.log(speeds)), math.log(40.0) / 5.0, rtol=0.01)
    for step in steps:
        t = np.arange(0.0, step.duration, 1e-3)
        velocity = step.at(t).velocity
        for way in (1.0, -1.0):
            assert np.sum(np.isclose(velocity, way * step.velocity, rtol=1e-9)) >= 250


def test_each_begins_with_a_reversal_beyond_presliding(setup: Setup) -> None:
    p = scale_of(setup)
    for experiment in (*both(setup), *library(setup)):
        first = parts(experiment)[0]
        assert isinstance(first, Trapezoid) and not first.one_way
        assert 4.0 * p.presliding <= first.distance * 1.01
        assert first.distance <= 0.2 * p.reach * 1.01


def test_the_strong_sine_is_near_the_limit_and_not_on_it(ball_screw: Setup) -> None:
    rows = driven(ball_screw, named(ball_screw, "sine-strong"))
    peak = np.abs(rows["command"]).max() / ball_screw.file.drive.current_limit
    assert 0.8 < peak < 0.95
    assert "at 85 % of the current limit" in yaml_of(named(ball_screw, "sine-strong"))
    emps = load_stage(CONFIG / "emps.yaml")  # its limit of acceleration comes first, and is said to
    assert "at 53 % of the current limit" in yaml_of(named(emps, "sine-strong"))


def driven(setup: Setup, experiment: Experiment) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    controller = design.design(setup.stage, setup.file.control)
    return simulate(setup, plan(setup, experiment.trajectory, controller.feedforward), controller.law)


def test_no_fault_on_the_gap_that_is_looked_for(ball_screw: Setup, tmp_path: Path) -> None:
    """A machine with a quarter more inertia, viscous and Coulomb friction follows, short of its current limit."""
    worse = (
        ("inertia: 0.010", "inertia: 0.0125"),
        ("viscous: 0.14", "viscous: 0.175"),
        ("coulomb: 1.0", "coulomb: 1.25"),
    )
    plant = changed(tmp_path, *worse)
    controller = design.design(ball_screw.stage, ball_screw.file.control)
    for name in ("stairs", "scan", "multisine-low", "sine-fast", "steps-large"):
        laid_out = plan(ball_screw, named(ball_screw, name).trajectory, controller.feedforward)
        rows = simulate(ball_screw, laid_out, controller.law, plant)
        assert np.abs(rows["error"]).max() < 0.2 * ball_screw.file.limits.following_error, name
        assert np.abs(rows["command"]).max() < ball_screw.file.drive.current_limit, name


def test_multisines_act_while_the_axis_moves_at_constant_speed(setup: Setup) -> None:
    """At three places, of odd lines in the band, and the axis never turns round under them."""
    places = []
    for where in ("low", "middle", "high"):
        experiment = named(setup, f"multisine-{where}")
        assert isinstance(experiment.trajectory, Excited)
        current = experiment.trajectory.current
        assert isinstance(current, CurrentMultisine)
        assert (current.low, current.high) == (3.0, min(500.0, 0.25 / setup.dt))
        rows = experiment.setpoints(setup)
        injected = np.flatnonzero(rows[:, COLUMN["injection"]])
        reference = rows[:, COLUMN["reference"]]
        steps = np.diff(reference[injected[0] - 10 : injected[-1] + 10])
        np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
        places.append(reference[injected[0]])
        measured = driven(setup, experiment)["measured"][injected[0] : injected[-1]]
        assert np.mean(np.diff(measured) * np.sign(steps[0]) > 0.0) > 0.95
    low, high = setup.file.limits.travel
    assert min(np.diff(places)) > 0.2 * (high - low)


def test_a_swing_never_turns_round(ball_screw: Setup) -> None:
    """Speed stays between 0.2 and 1.8 times the carrier's, fading in and out included."""
    there, back = wavering(scale_of(ball_screw), 5e-3, 0.6, 3.0, 4.0)
    assert isinstance(there, Sum) and there.end == -back.end
    carrier = there.parts[0]
    assert isinstance(carrier, Trapezoid)
    rise = carrier.velocity / carrier.acceleration
    t = np.linspace(rise, there.duration - carrier.dwell - rise, 20000)
    velocity = there.at(t).velocity[:-1] / carrier.velocity
    assert 0.2 < velocity.min() < 0.45
    assert 1.55 < velocity.max() < 1.8


def test_the_fastest_cruise_is_fast(ball_screw: Setup) -> None:
    """It holds 80 % of the current against friction alone: by the model (0.8 Kt i - T_c) / D."""
    experiment = named(ball_screw, "fast-cruise")
    assert isinstance(experiment.trajectory, Sequence)
    per_unit = ball_screw.file.axis.travel_per_unit
    expected = (0.8 * 0.72 * 15.0 - 1.0) / 0.14 * per_unit
    assert peaks(experiment.trajectory, ball_screw.dt).speed == pytest.approx(expected, rel=0.01)


def test_presliding_length_in_closed_form() -> None:
    """One operator: 1.95 slips.  Dahl of exponent 1: ln 40 T_c / sigma_0.  Several: as the kernel turns."""
    nothing = friction.Stribeck()
    single = stage.Friction(friction.bundle([2.0], [3e-6]), nothing)
    assert presliding(single) == pytest.approx(1.95 * 3e-6, rel=1e-3)
    dahl = friction_bristle.Bristle(5.0, 1e6)
    none = friction.bundle([0.0], [1.0])
    assert presliding(stage.Friction(none, nothing, dahl)) == pytest.approx(math.log(40.0) * 5e-6, rel=1e-12)
    assert presliding(stage.Friction(none, nothing)) == 0.0
    several = friction.bundle([1.0, 2.0, 0.5], [1e-6, 5e-6, 2e-5])
    state = friction.relaxed(several)
    friction.stops(several, state, -1e-3)
    steps, force = 0, 0.0
    while force < 0.95 * 3.5:
        force, steps = friction.stops(several, state, 1e-9), steps + 1
    assert presliding(stage.Friction(several, nothing)) == pytest.approx(1e-9 * steps, rel=2e-3)


def test_a_stage_without_room_or_current_is_told_so(tmp_path: Path) -> None:
    one_sided = changed(tmp_path, ("travel: [-50 mm, 50 mm]", "travel: [0 mm, 100 mm]"))
    with pytest.raises(GapError, match=r"limits\.travel = \[0, 0\.1\] m"):
        battery(one_sided)
    weak = changed(tmp_path, ("current_limit: 15 A", "current_limit: 2 A"), ("speed: 300 mm/s", "speed: 100 mm/s"))
    with pytest.raises(GapError, match=r"drive\.current_limit = 2 A"):
        library(weak)


def test_numbers_read_as_a_person_writes_them() -> None:
    assert number(0.0123, "m/s") == "12.3 mm/s"
    assert number(1.94e-6, "m") == "1.94 um"
    assert number(-0.045, "m") == "-45 mm"
    assert number(178.0, "rad/s^2") == "178 rad/s^2"
    assert number(0.3, "s") == "0.3 s"
