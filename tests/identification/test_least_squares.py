"""Least squares: exact on its own equation, the published figures on a real machine, refusal where blind."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
from scipy.io import loadmat
from scipy.signal import lfilter

from stagectl.config.stage_file import load_stage
from stagectl.identification import thresholds
from stagectl.identification.capture import Capture, IdentificationError, Refusal
from stagectl.identification.filtering import FilterDesign, design_filter
from stagectl.identification.least_squares import regression
from stagectl.identification.least_squares.method import _without_noise, identify
from stagectl.identification.least_squares.regression import Estimate, RegressionModel, RegressionResult, filtered
from stagectl.identification.least_squares.regression import solved as jointly
from stagectl.identification.resampling import parts
from stagectl.identification.result import Topic, topics
from stagectl.kernels import friction, friction_path
from stagectl.trajectories import Multisine
from tests.gap.measured import DATA

Array = npt.NDArray[np.float64]
EMPS = DATA / "emps" / "DATA_EMPS.mat"
FILE = load_stage(Path(__file__).parents[2] / "config" / "emps.yaml").file
DT = 1e-3  # s
TRUE = (95.0, 203.0, 20.0, -3.0)  # kg, N s/m, N, N


class Record(NamedTuple):
    """What a capture holds."""

    time: Array
    position: Array
    force: Array


@pytest.fixture(scope="module")
def emps() -> Record:
    """The benchmark's training record: force = drive gain times controller output."""
    if not EMPS.exists():
        pytest.skip("the EMPS record is not beside this repository (../shared/data/emps/DATA_EMPS.mat)")
    data: dict[str, Any] = loadmat(EMPS)
    return Record(data["t"].ravel(), data["qm"].ravel(), data["gtau"].item() * data["vir"].ravel())


def solved(
    time: Array,
    position: Array,
    force: Array,
    model: RegressionModel = RegressionModel(),  # noqa: B008
) -> RegressionResult:
    """Parameters from one record without gaps, its time stamps treated as those of every capture."""
    (piece,), notes = parts(time, {"position": position, "force": force}, frozenset({"position"}))
    result = jointly([filtered(piece.columns["position"], piece.columns["force"], piece.dt, model)], model)
    return result._replace(notes=(*notes, piece.note, *result.notes))


def usual(solution: RegressionResult) -> list[Estimate]:
    """Inertia, viscous and Coulomb friction and offset."""
    return list(solution.estimates.values())[:4]


def textbook(record: Record) -> Array:
    """Standard deviations (4,) of the usual parameters, had the residual been white."""
    rows = filtered(record.position, record.force, DT, RegressionModel())
    count = len(rows.force)
    _, squares, *_ = np.linalg.lstsq(rows.regressor, rows.force)
    inverse = np.linalg.inv(rows.regressor.T @ rows.regressor)
    return np.asarray(np.sqrt(np.diag(inverse) * squares[0] / (count - 4)))


@pytest.fixture(scope="module")
def published(emps: Record) -> RegressionResult:
    return solved(*emps)


def made(noise: float = 0.0, seed: int = 1) -> Record:
    """A slow multisine on an axis that obeys the equation, with white noise on the force (N rms)."""
    time = np.asarray(np.arange(20000) * 1e-3, dtype=np.float64)
    x, v, a = Multisine(0.05, 0.2, 4.0, base=5.0, periods=3.5).at(time)
    force = np.column_stack([a, v, np.sign(v), np.ones(len(time))]) @ np.array(TRUE)
    force = np.asarray(force, dtype=np.float64)
    return Record(
        time, np.asarray(x, dtype=np.float64), force + np.random.default_rng(seed).normal(0.0, noise, len(time))
    )


