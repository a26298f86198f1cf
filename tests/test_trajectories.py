"""Trajectories: derivatives that belong together, rest at both ends, limits reached and never passed."""

from __future__ import annotations

import math
from typing import cast, get_type_hints

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stagectl import trajectories
from stagectl.problem import ProblemKind
from stagectl.trajectories import (
    TYPES,
    Dwell,
    Multisine,
    Recorded,
    SCurve,
    Sequence,
    Sine,
    Sum,
    Trajectory,
    TrajectoryError,
    Trapezoid,
    check,
    columns,
    peaks,
    phases,
)
from stagectl.trajectories.periodic import FLAT, Flat
from stagectl.units import quantity_of
from tests.problems import refused

SAMPLES = np.linspace(0.0, math.pi, 64)
SINE = Sine(5e-3, 1.6, periods=2.5, ramp=1.0, phase=0.7)
MULTISINE = Multisine(1e-3, 1.0, 30.0, base=2.0, seed=7)
TRAPEZOID = Trapezoid(-0.1, 0.2, 1.5, dwell=0.1, cycles=2)
S_CURVE = SCurve(0.1, 0.2, 2.0, 40.0, dwell=0.05, cycles=2)
RECORDED = Recorded(3.0 + SAMPLES, 0.02 - 0.01 * np.cos(2.0 * SAMPLES))  # begins and ends at rest
SEQUENCE = Sequence((SINE, SCurve(0.03, 0.2, 2.0, 40.0, one_way=True), Dwell(0.2), RECORDED, TRAPEZOID))
ALL: list[Trajectory] = [SINE, MULTISINE, TRAPEZOID, S_CURVE, Dwell(0.5), RECORDED, SEQUENCE]
JERK = 40.0  # m/s^3, the largest in these examples
positive = st.floats(1e-3, 1e3)
moves = st.tuples(st.floats(-0.1, 0.1).filter(lambda d: abs(d) > 1e-3), st.floats(0.0, 0.2))


def named(trajectory: Trajectory) -> str:
    return type(trajectory).__name__


def difference(values: np.ndarray, h: float) -> np.ndarray:
    """Eighth-order central difference of nine columns `h` apart."""
    weights = np.array([3.0, -32.0, 168.0, -672.0, 0.0, 672.0, -168.0, 32.0, -3.0]) / 840.0
    return values @ weights / h


@pytest.mark.parametrize("trajectory", ALL, ids=named)
def test_velocity_and_acceleration_are_the_derivatives(trajectory: Trajectory) -> None:
    h = 2e-4
    t = np.random.default_rng(1).uniform(8 * h, trajectory.duration - 8 * h, 2000)
    stencil = (t[:, None] + h * np.arange(-4, 5)).ravel()
    x, v, a = (column.reshape(-1, 9) for column in trajectory.at(stencil))
    steps = np.abs(np.diff(a, axis=1)).max(axis=1)
    smooth = steps <= 0.1 * np.ptp(a)  # not across a jump of the acceleration
    assert smooth.mean() > 0.97
    for integral, derivative, jumps in ((x, v, JERK * h * h), (v, a, JERK * h)):
        off = np.abs(difference(integral, h) - derivative[:, 4])[smooth]
        assert np.quantile(off, 0.95) <= 1e-9 * max(np.ptp(derivative), 1.0)
        assert off.max() <= jumps + 1e-9  # some stencils span a jump of the jerk


