"""An axis that friction holds as by a spring comes to rest where the design says so, and swings where it says that."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage
from stagectl.kernels import law
from stagectl.kernels.friction import Stribeck
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.trajectories import SCurve, Sine, Trapezoid
from stagectl.tuning.families import family
from stagectl.tuning.search import Demand, tuned
from tests.conftest import CONFIG, Command, varied

STAGES = [CONFIG / "xy.yaml#x", CONFIG / "xy.yaml#y", *sorted(set(CONFIG.glob("*.yaml")) - {CONFIG / "xy.yaml"})]
LAST = 2.0  # s that are looked at


def of_bandwidth(axis: str, bandwidth: float, substeps: int = 10) -> Setup:
    """An axis of the X-Y stage with another bandwidth (Hz)."""
    setup = load_stage(CONFIG / f"xy.yaml#{axis}")
    setup = varied(setup, band=0.0)  # the loop as it is beyond any band
    control, simulation = setup.file.control, setup.file.simulation._replace(substeps=substeps)
    assert isinstance(control, design.Control)
    return setup._replace(
        file=setup.file._replace(control=control._replace(bandwidth=bandwidth), simulation=simulation)
    )


def standing(setup: Setup) -> Any:
    """Tracking error (n,) rad of the last seconds, long after a move."""
    move = SCurve(10e-3, 5e-3, 0.5, 25.0, 25.0, one_way=True)
    controller = design.design(setup.stage, setup.file.control)
    return simulate(setup, plan(setup, move, controller.feedforward), controller.law)["error"][-int(LAST / setup.dt) :]


def swinging(setup: Setup) -> float | None:
    return design.limit_cycle_frequency(setup.stage, *design.loop_parts(setup.stage, setup.file.control))


@pytest.mark.parametrize("path", STAGES, ids=lambda path: path.stem + path.suffix)
def test_every_shipped_stage_comes_to_rest(path: Path) -> None:
    setup = load_stage(path)
    assert design.limit_cycle_warning(setup.stage, setup.file.control) == ""


@pytest.mark.parametrize(("axis", "bandwidth"), [("x", 8.0), ("y", 9.0)])
def test_where_it_is_said_to_it_comes_to_rest(axis: str, bandwidth: float) -> None:
    setup = of_bandwidth(axis, bandwidth)
    assert swinging(setup) is None
    assert np.ptp(standing(setup)) <= 6.0 * setup.stage.encoder.step


@pytest.mark.parametrize("substeps", [10, 20])
@pytest.mark.parametrize(("axis", "bandwidth"), [("x", 12.0), ("y", 14.0)])
def test_where_it_is_said_to_swing_it_does_at_that_frequency(axis: str, bandwidth: float, substeps: int) -> None:
    setup = of_bandwidth(axis, bandwidth, substeps)
    said, error = swinging(setup), standing(setup)
    spectrum = np.abs(np.fft.rfft(error - error.mean()))
    assert said is not None
    assert int(np.argmax(spectrum)) / LAST == pytest.approx(said, rel=0.1)  # what slips makes it softer
    shortest = float(min(setup.stage.friction.operators.slip))
    assert 0.5 * shortest < np.ptp(error) < 5.0 * shortest


def test_the_fastest_that_is_tuned_comes_to_rest() -> None:
    setup = of_bandwidth("x", 20.0)
    tuned_loop = tuned(family(setup.stage, setup.file.control, "pid"), Demand(setup.file.control.margin))
    assert 9.0 < tuned_loop.bandwidth < 10.0
    assert any("swings by itself" in words for words in tuned_loop.binding)


def test_a_loop_that_would_swing_is_told_before_it_moves(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    text = (CONFIG / "ball-screw.yaml").read_text().replace("eds: drives/", f"eds: {CONFIG}/drives/")
    path.write_text(text.replace("period: 0.5 ms", "period: 1 ms").replace("bandwidth: 40 Hz", "bandwidth: 20 Hz"))
    code, _, err = command("config", "check", path)
    assert code == 0
    assert "the loop oscillates at 80.3 Hz" in " ".join(err.split())
    _, _, err = command("simulate", path, CONFIG / "trajectories" / "sine-2um.yaml", "-o", tmp_path / "a.h5")
    assert "note: at standstill" in " ".join(err.split())


def falling(rise: float, velocity: float, lag: float = 0.0, substeps: int = 10) -> Setup:
    """The ball screw with a Stribeck rise that decays over this velocity (rad/s)."""
    setup = varied(BALL_SCREW, band=0.0)
    p, simulation = setup.stage, setup.file.simulation._replace(substeps=substeps)
    rubbing = p.friction._replace(stribeck=Stribeck(rise, velocity), lag=lag)
    return setup._replace(stage=p._replace(friction=rubbing)).having(simulation=simulation)


def slow_error(setup: Setup, speed: float) -> float:
    """Peak (m) of a slow motion at `speed` (rad/s) of a second, whose friction is known and compensated."""
    travel = speed * setup.file.axis.travel_per_unit
    laid_out = plan(setup, SCurve(travel, travel, 0.5, 25.0, 0.1, 1, True), setup.controller.feedforward)
    error = simulate(setup, laid_out, setup.controller.law)["error"]
    return float(np.abs(error).max()) * setup.file.axis.travel_per_unit


@pytest.mark.parametrize("substeps", [10, 20])
@pytest.mark.parametrize(("rise", "velocity"), [(0.4, 0.03), (0.4, 0.12), (0.4, 0.2), (0.1, 0.03)])
def test_below_the_speed_that_is_said_a_known_friction_sticks_and_slips(
    rise: float, velocity: float, substeps: int
) -> None:
    """The same motion without the rise ends within 15 nm at each of these speeds."""
    setup = falling(rise, velocity, substeps=substeps)
    speed = design.sticking_speed(setup.stage, *design.loop_parts(setup.stage, setup.file.control))
    assert speed is not None
    assert slow_error(setup, 0.8 * speed) > 70e-9
    assert slow_error(setup, 1.3 * speed) < 25e-9


def test_a_friction_that_falls_slowly_enough_or_late_is_held_at_any_speed() -> None:
    assert falling(0.4, 0.45).unrest == "" and falling(0.4, 0.03, lag=0.012).unrest == ""
    assert "stick" in falling(0.4, 0.03).unrest


BALL_SCREW = load_stage(CONFIG / "ball-screw.yaml")
SINE, ONE_COUNT = Sine(5e-3, 1.6, 3, 1), 1.0


@pytest.mark.parametrize("distance", [1e-3, -3.1e-3, 5.0037e-3, 10e-3])
def test_within_the_band_the_demo_rests_where_it_hunted(distance: float) -> None:
    """One count at most, in 1 % of the samples at most, and 5 mA of current about its mean; without the band more."""
    rest, hunt = (after_a_move(varied(BALL_SCREW, band=counts), distance) for counts in (ONE_COUNT, 0.0))
    assert np.ptp(rest["counts"]) <= 1.0
    assert np.mean(rest["counts"] != np.median(rest["counts"])) <= 0.01
    assert np.std(rest["current"]) <= 5e-3
    assert np.std(hunt["current"]) > 2.0 * np.std(rest["current"])


def after_a_move(setup: Setup, distance: float) -> dict[str, Any]:
    """Encoder counts and motor current (A) of the 3 s from 3 s after a move of `distance` (m) on.

    Most targets rest after 0.2 s; one that lies just beyond a count takes up to 3 s to be pulled inside the band.
    """
    stop = abs(distance) / 0.02 + 3.0
    move = Trapezoid(distance, 0.02, 1.0, dwell=6.5)
    rows = simulate(setup, plan(setup, move, setup.controller.feedforward), setup.controller.law)
    rows = rows[(rows["time"] > stop) & (rows["time"] < stop + 3.0)]
    counts = np.round(rows["measured"] / setup.stage.encoder.step)
    return {"counts": counts, "current": rows["measured_current"]}


def test_the_band_changes_no_bit_while_the_reference_moves() -> None:
    """The tracking rows, from the first to the end of the motion."""
    on, off = (
        simulate(setup, plan(setup, SINE, setup.controller.feedforward), setup.controller.law)
        for setup in (varied(BALL_SCREW, band=ONE_COUNT), varied(BALL_SCREW, band=0.0))
    )
    moving = off["time"] < SINE.duration
    assert np.array_equal(on[moving], off[moving])


def test_with_an_observer_there_is_no_band() -> None:
    """It acts within the band, too, and the axis would go on hunting, wider than without one."""
    control = BALL_SCREW.file.control._replace(layers=("ptc", "friction", "observer"))
    assert BALL_SCREW.controller.law.standstill_band == BALL_SCREW.stage.encoder.step
    watched = design.design(BALL_SCREW.stage, control)
    error, resting = 0.5 * BALL_SCREW.stage.encoder.step, law.Setpoint(0.0, 0.0, 0.0, 0.0)
    assert law.acted_on(watched.law, resting, error) == error
    assert law.acted_on(watched.without({"observer"}).law, resting, error) == 0.0