@pytest.mark.parametrize("frequency", [1.0, 2.0, 3.0])
def test_a_slow_log_biases_no_inertia(frequency: float) -> None:
    """Two sines logged at 100 Hz: with central differences the inertia was 0.14, 0.5 and 1.2 % too large."""
    time = np.arange(2000) * 0.01
    turns = 2.0 * np.pi * frequency * np.array([1.0, 0.37])
    a, v, x = (
        sum(size * w**order * wave(w * time) for size, w in zip((0.5, 0.1), turns, strict=True))
        for order, wave in ((2, lambda turned: -np.sin(turned)), (1, np.cos), (0, np.sin))
    )
    force = np.column_stack([a, v, np.sign(v), np.ones(len(time))]) @ np.array(TRUE)
    force += np.random.default_rng(1).normal(0.0, 0.02 * TRUE[2], len(time))
    model = RegressionModel()
    found = jointly([filtered(np.asarray(x), force, 0.01, model)], model)
    assert found.estimates["inertia"].value == pytest.approx(TRUE[0], rel=5e-4)


@pytest.mark.parametrize(("inertias", "kept"), [((1.0, 1.5, 1.51), 1.5), ((1.0, 0.5, 0.25), 1.0), ((1.0, 1.01), 1.0)])
def test_a_lower_cut_off_is_for_noise_which_makes_the_inertia_smaller(inertias: tuple[float, ...], kept: float) -> None:
    """Friction that changes along a sweep halved the mass of a spindle with the cut-off: no noise does that."""
    found: list[Any] = [SimpleNamespace(estimates={"inertia": Estimate(each, 0.02)}) for each in inertias]
    chosen = _without_noise(found[0], lambda share: found[round(-math.log2(share))])
    assert chosen.estimates["inertia"].value == kept


@pytest.mark.parametrize(
    ("name", "value", "within"),
    [
        ("inertia", 95.1089, 1e-3),
        ("viscous", 203.5034, 5e-3),
        ("coulomb", 20.3935, 5e-3),
        ("offset", -3.1648, 2e-2),
    ],
)
def test_emps_parameters_are_published(published: RegressionResult, name: str, value: float, within: float) -> None:
    """A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019."""
    assert published.estimates[name].value == pytest.approx(value, rel=within)


def test_emps_residual_and_deviations_are_published(emps: Record, published: RegressionResult) -> None:
    """The same source; the deviations scale with the number of samples kept, so they test the decimation."""
    assert 4.0 <= published.residual_percent <= 4.1
    assert textbook(emps) == pytest.approx([0.1085, 1.146, 0.1012, 0.0444], rel=0.02)


def test_emps_honest_deviations_are_larger(emps: Record, published: RegressionResult) -> None:
    """The residual there is friction that the model lacks: neighbours are alike, so fewer rows are independent."""
    for estimate, white in zip(usual(published), textbook(emps), strict=True):
        assert 1.5 * white < estimate.deviation < 6.0 * white


def test_emps_with_directions_is_published(emps: Record) -> None:
    """The same source: M 95.1540, Fv 166.71 forward and 240.42 backward, Fc 20.144 and 20.628, residual 3.1117 %."""
    solution = solved(*emps, model=RegressionModel(directions=True))
    own = [name for name in solution.estimates if name == "inertia" or name.endswith("ward")]
    values = [solution.estimates[name].value for name in own]
    assert values == pytest.approx([95.1540, 166.71, 240.42, 20.144, 20.628], rel=2e-3)
    assert solution.estimates["viscous"].value == pytest.approx(0.5 * (values[1] + values[2]), rel=1e-12)
    assert solution.estimates["coulomb"].value == pytest.approx(0.5 * (values[3] + values[4]), rel=1e-12)
    assert solution.estimates["offset"].value == pytest.approx(0.5 * (values[3] - values[4]), rel=1e-12)
    assert 3.0 < solution.residual_percent < 3.15


@pytest.mark.parametrize(
    ("joint", "gain", "gravity", "viscous", "coulomb", "within"),
    [(1, 10.0, False, 21.26, 12.55, 0.10), (4, 9.00, True, 3.58, 2.00, 0.25)],
)
def test_a_robots_joints_have_the_published_friction(
    joint: int, gain: float, gravity: bool, viscous: float, coulomb: float, within: float
) -> None:
    """S. Mamedov, S. Mikhel, Frontiers in Robotics and AI, 2020: UR10e, 93.6 Hz, stamps that vary by a sixth."""
    path = DATA / "ur10e_joints" / f"ur-20_01_22-joint_{joint}.csv"
    if not path.exists():
        pytest.skip(f"the robot's record is not beside this repository (../shared/data/ur10e_joints/{path.name})")
    rows = np.loadtxt(path, delimiter=",")
    solution = solved(rows[:, 0], rows[:, joint], gain * rows[:, 12 + joint], model=RegressionModel(gravity=gravity))
    assert solution.estimates["viscous"].value == pytest.approx(viscous, rel=within)
    assert solution.estimates["coulomb"].value == pytest.approx(coulomb, rel=within)
    assert solution.residual_percent < 5.0
    assert {Topic.RESAMPLED, Topic.METHOD, Topic.STANDSTILL} <= topics(solution.notes)
    words = " ".join(solution.notes)
    assert "every 10.7 ms" in words and "9.36" in words and "one row of 10" in words