@pytest.mark.parametrize("trajectory", ALL, ids=named)
def test_stands_at_zero_before_and_at_the_end_after(trajectory: Trajectory) -> None:
    before = trajectory.at([-1.0, -1e-9])
    after = trajectory.at([trajectory.duration, trajectory.duration + 5.0])
    np.testing.assert_array_equal(np.concatenate(before), 0.0)
    np.testing.assert_allclose(after.position, trajectory.end, rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(np.concatenate([after.velocity, after.acceleration]), 0.0)
    assert trajectory.at([0]).position[0] == 0.0
    assert trajectory.at([]).position.shape == (0,)


@pytest.mark.parametrize("trajectory", [SINE, MULTISINE, TRAPEZOID, S_CURVE], ids=named)
def test_starts_and_ends_at_rest(trajectory: Trajectory) -> None:
    x, v, a = trajectory.at(np.array([1e-9, trajectory.duration - 1e-9]))
    assert np.abs(x).max() < 1e-15
    assert np.abs(v).max() < 1e-8
    assert isinstance(trajectory, Trapezoid) or np.abs(a).max() < 1e-4


@pytest.mark.parametrize("trajectory", ALL, ids=named)
def test_position_and_velocity_never_jump(trajectory: Trajectory) -> None:
    dt = 1e-4
    x, v, _ = trajectory.at(np.arange(-dt, trajectory.duration + dt, dt))
    top = peaks(trajectory, dt)
    assert np.abs(np.diff(x)).max() <= top.speed * dt * 1.001 + 1e-15
    assert np.abs(np.diff(v)).max() <= top.acceleration * dt * 1.001 + 1e-7


def test_sine_is_the_sine_while_steady() -> None:
    begin, stop = SINE.steady
    assert (begin, stop) == (1.0 / 1.6, 3.5 / 1.6)
    t = np.linspace(begin, stop, 500)
    expected = 5e-3 * np.sin(2.0 * math.pi * 1.6 * (t - begin) + 0.7)
    np.testing.assert_allclose(SINE.at(t).position, expected, atol=1e-17, rtol=1e-12)


def test_peaks_of_the_paper_sine() -> None:
    """2 mm at 3.2 Hz: A w and A w^2, and the ramps add little."""
    extremes, omega = peaks(Sine(2e-3, 3.2, 5), 0.5e-3), 2.0 * math.pi * 3.2
    assert extremes.highest == pytest.approx(2e-3, rel=1e-4) and extremes.lowest == pytest.approx(-2e-3, rel=1e-4)
    assert extremes.speed == pytest.approx(2e-3 * omega, rel=1e-6)
    assert 1.0 <= extremes.acceleration / (2e-3 * omega * omega) <= 1.2


@pytest.mark.parametrize(("flat", "order"), [("position", 0), ("velocity", 1), ("acceleration", 2)])
def test_multisine_has_equal_odd_lines_in_its_band_and_no_others(flat: Flat, order: int) -> None:
    p = MULTISINE._replace(flat=flat)
    count = 4096
    steady = p.at(p.steady[0] + np.arange(count) * p.base / count)
    spectrum = np.abs(np.fft.rfft(steady[order])) / count
    band = np.arange(3, 61, 2)  # 1.5 ... 30 Hz at 0.5 Hz; 1 Hz is even
    np.testing.assert_array_equal(p.lines, band)
    np.testing.assert_allclose(spectrum[band], spectrum[3], rtol=1e-9)
    assert np.delete(spectrum, band).max() < 1e-9 * spectrum[3]


@given(st.integers(0, 2**31 - 1), st.sampled_from(["position", "velocity", "acceleration"]))
def test_multisine_reaches_its_amplitude_and_no_more(seed: int, flat: Flat) -> None:
    p = MULTISINE._replace(seed=seed, flat=flat)
    top = np.abs(p.at(p.steady[0] + np.linspace(0.0, p.base, 40001)).position).max()
    assert 1e-3 * (1.0 - 1e-5) <= top <= 1e-3 * (1.0 + 1e-12)


def test_multisine_phases_are_the_same_everywhere() -> None:
    """The first number of Python's generator for seed 1 is 0.13436424411240122, in every version."""
    p = Multisine(1e-3, 1.0, 1.0, base=1.0, seed=1)  # one line: a sine of that phase
    expected = 1e-3 * math.sin(2.0 * math.pi * 0.13436424411240122)
    assert p.at([p.steady[0]]).position[0] == pytest.approx(expected, rel=1e-9)


def fastest(distance: float, v: float, a: float, j: float) -> float:
    """Least time from rest to rest, case by case.

    Source: L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, 3.4.
    """
    turn, ramp = (a / j, a / j + v / a) if v * j >= a * a else (math.sqrt(v / j), 2.0 * math.sqrt(v / j))
    if distance / v >= ramp:
        return distance / v + ramp
    if v * j >= a * a:
        ramp = 0.5 * turn + math.sqrt(0.25 * turn * turn + distance / a)
        if ramp >= 2.0 * turn:
            return 2.0 * ramp
    return 4.0 * math.cbrt(0.5 * distance / j)


@given(positive, positive, positive, positive)
def test_s_curve_is_fastest_within_its_limits(distance: float, v: float, a: float, j: float) -> None:
    p = SCurve(distance, v, a, j, one_way=True)
    assert p.duration == pytest.approx(fastest(distance, v, a, j), rel=1e-9)
    t = np.linspace(0.0, p.duration, 2001)[:-1]
    motion = p.at(t)
    assert motion.velocity.max() <= v * (1.0 + 1e-9) and motion.velocity.min() >= -1e-9 * v
    assert np.abs(motion.acceleration).max() <= a * (1.0 + 1e-9)
    assert np.abs(np.diff(motion.acceleration)).max() <= j * t[1] * (1.0 + 1e-6) + 1e-9 * a
    assert motion.position.max() <= distance and np.all(np.diff(motion.position) >= -1e-12 * distance)


@given(positive, positive, positive)
def test_trapezoid_is_fastest_within_its_limits(distance: float, v: float, a: float) -> None:
    p = Trapezoid(-distance, v, a, one_way=True)
    reached = distance * a >= v * v
    least = distance / v + v / a if reached else 2.0 * math.sqrt(distance / a)
    assert p.duration == pytest.approx(least, rel=1e-9)
    extremes = peaks(p, p.duration / 500)
    assert extremes.speed <= v * (1.0 + 1e-9) and extremes.acceleration == pytest.approx(a, rel=1e-12)
    assert extremes.lowest == pytest.approx(-distance, rel=1e-12) and extremes.highest == 0.0


def test_limits_are_reached_where_the_distance_allows() -> None:
    extremes = peaks(SCurve(0.1, 0.2, 2.0, 40.0), 1e-4)
    assert extremes == pytest.approx((0.0, 0.1, 0.2, 2.0), rel=1e-12, abs=1e-15)


def test_cycles_dwell_at_both_ends_and_one_way_climbs() -> None:
    move = SCurve(0.01, 0.2, 2.0, 40.0, one_way=True).duration
    there_and_back = SCurve(0.01, 0.2, 2.0, 40.0, dwell=0.3, cycles=2)
    assert there_and_back.duration == pytest.approx(4 * (move + 0.3))
    standing = there_and_back.at(move + (move + 0.3) * np.arange(4) + 0.15)
    np.testing.assert_allclose(standing.position, [0.01, 0.0, 0.01, 0.0], atol=1e-17)
    np.testing.assert_array_equal(standing.velocity, 0.0)
    stairs = there_and_back._replace(one_way=True, cycles=3)
    assert stairs.end == pytest.approx(0.03)
    standing = stairs.at(move + (move + 0.3) * np.arange(3) + 0.15)
    np.testing.assert_allclose(standing.position, np.array([0.01, 0.02, 0.03]))


@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), st.integers(6, 40))
def test_spline_reproduces_a_quintic(coefficients: list[float], rows: int) -> None:
    quintic = np.polynomial.Polynomial(coefficients)
    times = np.sort(np.random.default_rng(rows).uniform(0.0, 0.3, rows)) / 10 + np.linspace(0.0, 1.0, rows)
    p = Recorded(times, quintic(times))
    t = np.linspace(0.0, p.duration, 101)[:-1]
    for values, order, tolerance in zip(p.at(t), range(3), (1e-11, 1e-9, 1e-6), strict=True):
        expected = quintic.deriv(order)(t + times[0]) - (quintic(times[0]) if order == 0 else 0.0)
        np.testing.assert_allclose(values, expected, atol=tolerance)
    assert p.initial_velocity == pytest.approx(quintic.deriv()(times[0]), abs=1e-9)
    assert p.final_velocity == pytest.approx(quintic.deriv()(times[-1]), abs=1e-9)


