"""Logs of other hands: noise and friction that the stage file does not know, values of it that are wrong by far."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.api.record import MotionRecord
from stagectl.identification.capture import Array
from tests.conftest import CONFIG
from tests.identification import synthetic

STAGE = CONFIG / "ball-screw.yaml"


@pytest.fixture(scope="module")
def moved() -> MotionRecord:
    return sc.simulate(STAGE, CONFIG / "trajectories" / "sine-1.6hz.yaml")


@pytest.mark.parametrize("counts", [1.0, 10.0, 60.0])
def test_noise_that_the_stage_file_does_not_state_does_not_take_the_inertia(
    tmp_path: Path, moved: MotionRecord, counts: float
) -> None:
    """Nine counts of white noise had left 0.6 % of the inertia, within an interval of 2 %."""
    stage = sc.load_stage(STAGE)
    noise = counts * stage.setup.file.encoder.one_count * np.random.default_rng(3).standard_normal(len(moved["time"]))
    columns = (moved["time"], moved["measured"] + noise, moved["measured_current"], moved["reference"])
    log = tmp_path / "log.csv"
    header = "time_s,position_rad,current_A,reference_rad"
    np.savetxt(log, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.10g")
    found = sc.identify(STAGE, log).parameters
    truth = stage.setup.stage.mechanics
    assert found["inertia"].value == pytest.approx(truth.inertia, rel=0.01)
    assert found["viscous"].value == pytest.approx(truth.viscous, rel=0.01)
    assert found["coulomb"].value == pytest.approx(1.0, rel=0.02)


def test_a_loop_that_must_not_run_is_no_reason_to_refuse_a_log(tmp_path: Path, moved: MotionRecord) -> None:
    """Whatever moved the axis: no controller of the stage file takes part."""
    text = STAGE.read_text().replace("eds: drives/", f"eds: {CONFIG / 'drives'}/")
    stage = tmp_path / "stage.yaml"
    stage.write_text(text.replace("bandwidth: 40 Hz", "bandwidth: 130 Hz"))
    with pytest.raises(sc.StageError):
        sc.load_stage(stage)
    found = sc.identify(stage, moved, "least-squares").parameters
    assert found["inertia"].value == pytest.approx(0.01, rel=0.02)


INERTIA, VISCOUS, COULOMB, CONSTANT = 0.011, 0.13, 0.9, 0.72
COUNT = 2.0 * np.pi / 2**20


def held(log: Path, time: Array, position: Array, friction: Array) -> set[str]:
    """Names of the true values that the intervals hold, for a log of this motion under this friction (N m)."""
    dt = float(time[1] - time[0])
    velocity = np.gradient(position, dt)
    force = INERTIA * np.gradient(velocity, dt) + VISCOUS * velocity + friction
    current = force / CONSTANT + np.random.default_rng(5).normal(0.0, 0.03, len(time))
    rows = slice(2, -2)  # where the gradients are central
    table = np.column_stack([time[rows] - time[2], COUNT * np.round(position[rows] / COUNT), current[rows]])
    np.savetxt(log, table, delimiter=",", header="time_s,position_rad,current_A", comments="", fmt="%.12g")
    found = sc.identify(STAGE, log).parameters
    truth = {"inertia": INERTIA, "viscous": VISCOUS, "coulomb": COULOMB}
    return {name for name, value in truth.items() if found[name].low <= value <= found[name].high}


def test_a_stage_file_that_is_wrong_by_far_is_no_knowledge(tmp_path: Path) -> None:
    """Inertia and viscous friction a fourth and a sixth: the Coulomb friction was twice its value, without a word."""
    time = np.arange(20000) * 1e-4
    position = 8.0 * np.sin(2.0 * np.pi * 1.6 * time)
    velocity = np.gradient(position, 1e-4)
    force = INERTIA * np.gradient(velocity, 1e-4) + VISCOUS * velocity + COULOMB * np.tanh(velocity / 0.3)
    current = force[::100] / CONSTANT + np.random.default_rng(5).normal(0.0, 0.1, 200)
    log = tmp_path / "log.csv"
    header = "time_s,position_rad,current_A"
    np.savetxt(log, np.column_stack([time[::100], position[::100], current]), delimiter=",", header=header, comments="")
    wrong = {"mechanics.inertia": INERTIA / 4.0, "mechanics.viscous": VISCOUS / 6.0}
    found = sc.identify(sc.load_stage(STAGE).changed(wrong), log)
    for name, value in (("inertia", INERTIA), ("viscous", VISCOUS), ("coulomb", COULOMB)):
        assert found.parameters[name].low <= value <= found.parameters[name].high, name


def test_positions_that_are_read_early_and_late_do_not_take_the_inertia(tmp_path: Path) -> None:
    """By 0.3 ms every 5 ms: taken for the rounding of an encoder, it had taken 6 % of the inertia."""
    time = np.arange(4000) * 5e-3
    phases = [(1.5, 0.31, 0.0), (0.6, 0.83, 1.0), (0.3, 1.37, 2.0)]
    swing = np.array([size * np.exp(1j * (2.0 * np.pi * rate * time + phase)) for size, rate, phase in phases])
    rates = 2j * np.pi * np.array([[rate] for _, rate, _ in phases])
    position, velocity, acceleration = (np.sum(rates**order * swing, axis=0).imag for order in range(3))
    force = INERTIA * acceleration + VISCOUS * velocity + COULOMB * np.tanh(velocity / 5e-3)
    random = np.random.default_rng(1)
    read = position + velocity * random.normal(0.0, 0.3e-3, len(time))
    log = tmp_path / "log.csv"
    table = np.column_stack([time, read, force / CONSTANT + random.normal(0.0, 0.03, len(time))])
    np.savetxt(log, table, delimiter=",", header="time_s,position_rad,current_A", comments="", fmt="%.12g")
    found = sc.identify(STAGE, log).parameters
    assert found["inertia"].value == pytest.approx(INERTIA, rel=0.03)
    assert found["coulomb"].value == pytest.approx(COULOMB, rel=0.02)


def test_friction_that_follows_its_stribeck_curve_late_does_not_look_like_inertia(tmp_path: Path) -> None:
    """It is higher while the axis speeds up, as inertia is, which was 2.8 % too large within an interval of 1 %."""
    time = np.linspace(0.0, 8.0, 16000, endpoint=False)
    waves = ((0.9, 1.2, 0.0), (2.3, 0.5, 1.0), (3.7, 0.25, 2.0))
    position: Array = np.sum([size * np.sin(2.0 * np.pi * rate * time + phase) for rate, size, phase in waves], axis=0)
    velocity = np.gradient(position, 0.5e-3)
    curve = 0.4 * np.tanh(velocity / 0.05) * np.exp(-((velocity / 2.0) ** 2))
    late, kept = curve.copy(), float(np.exp(-0.5e-3 / 0.03))
    for k in range(1, len(time)):
        if curve[k] * late[k - 1] > 0.0 and abs(curve[k]) < abs(late[k - 1]):
            late[k] = curve[k] + kept * (late[k - 1] - curve[k])
    friction = COULOMB * np.tanh(velocity / 0.05) + late
    assert "inertia" in held(tmp_path / "log.csv", time, position, friction)


def test_a_delay_is_known_no_better_than_the_time_stamps(tmp_path: Path) -> None:
    """Stamps that come 20 to 40 ms apart: the interval was 1 ms on rows of 29 ms."""
    random = np.random.default_rng(4)
    time = np.cumsum(random.uniform(0.02, 0.04, 400))
    position = 8.0 * np.sin(2.0 * np.pi * 0.8 * time)
    velocity, acceleration = 40.2 * np.cos(2.0 * np.pi * 0.8 * time), -202.0 * np.sin(2.0 * np.pi * 0.8 * time)
    force = INERTIA * acceleration + VISCOUS * velocity + COULOMB * np.tanh(velocity / 0.3)
    table = np.column_stack([time - time[0], position, force / CONSTANT])
    log = tmp_path / "log.csv"
    np.savetxt(log, table, delimiter=",", header="time_s,position_rad,current_A", comments="", fmt="%.9g")
    delay = sc.identify(STAGE, log).parameters["delay"]
    assert delay.high - delay.low > 0.02


def test_a_log_is_read_as_import_reads_it(tmp_path: Path) -> None:
    """Headers of a drive's scope, with their units in brackets: what `stagectl import` guesses, identify does too."""
    header = "Time [s],Actual position [rad],Iq [A]"
    log = synthetic.write_csv(tmp_path / "scope.csv", synthetic.motion(), header)
    fit = sc.identify(STAGE, log)
    assert fit["inertia"].value == pytest.approx(synthetic.J, rel=0.02)
    assert "current is taken from 3" in str(fit)  # what is guessed is said
    record = sc.load_log(log, stage=STAGE)
    assert isinstance(record, MotionRecord)
    assert len(record["time"]) == synthetic.ROWS