def test_gravity_and_direction_are_separated() -> None:
    """A joint that obeys the equation, with a lever of 7 N m and 20 % more friction one way."""
    time = np.asarray(np.arange(20000) * 1e-3, dtype=np.float64)
    q, v, a = Multisine(1.5, 0.2, 2.0, base=5.0, periods=3.5).at(time)
    forward = np.where(v > 0.0, 1.2, 1.0)
    force = 2.0 * a + 5.0 * forward * v + 3.0 * forward * np.sign(v) + 7.0 * np.sin(q) - 2.0 * np.cos(q)
    solution = solved(time, q, force, model=RegressionModel(gravity=True, directions=True))
    expected = {
        "viscous_forward": 6.0,
        "viscous_backward": 5.0,
        "coulomb_forward": 3.6,
        "coulomb_backward": 3.0,
        "gravity_sine": 7.0,
        "gravity_cosine": -2.0,
    }
    assert {name: solution.estimates[name].value for name in expected} == pytest.approx(expected, rel=5e-3)
    assert solution.estimates["inertia"].value == pytest.approx(2.0, rel=5e-3)


def test_the_recipe_follows_rate_and_noise() -> None:
    """A tenth of the sampling rate; lower where counts of the encoder would drown the acceleration."""
    slow = made()
    coarse = slow._replace(position=np.round(slow.position / 2e-4) * 2e-4)
    assert (design_filter(slow.position, 1e-3).cutoff, design_filter(slow.position, 1e-3).decimate) == (100.0, 10)
    solution = solved(*coarse)
    cutoff = design_filter(coarse.position, 1e-3).cutoff
    assert 8.0 < cutoff < 40.0
    assert solution.estimates["inertia"].value == pytest.approx(TRUE[0], rel=0.02)
    assert solution.estimates["viscous"].value == pytest.approx(TRUE[1], rel=0.02)


def test_a_slow_log_of_a_short_stroke_keeps_its_motion() -> None:
    """Ten reversals a second at 100 Hz: a low-pass at 4 Hz cut most of the motion off."""
    time = np.arange(2000) * 0.01
    turn = 10.0 * np.pi * (1.0 + 0.3 * np.sin(0.2 * np.pi * time))  # rad/s
    phase = np.cumsum(turn) * 0.01
    x, v = 0.005 * np.sin(phase), 0.005 * turn * np.cos(phase)
    a = np.gradient(v, 0.01)
    force = np.column_stack([a, v, np.sign(v), np.ones(len(time))]) @ np.array(TRUE)
    design = design_filter(x, 0.01)
    assert 0.4 * design.cutoff >= 6.0 and design.decimate <= 6
    found = jointly([filtered(x, force, 0.01, RegressionModel())], RegressionModel())
    assert found.estimates["inertia"].value == pytest.approx(TRUE[0], rel=0.05)


def test_a_disk_that_is_not_centred_does_not_lower_the_inertia() -> None:
    """The position swings by 40 um at 25 Hz, which no force makes: it halves the inertia at 100 Hz."""
    record = made(5.0)
    seen = record.position + 40e-6 * np.sin(50.0 * np.pi * record.time)
    assert solved(record.time, seen, record.force).estimates["inertia"].value < 0.8 * TRUE[0]
    capture = Capture("not centred", record.time, seen, record.force / FILE.motor.force_constant, DT)
    found = identify([capture], FILE).parameters["inertia"]
    assert abs(found.value - TRUE[0]) <= found.half <= 0.1 * TRUE[0]