def test_sequence_goes_on_where_and_when_the_last_part_ended() -> None:
    assert SEQUENCE.duration == pytest.approx(sum(part.duration for part in SEQUENCE.parts))
    start = SINE.duration + SEQUENCE.parts[1].duration + 0.2
    position = SEQUENCE.at([start - 0.1, start + 0.5]).position
    assert position == pytest.approx([0.03, 0.03 + 0.01 * (1.0 - math.cos(1.0))], abs=1e-8)
    joint = Sequence((Dwell(1.0), TRAPEZOID)).at([1.0])  # belongs to the part that begins
    assert joint.acceleration[0] == -1.5


@given(st.lists(moves, min_size=1, max_size=6))
def test_sequence_never_exceeds_its_parts(chosen: list[tuple[float, float]]) -> None:
    p = Sequence(tuple(Trapezoid(distance, 0.2, 1.5, dwell, one_way=True) for distance, dwell in chosen))
    extremes = peaks(Sequence((p, p)), 2e-3)
    assert extremes.acceleration <= 1.5 * (1.0 + 1e-12) and extremes.speed <= 0.2 * (1.0 + 1e-12)
    end = sum(distance for distance, _ in chosen)
    assert p.at([p.duration]).position[0] == pytest.approx(end, abs=1e-15)


def test_sum_adds_the_motions_of_its_parts() -> None:
    carrier = Trapezoid(0.05, 0.01, 0.2, one_way=True)
    p = Sum((carrier, Sequence((Dwell(1.0), SINE))))
    assert (p.duration, p.end) == (max(carrier.duration, 1.0 + SINE.duration), 0.05)
    t = np.linspace(0.0, p.duration, 400)
    for summed, carried, other in zip(p.at(t), carrier.at(t), SINE.at(t - 1.0), strict=True):
        np.testing.assert_allclose(summed, carried + other, rtol=1e-15, atol=1e-15)
    assert p.at([p.duration + 1.0]).position[0] == 0.05