def test_a_late_stamp_is_resampled_and_a_gap_splits() -> None:
    late = solved(*spoilt("time", 500, 0.5004))
    assert Topic.RESAMPLED in topics(late.notes)
    assert late.estimates["inertia"].value == pytest.approx(TRUE[0], rel=2e-3)
    record = made()
    holed = Record(*(np.concatenate([column[:8000], column[9000:]]) for column in record))
    pieces, notes = parts(holed.time, {"position": holed.position, "force": holed.force}, frozenset({"position"}))
    assert Topic.GAPS in topics(tuple(notes)) and len(pieces) == 2
    model = RegressionModel()
    rows = [filtered(piece.columns["position"], piece.columns["force"], DT, model) for piece in pieces]
    assert [estimate.value for estimate in usual(jointly(rows, model))] == pytest.approx(TRUE, rel=2e-3)


def one_way(direction: float) -> Capture:
    """An axis that never reverses, on its way at one of two speeds."""
    time = np.asarray(np.arange(20000) * 1e-3, dtype=np.float64)
    swing = Multisine(0.05, 0.2, 4.0, base=5.0, periods=3.5).at(time)
    ways: tuple[Array | float, ...] = (2.0 * time, 2.0, 0.0)
    x, v, a = (np.asarray(part) + direction * np.asarray(way) for part, way in zip(swing, ways, strict=True))
    force = np.column_stack([a, v, np.sign(v), np.ones(len(time))]) @ np.array(TRUE)
    return Capture("one way", time, x, force / FILE.motor.force_constant, 1e-3)


def test_two_directions_may_be_two_captures() -> None:
    """Neither separates Coulomb friction and offset; together they do."""
    forth, back = one_way(1.0), one_way(-1.0)
    for alone in ([forth], [back], [forth, forth]):
        with pytest.raises(IdentificationError) as caught:
            identify(alone, FILE)
        assert caught.value.reason is Refusal.ONE_DIRECTION and caught.value.capture.startswith("one way")
    parameters = identify([forth, back], FILE).parameters
    values = [parameters[name].value for name in ("inertia", "viscous", "coulomb", "offset")]
    assert values == pytest.approx(TRUE, rel=2e-3)


def test_a_noisy_capture_does_not_spoil_a_clean_one() -> None:
    """Each counts by its residual: beside one with fifty times the noise the answer stays as good as without it."""
    clean, noisy = (
        filtered(record.position, record.force, DT, RegressionModel()) for record in (made(0.2, 1), made(10.0, 2))
    )
    alone, both = (jointly(rows, RegressionModel()) for rows in ([clean], [clean, noisy]))
    for mine, other in zip(usual(both), usual(alone), strict=True):
        assert mine.deviation < 1.01 * other.deviation
        assert abs(mine.value - other.value) < other.deviation


def test_deviations_hold_under_coloured_noise() -> None:
    """Noise with a memory of 0.2 s, 40 records: the textbook's deviation is far off, the honest one within a third."""
    runs = [solved(*coloured(seed)) for seed in range(40)]
    white = np.mean([textbook(coloured(seed)) for seed in range(40)], axis=0)
    for parameter in (2, 3):
        estimates = [usual(run)[parameter] for run in runs]
        spread = float(np.std([estimate.value for estimate in estimates]))
        assert 0.65 * spread < float(np.mean([estimate.deviation for estimate in estimates])) < 1.5 * spread
        assert white[parameter] < 0.5 * spread


def coloured(seed: int) -> Record:
    record = made()
    white = np.random.default_rng(seed).normal(0.0, 1.0, len(record.time))
    return record._replace(force=np.asarray(record.force + 20.0 * lfilter([0.05], [1.0, -0.995], white)))


def filtered_with(monkeypatch: pytest.MonkeyPatch, cutoff: float, decimate: int) -> None:
    """Let the regression filter with this cut-off (Hz) and decimation, at 1 kHz."""
    monkeypatch.setattr(regression, "design_filter", lambda *_: FilterDesign(cutoff, decimate, 1e-3))