RANGE, CONFLICT, SHAPE = ProblemKind.RANGE, ProblemKind.CONFLICT, ProblemKind.SHAPE
BAD: list[tuple[Trajectory, dict[str, object]]] = [
    (Sum(()), {"kind": SHAPE, "key": "parts"}),
    (Sum((SINE, Dwell(0.0))), {"kind": RANGE, "key": "parts[1].duration", "value": "0.0 s"}),
    (SINE._replace(amplitude=-1.0), {"key": "amplitude", "value": "-1.0 m", "unit": "m", "interval": "(0, 1e6]"}),
    (SINE._replace(frequency=math.nan), {"kind": RANGE, "key": "frequency", "value": "nan Hz"}),
    (Sine(1e-3, 1e-3, 1e6), {"kind": RANGE, "key": "duration", "value": "1e+09 s", "interval": "[0, 86400]"}),
    (TRAPEZOID._replace(distance=0.0), {"kind": RANGE, "key": "distance", "value": "0 m"}),
    (S_CURVE._replace(cycles=10**400), {"kind": RANGE, "key": "cycles", "interval": "[1, 10000000]"}),
    (S_CURVE._replace(cycles=0), {"key": "cycles", "value": "0", "interval": "[1, 10000000]"}),
    (Dwell(-1.0), {"kind": RANGE, "key": "duration", "value": "-1.0 s"}),
    (MULTISINE._replace(low=40.0), {"kind": CONFLICT, "key": "low", "value": "40 Hz", "interval": "(0, 30]"}),
    (MULTISINE._replace(low=2.0, high=2.0), {"kind": CONFLICT, "key": "base"}),
    (MULTISINE._replace(high=1e4, base=20.0), {"kind": CONFLICT, "key": "base", "value": "20 s"}),
    (MULTISINE._replace(high=1e4, base=1e3), {"kind": CONFLICT, "key": "base", "value": "1000 s"}),
    (MULTISINE._replace(flat=cast(Flat, "jerk")), {"key": "flat", "value": "jerk", "choices": FLAT}),
    (Recorded(np.arange(5.0), np.zeros(5)), {"kind": SHAPE, "key": ""}),
    (Recorded(np.arange(6.0), np.zeros(7)), {"kind": SHAPE, "key": "position"}),
    (Recorded(np.array([0, 1, 2, 2, 3, 4]), np.zeros(6)), {"kind": CONFLICT, "key": "time[3]", "value": "2 s"}),
    (Recorded(np.arange(6.0), np.array([0.0, 0, math.inf, 0, 0, 0])), {"key": "position[2]", "value": "inf m"}),
    (Recorded(np.array([0, 1e-9, 1, 2, 3, 4]), np.zeros(6)), {"kind": CONFLICT, "key": "time"}),
    (Sequence(()), {"kind": SHAPE, "key": "parts"}),
    (Sequence((Dwell(1.0), SINE._replace(ramp=0.0))), {"kind": RANGE, "key": "parts[1].ramp", "value": "0.0"}),
]


@pytest.mark.parametrize(("trajectory", "fields"), BAD, ids=[f"{fields}" for _, fields in BAD])
def test_a_trajectory_that_cannot_be_run_is_refused(trajectory: Trajectory, fields: dict[str, object]) -> None:
    with refused(TrajectoryError, **fields):
        check(trajectory)


@pytest.mark.parametrize("trajectory", ALL, ids=named)
def test_check_passes_what_is_sound(trajectory: Trajectory) -> None:
    check(trajectory)
    begin, stop = phases(trajectory).steady
    assert 0.0 <= begin < stop <= trajectory.duration


def test_every_number_declares_its_quantity() -> None:
    """The loader reads nothing else."""
    for kind in (*TYPES.values(), Recorded):
        for name, hint in get_type_hints(kind, include_extras=True).items():
            quantity = quantity_of(hint)
            assert (quantity is None) == (name in {"one_way", "flat", "parts", "file"}), (kind, name)
            assert quantity is None or quantity.bounds()[0] < quantity.bounds()[1]


def test_csv_columns_are_found_by_name() -> None:
    assert columns(["time_s", "position_counts", " reference_mm"]) == (0, 2, "mm")
    assert columns(["position_um", "time_s", "current_A"]) == (1, 0, "um")
    for header in ("time_s x", "time_s reference_m reference_mm", "position_m", "time_s position_km"):
        with refused(TrajectoryError, kind=ProblemKind.MISSING, key="columns"):
            columns(header.split())


def test_names_are_exported() -> None:
    assert vars(trajectories).keys() >= {kind.__name__ for kind in TYPES.values()}