def test_emps_does_not_hang_on_the_cut_off(
    emps: Record, published: RegressionResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody tunes the result: from 60 to 150 Hz no parameter moves by more than its deviation."""
    deviations = textbook(emps)
    for cutoff in (60.0, 150.0):
        filtered_with(monkeypatch, cutoff, 10)
        for estimate, reference, white in zip(usual(solved(*emps)), usual(published), deviations, strict=True):
            assert abs(estimate.value - reference.value) < white


def test_its_own_equation_is_solved() -> None:
    solution = solved(*made())
    assert [estimate.value for estimate in usual(solution)] == pytest.approx(TRUE, rel=2e-3)
    assert solution.residual_percent < 0.5
    assert 1.0 <= solution.condition < 10.0
    np.testing.assert_allclose(np.diag(solution.correlation), 1.0)
    np.testing.assert_allclose(solution.correlation, solution.correlation.T)


def test_deviation_is_the_spread_over_repetitions(monkeypatch: pytest.MonkeyPatch) -> None:
    """White noise, 50 records, no decimation: the standard deviation of 50 is itself good to a tenth."""
    filtered_with(monkeypatch, 100.0, 1)
    runs = [usual(solved(*made(5.0, seed))) for seed in range(50)]
    spread = np.std([[estimate.value for estimate in run] for run in runs], axis=0)
    claimed = np.mean([[estimate.deviation for estimate in run] for run in runs], axis=0)
    np.testing.assert_array_less(spread, 1.35 * claimed)
    np.testing.assert_array_less(0.65 * claimed, spread)


def test_units_do_not_matter() -> None:
    record = made(1.0)
    metres, microns = solved(*record), solved(record.time, 1e6 * record.position, record.force)
    assert microns.estimates["inertia"].value == pytest.approx(1e-6 * metres.estimates["inertia"].value, rel=1e-9)
    assert microns.estimates["coulomb"] == pytest.approx(metres.estimates["coulomb"], rel=1e-9)
    assert microns.condition == pytest.approx(metres.condition, rel=1e-9)


def spoilt(column: str, row: int, value: float) -> Record:
    record = made()
    values = getattr(record, column).copy()
    values[row] = value
    return record._replace(**{column: values})


def constant_speed() -> Record:
    time = np.asarray(np.arange(20000) * 1e-3, dtype=np.float64)
    return Record(time, 0.1 * time, np.full(20000, 40.0))


REFUSED = [
    (spoilt("time", 500, 0.499), Refusal.TIME_ORDER, 0.499),
    (spoilt("time", 500, 0.4985), Refusal.TIME_ORDER, 0.4985),
    (Record(*(column[:599] for column in made())), Refusal.TOO_SHORT, 599),
    (Record(np.zeros(0), np.zeros(0), np.zeros(0)), Refusal.TOO_SHORT, 0),
    (constant_speed(), Refusal.ONE_DIRECTION, 0.0),
    (made()._replace(position=np.zeros(20000)), Refusal.ONE_DIRECTION, 0.0),
]


@pytest.mark.parametrize(("record", "reason", "value"), REFUSED)
def test_a_blind_record_is_refused(record: Record, reason: Refusal, value: float | str | None) -> None:
    with pytest.raises(IdentificationError) as caught:
        solved(*record)
    assert caught.value.reason is reason
    assert value is None or caught.value.value == value


def test_one_speed_there_and_back_is_refused() -> None:
    """Velocity and its sign are then one column."""
    time = np.asarray(np.arange(20000) * 1e-3, dtype=np.float64)
    triangle: Array = 0.1 * np.abs((time + 5.0) % 20.0 - 10.0)
    with pytest.raises(IdentificationError) as caught:
        solved(time, triangle, np.sign(np.gradient(triangle)))
    assert caught.value.reason is Refusal.ILL_CONDITIONED and caught.value.admissible == "[1, 10000]"


def test_a_capture_with_gravity_is_found_with_units() -> None:
    """Options of the method as a user calls it: six parameters on this axis, the lever's in its unit of force."""
    time = np.asarray(np.arange(20000) * 1e-3, dtype=np.float64)
    q, v, a = Multisine(1.5, 0.2, 2.0, base=5.0, periods=3.5).at(time)
    force = np.asarray(2.0 * a + 5.0 * v + 3.0 * np.sign(v) + 7.0 * np.sin(q) - 2.0 * np.cos(q), dtype=np.float64)
    capture = Capture("joint", time, np.asarray(q, dtype=np.float64), force / FILE.motor.force_constant, 1e-3)
    parameters = identify([capture], FILE, gravity=True).parameters
    assert {name: parameter.unit for name, parameter in parameters.items()} == {
        **{"inertia": "kg", "viscous": "N s/m", "coulomb": "N", "offset": "N"},
        **{"gravity_sine": "N", "gravity_cosine": "N"},
    }
    assert parameters["gravity_sine"].value == pytest.approx(7.0, rel=5e-3)
    assert parameters["gravity_sine"].low < parameters["gravity_sine"].value < parameters["gravity_sine"].high


def test_a_small_swing_ties_the_lever_to_the_offset() -> None:
    """Their correlation is told: the cosine hardly changes there, and both may be far larger than any force."""
    time = np.asarray(np.arange(20000) * 1e-3, dtype=np.float64)
    q, v, a = Multisine(0.3, 0.2, 2.0, base=5.0, periods=3.5).at(time)
    force = 2.0 * a + 5.0 * v + 3.0 * np.sign(v) + 7.0 * np.sin(q) - 2.0 * np.cos(q)
    force = np.asarray(force + np.random.default_rng(1).normal(0.0, 1.0, len(time)), dtype=np.float64)
    capture = Capture("joint", time, np.asarray(q, dtype=np.float64), force / FILE.motor.force_constant, 1e-3)
    found = identify([capture], FILE, gravity=True)
    names, matrix = list(found.parameters), found.details["correlation"]
    assert matrix[names.index("offset")][names.index("gravity_cosine")] < -thresholds.TIED


def rolling(noise: float, seed: int) -> Record:
    """The same axis and motion, its Coulomb friction built up over 4 mm by stop operators (`kernels.friction`)."""
    time, x, _ = made()
    _, v, a = Multisine(0.05, 0.2, 4.0, base=5.0, periods=3.5).at(time)
    operators = friction.Gms(friction.bundle([1.0] * 5, [1e-4, 3e-4, 8e-4, 2e-3, 4e-3]), friction.Stribeck())
    columns = np.zeros((len(time), 5))
    friction_path.operators(operators, x, 1e-3, columns)
    free = np.column_stack([a, v, np.ones(len(time))]) @ np.array([TRUE[0], TRUE[1], TRUE[3]])
    force = free + columns @ np.full(5, 0.2 * TRUE[2]) + np.random.default_rng(seed).normal(0.0, noise, len(time))
    return Record(time, x, np.asarray(force, dtype=np.float64))


@pytest.mark.parametrize("noise", [0.1, 2.0])
def test_friction_that_builds_up_over_a_distance_is_noted(noise: float) -> None:
    """Its answer is off by more than its interval, and a note says so; with friction of sgn(v) there is none."""
    solution = solved(*rolling(noise, 2))
    assert abs(solution.estimates["coulomb"].value - TRUE[2]) > 1.96 * solution.estimates["coulomb"].deviation
    assert Topic.AFTER_REVERSALS in topics(solution.notes)


@pytest.mark.parametrize("rows", [-8, 8])
def test_a_force_of_another_instant_is_noted(rows: int) -> None:
    """Its inertia is off by more than its interval, and a note says so."""
    time, x, force = made(2.0, 3)
    solution = solved(time[8:-8], x[8:-8], np.roll(force, rows)[8:-8])
    assert abs(solution.estimates["inertia"].value - TRUE[0]) > 1.96 * solution.estimates["inertia"].deviation
    assert Topic.LATE in topics(solution.notes)


@pytest.mark.parametrize("noise", [0.0, 0.1, 2.0, 10.0])
def test_friction_of_the_sign_is_not_doubted(noise: float) -> None:
    assert topics(solved(*made(noise, 3)).notes).isdisjoint({Topic.AFTER_REVERSALS, Topic.LATE})


def test_emps_is_not_doubted(published: RegressionResult) -> None:
    assert topics(published.notes).isdisjoint({Topic.AFTER_REVERSALS, Topic.LATE})
