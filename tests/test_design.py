"""Control design: the paper's gains, margins at every delay, poles where they belong, and what is refused."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage
from stagectl.design.margins import _phase_margin, plant
from stagectl.kernels import feedback, friction, law, observer, rollout, stage
from stagectl.problem import ProblemKind
from tests.conftest import CONFIG, varied
from tests.problems import refused

Polynomial = list[Fraction]


def controlled(setup: Setup, bandwidth: float, period: float, margin: float = 0.0) -> design.Control:
    """Stage A's settings with another bandwidth (Hz), period (s) and least margin (rad)."""
    return design.Control(period, bandwidth, margin)


def test_gains_of_the_paper(ball_screw: Setup) -> None:
    gains = design.gains(ball_screw.stage, design.Control(5e-4, 40.0))
    assert gains.pole == pytest.approx(991.31, abs=0.005)
    assert gains.proportional == pytest.approx(833.30, abs=0.005)
    assert gains.integral == pytest.approx(55901, abs=0.5)
    assert gains.derivative == pytest.approx(4.2749, abs=0.00005)


@pytest.mark.parametrize(
    ("inertia", "viscous", "constant", "hertz"), [(0.01, 0.14, 0.72, 40.0), (6.0, 20.0, 20.0, 25.0)]
)
def test_the_closed_loop_has_four_equal_poles(inertia: float, viscous: float, constant: float, hertz: float) -> None:
    """(J s^2 + D s)(s + a) s + Kt (Kp s (s + a) + Ki (s + a) + Kd a s^2) = J (s + p)^4, in exact arithmetic."""
    gains = feedback.place_poles(stage.Mechanics(inertia, viscous), constant, hertz)
    kp, ki, kd, a = (Fraction(value) for value in gains)
    j, d, kt = Fraction(inertia), Fraction(viscous), Fraction(constant)
    plant = [j, d + j * a, d * a, Fraction(0), Fraction(0)]  # (J s^2 + D s)(s + a) s
    controller = [Fraction(0), Fraction(0), kt * (kp + kd * a), kt * (kp * a + ki), kt * ki * a]
    polynomial = [(left + right) / j for left, right in zip(plant, controller, strict=True)]
    p = Fraction(2.0 * math.pi * hertz)
    for coefficient, power in zip(polynomial, range(5), strict=True):
        assert float(coefficient / (math.comb(4, power) * p**power)) == pytest.approx(1.0, abs=1e-12)


MARGINS = [  # control-math: bandwidth (Hz), period (ms), nd, phase margin (deg)
    (40, 0.5, 0, 36),
    (40, 0.5, 1, 26),
    (40, 0.5, 2, 15),
    (40, 1.0, 0, 31),
    (40, 1.0, 1, 10),
    (40, 1.0, 2, -10),
    (20, 1.0, 1, 29),
    (10, 2.0, 1, 32),
    (40, 2.0, 1, -20),
]


@pytest.mark.parametrize(("hertz", "period_ms", "nd", "degrees"), MARGINS)
def test_phase_margins(ball_screw: Setup, hertz: float, period_ms: float, nd: int, degrees: float) -> None:
    p = varied(ball_screw, nd=nd).stage
    control = controlled(ball_screw, hertz, period_ms * 1e-3)
    reached = design.margins(p, design.gains(p, control), control.period)
    assert math.degrees(reached.phase) == pytest.approx(degrees, abs=1.0)
    assert reached.stable == (degrees > 0)
    assert reached.delay == pytest.approx(reached.phase / (2.0 * math.pi * reached.crossover))


def test_a_measurement_delay_costs_what_a_command_delay_costs(ball_screw: Setup) -> None:
    control = controlled(ball_screw, 40.0, 5e-4)
    gains = design.gains(ball_screw.stage, control)
    here, there = (design.margins(varied(ball_screw, nd=nd, nm=nm).stage, gains, 5e-4) for nd, nm in ((2, 0), (1, 1)))
    assert here == there


def test_the_gain_margin_is_where_stability_ends(ball_screw: Setup) -> None:
    p, control = ball_screw.stage, design.Control(5e-4, 40.0)
    gains = design.gains(p, control)
    limit = design.margins(p, gains, control.period).gain
    for factor, stable in ((0.99 * limit, True), (1.01 * limit, False)):
        stronger = gains._replace(
            proportional=factor * gains.proportional,
            integral=factor * gains.integral,
            derivative=factor * gains.derivative,
        )
        assert design.margins(p, stronger, control.period).stable == stable


def test_a_current_loop_of_no_lag_is_the_limit_of_fast_ones(ball_screw: Setup) -> None:
    gains = design.gains(ball_screw.stage, design.Control(5e-4, 40.0))
    drive = ball_screw.stage.drive
    none, fast = (
        design.margins(ball_screw.stage._replace(drive=drive._replace(current_lag=lag)), gains, 5e-4)
        for lag in (0.0, 1e-7)
    )
    assert none.phase == pytest.approx(fast.phase, abs=1e-4)


@pytest.mark.parametrize(("asked", "accepted"), [(20.0, True), (25.5, True), (26.5, False), (40.0, False)])
def test_a_margin_below_the_limit_is_refused(ball_screw: Setup, asked: float, accepted: bool) -> None:
    control = controlled(ball_screw, 40.0, 5e-4, math.radians(asked))
    if accepted:
        assert design.design(ball_screw.stage, control).law.current_limit == 15.0
        return
    with refused(design.DesignError, kind=ProblemKind.LOOP, key="control.bandwidth", value="40 Hz") as caught:
        design.design(ball_screw.stage, control)
    assert math.degrees(caught.value.phase) == pytest.approx(25.8, abs=0.05)


def test_the_advice_holds(ball_screw: Setup) -> None:
    control = controlled(ball_screw, 40.0, 1e-3, math.radians(20))
    with refused(design.DesignError, key="control.bandwidth") as caught:
        design.design(ball_screw.stage, control)
    advised = caught.value.advised
    design.design(ball_screw.stage, control._replace(bandwidth=advised))
    with pytest.raises(design.DesignError):  # and it is not needlessly low
        design.design(ball_screw.stage, control._replace(bandwidth=1.25 * advised))


def test_a_bandwidth_that_is_far_too_fast_is_advised_of_a_lower_one(ball_screw: Setup) -> None:
    """1 kHz where 40 Hz is meant, or kHz where Hz is."""
    with refused(design.DesignError, key="control.bandwidth", advised=50.0):
        design.design(ball_screw.stage, controlled(ball_screw, 1e3, 5e-4, math.radians(20)))


def test_an_unstable_loop_is_refused_even_if_any_margin_would_do(ball_screw: Setup) -> None:
    p = varied(ball_screw, nd=2).stage
    with refused(design.DesignError, kind=ProblemKind.LOOP, key="control.bandwidth") as caught:
        design.design(p, controlled(ball_screw, 40.0, 1e-3))
    assert not caught.value.phase > 0.0


def test_a_bandwidth_below_the_plants_damping_is_refused(ball_screw: Setup) -> None:
    """Kp = J p (4 p^2 - p^3/a)/(Kt a) is positive from p = D/(3.75 J) on, and Kd at every p, 0 at p = D/(3 J)."""
    least = 14.0 / (7.5 * math.pi)
    for share in (0.5, 0.95, 0.999):
        with refused(
            design.DesignError, key="control.bandwidth", remedy=f"the damping D/J needs more than {least:.3g} Hz"
        ):
            design.gains(ball_screw.stage, controlled(ball_screw, share * least, 5e-4))
    for hertz in (1.001 * least, 14.0 / (6.0 * math.pi)):
        assert design.gains(ball_screw.stage, controlled(ball_screw, hertz, 5e-4)).proportional > 0.0


extreme = st.sampled_from([5e-324, 1e-300, 1e-150, 1e-30, 1e-9, 1e-3, 1.0, 1e3, 1e6])


@settings(max_examples=50, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(extreme, extreme | st.just(0.0), extreme, st.floats(1e-3, 2000.0), st.sampled_from([1e-5, 5e-4, 0.1]))
def test_no_number_is_too_extreme_for_words(
    ball_screw: Setup, inertia: float, viscous: float, constant: float, hertz: float, period: float
) -> None:
    p = ball_screw.stage._replace(
        mechanics=stage.Mechanics(inertia, viscous), motor=ball_screw.stage.motor._replace(force_constant=constant)
    )
    try:
        controller = design.design(p, controlled(ball_screw, hertz, period))
    except design.DesignError:
        return
    assert all(math.isfinite(value) for value in controller.law.feedback)


def spread(setup: Setup, control: design.Control) -> float:
    """Error after 2000 periods over the first one (no friction, no limits, no rounding): grows if unstable."""
    p = setup.stage
    bare = p._replace(
        drive=p.drive._replace(current_limit=1e300, current_quantum=0.0),
        friction=stage.Friction(friction.bundle([0.0], [1.0]), friction.Stribeck()),
        encoder=p.encoder._replace(step=0.0),
    )
    running = law.Law(feedback.discretised(design.gains(bare, control), control.period), 1e300)
    rows = np.zeros((2000, rollout.WIDTH))
    setpoints = np.zeros((2000, rollout.SETPOINTS))
    setpoints[:, -1] = 1.0  # closed
    inputs = (setpoints, np.zeros((2000, 2)), rows)
    rollout.closed_loop(rollout.Loop(running, bare), stage.at_rest(bare, 1e-3), inputs, control.period, 4)
    position = np.abs(rows[:, rollout.COLUMNS.index("true_position")])
    return float(position[-200:].max() / position[:200].max())


@settings(max_examples=30, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(15.0, 90.0), st.sampled_from([5e-4, 1e-3]), st.integers(0, 3), st.integers(0, 2))
def test_poles_and_time_agree_on_stability(ball_screw: Setup, hertz: float, period: float, nd: int, nm: int) -> None:
    setup = varied(ball_screw, nd=nd, nm=nm)
    control = controlled(ball_screw, hertz, period)
    reached = design.margins(setup.stage, design.gains(setup.stage, control), period)
    if abs(reached.phase) < math.radians(2.0):
        return  # too close to the border for 2000 periods to tell
    assert (spread(setup, control) < 0.1) == reached.stable == (reached.phase > 0.0)


@pytest.mark.parametrize("period", [2.5e-4, 1e-4, 5e-5])
@pytest.mark.parametrize("hertz", [1.0, 5.0, 20.0])
def test_a_slow_loop_is_as_stable_at_a_high_rate(ball_screw: Setup, hertz: float, period: float) -> None:
    """All its poles lie near z = 1; with an observer, seven of them within a thousandth of each other.

    As polynomials in z, loops up to 10 Hz at 10 kHz, and 40 Hz at 20 kHz, came out as unstable.
    """
    p, slow = ball_screw.stage, controlled(ball_screw, hertz, 5e-4)
    gains = design.gains(p, slow)
    phases = []
    for dt in (5e-4, period):
        watching = observer.designed(p, dt, hertz)
        reached = design.margins(p, gains, dt, watching)
        assert reached.stable
        assert design.limit_cycle_frequency(p, gains, dt, watching) is None
        phases.append(math.degrees(reached.phase) + 360.0 * 1.5 * dt * reached.crossover)  # less what the period costs
    assert phases[1] == pytest.approx(phases[0], abs=1.5)


def test_the_slowest_loop_at_the_highest_rate_has_its_margin(ball_screw: Setup) -> None:
    """0.05 Hz at 100 kHz, no damping: the continuous loop's 43.5 deg at 1.45 times the bandwidth; not found before."""
    body = ball_screw.stage.mechanics._replace(viscous=0.0)
    p, control = ball_screw.stage._replace(mechanics=body), controlled(ball_screw, 0.05, 1e-5)
    reached = design.margins(p, design.gains(p, control), 1e-5)
    assert reached.stable
    assert math.degrees(reached.phase) == pytest.approx(43.54, abs=0.02)
    assert reached.crossover == pytest.approx(1.451 * 0.05, rel=1e-3)


@pytest.mark.parametrize("number", range(24))
def test_load_base_and_current_loop_are_in_the_margin(ball_screw: Setup, number: int) -> None:
    """As unstable as the simulation is: a load behind a spring, a base on its feet, a current loop that overshoots."""
    rng = np.random.default_rng(number)
    body, share = ball_screw.stage.mechanics, (0.0, 0.3, 0.6)[number % 3]
    loaded = body.transmission._replace(
        load_share=share, resonance=float(10 ** rng.uniform(1.3, 2.8)), load_friction=float(rng.uniform())
    )
    base = body.base._replace(ratio=0.3 * (number % 2), frequency=float(10 ** rng.uniform(0.7, 2.0)))
    damped = (math.inf, 0.2, 1.0)[number % 5 % 3]
    drive = ball_screw.stage.drive._replace(current_damping=damped, gain=0.2 * (number % 4 == 0))
    p = ball_screw.stage._replace(drive=drive, mechanics=body._replace(transmission=loaded, base=base))
    control = controlled(ball_screw, float(rng.uniform(10.0, 60.0)), 5e-4)
    reached = design.margins(p, design.gains(p, control), 5e-4)
    if abs(reached.phase) > math.radians(3.0):
        assert (spread(ball_screw._replace(stage=p), control) < 0.3) == reached.stable


def test_a_compliance_that_makes_the_loop_swing_is_refused(ball_screw: Setup) -> None:
    """Half of the inertia behind 160 Hz: a rigid axis has 25.8 deg, this one -18."""
    body = ball_screw.stage.mechanics
    soft = body._replace(transmission=body.transmission._replace(load_share=0.5, resonance=160.0))
    with refused(design.DesignError, key="control.bandwidth", value="40 Hz") as caught:
        design.design(ball_screw.stage._replace(mechanics=soft), ball_screw.file.control)
    assert math.degrees(caught.value.phase) == pytest.approx(-18.1, abs=0.1)


def test_the_default_margin_is_twenty_degrees() -> None:
    assert design.Control(5e-4, 40.0).margin == math.radians(20.0)


@pytest.mark.parametrize(("hertz", "period"), [(600.0, 5e-4), (300.0, 1e-3), (2000.0, 5e-4)])
def test_a_loop_that_never_crosses_over_is_refused_all_the_same(ball_screw: Setup, hertz: float, period: float) -> None:
    """Its gain stays above 1 up to Nyquist: no phase margin is found, but the poles say unstable."""
    control = controlled(ball_screw, hertz, period)
    reached = design.margins(ball_screw.stage, design.gains(ball_screw.stage, control), period)
    assert (reached.phase, reached.stable) == (math.inf, False)
    with refused(design.DesignError, key="control.bandwidth", value=f"{hertz:g} Hz", phase=math.inf):
        design.design(ball_screw.stage, control)


def test_the_advice_is_the_highest_tenth_that_holds(ball_screw: Setup) -> None:
    with refused(design.DesignError, advised=36.0):
        design.design(ball_screw.stage, controlled(ball_screw, 40.0, 5e-4, math.radians(27.0)))


def test_of_several_crossovers_the_worst_counts() -> None:
    """log|L| falls through 0 at 1 Hz, rises at 3 Hz and falls at 5 Hz; the phase is least at 3 Hz."""
    frequency = np.arange(0.5, 6.0)
    level = np.array([1.0, -1.0, -1.0, 1.0, 1.0, -1.0])
    phase = np.radians([-100.0, -110.0, -150.0, -160.0, -120.0, -130.0])
    crossover, margin = _phase_margin(frequency, level, phase)
    assert crossover == pytest.approx(3.0)
    assert math.degrees(margin) == pytest.approx(180.0 - 155.0)


@pytest.mark.parametrize(("nd", "nm"), [(0, 0), (1, 0), (1, 2)])
def test_the_loop_with_an_observer(ball_screw: Setup, nd: int, nm: int) -> None:
    """(C + M)/(1 + U) as a rational function against `observer.transfer`, from 1 Hz to Nyquist."""
    p = varied(ball_screw, nd=nd, nm=nm).stage
    watching = observer.designed(p, 5e-4, 40.0)
    controller = design.compensator(design.gains(p, controlled(ball_screw, 40.0, 5e-4)), 5e-4)
    z = np.exp(2j * np.pi * np.array([1.0, 10.0, 40.0, 200.0, 999.0]) * 5e-4)
    measured, commanded = observer.transfer(watching, z)
    expected = (controller.at(z) + measured) / (1.0 + commanded)
    np.testing.assert_allclose(design.with_observer(controller, watching).at(z), expected, rtol=1e-6)
    assert design.with_observer(controller, observer.ABSENT) is controller


def test_margins_with_an_observer_hold_in_the_running_loop(ball_screw: Setup) -> None:
    """Stable up to the stated gain margin and not beyond it: poles of the loop, counted the other way round."""
    p, control = ball_screw.stage, controlled(ball_screw, 40.0, 5e-4)
    gains, watching = design.gains(p, control), observer.designed(p, control.period, 40.0)
    reached = design.margins(p, gains, control.period, watching)
    assert reached.stable
    assert math.degrees(reached.phase) == pytest.approx(21.8, abs=0.1)
    closed = design.with_observer(design.compensator(gains, control.period), watching)
    plant = design.plant(p, control.period)
    for share, stable in ((0.98, True), (1.02, False)):
        poles = np.roots(
            np.polyadd(
                np.polymul(plant.denominator, closed.denominator),
                share * reached.gain * np.polymul(plant.numerator, closed.numerator),
            )
        )
        assert bool(np.max(np.abs(1.0 + poles)) < 1.0) is stable


def test_an_observer_that_leaves_too_little_margin_is_refused(ball_screw: Setup) -> None:
    watched = design.Control(5e-4, 40.0, math.radians(20.0), ("ptc", "friction", "observer"))
    assert design.design(ball_screw.stage, watched).law.observer.pole == pytest.approx(math.exp(-0.04 * math.pi))
    with refused(design.DesignError, key="control.observer_bandwidth", value="80 Hz") as caught:
        design.design(ball_screw.stage, watched._replace(observer_bandwidth=80.0))
    assert math.degrees(caught.value.phase) == pytest.approx(17.6, abs=0.05)
    advised = design.design(ball_screw.stage, watched._replace(observer_bandwidth=caught.value.advised))
    assert advised.without({"observer"}).law.observer == observer.ABSENT
    without = watched._replace(observer_bandwidth=80.0, layers=("ptc", "friction"))
    assert design.design(ball_screw.stage, without).law == advised.without({"observer"}).law
    late = varied(ball_screw, nd=3, nm=4).stage
    slow = watched._replace(bandwidth=10.0, margin=0.0)
    with refused(design.DesignError, key="control.layers"):
        design.design(late, slow)


@pytest.mark.parametrize("hertz", [20.0, 40.0, 60.0, 80.0])
def test_a_cascade_without_integrator_is_judged_by_its_own_poles(hertz: float) -> None:
    setup = load_stage(CONFIG / "linear-slider.yaml")
    without = design.CascadeControl(setup.dt, hertz, hertz)
    faint = without._replace(integral_time=1e3)
    p = setup.stage
    reached, near = (design.margins(p, design.cascaded(p, control), setup.dt) for control in (without, faint))
    assert reached.stable
    assert reached.phase == pytest.approx(near.phase, abs=1e-4)
    assert reached.gain == pytest.approx(near.gain, rel=1e-4)


@pytest.mark.parametrize(("period", "hertz"), [(1e-5, 20.0), (1e-5, 40.0), (5e-5, 10.0), (5e-4, 2.0)])
def test_a_loop_that_is_slow_for_its_period_has_its_margin_all_the_same(
    ball_screw: Setup, period: float, hertz: float
) -> None:
    """The four-pole loop without lag: the continuous one's margin, less the phase of 1.5 periods."""
    base = ball_screw.stage
    p = base._replace(drive=base.drive._replace(current_lag=0.0))
    reached = design.margins(p, design.gains(p, design.Control(period, hertz)), period)
    g = feedback.place_poles(p.mechanics, p.motor.force_constant, hertz)
    s = 2j * math.pi * reached.crossover
    acting = g.proportional + g.integral / s + g.derivative * s * g.pole / (s + g.pole)
    loop = p.motor.force_constant * acting / (p.mechanics.inertia * s * s + p.mechanics.viscous * s)
    assert abs(loop) == pytest.approx(1.0, rel=1e-3)
    late = 1.5 * period * 2.0 * math.pi * reached.crossover
    assert reached.phase == pytest.approx(float(np.angle(-loop)) - late, abs=2e-3)
    assert math.radians(35.0) < reached.phase < math.radians(60.0)


@pytest.mark.parametrize("periods", [0, 1])
def test_a_dead_time_counts_as_the_delay_that_it_is(ball_screw: Setup, periods: int) -> None:
    """A whole period is one of nd; a part of one turns the phase by its length, well below the Nyquist frequency."""
    drive, dt, frequency = ball_screw.stage.drive, ball_screw.dt, np.array([5.0, 40.0, 100.0])
    z = np.exp(2j * np.pi * frequency * dt)

    def at(dead_time: float, nd: int) -> NDArray[np.complex128]:
        changed = drive._replace(dead_time=dead_time, delay_samples=nd)
        return plant(ball_screw.stage._replace(drive=changed), dt).at(z)

    assert at(dt, 1) == pytest.approx(at(0.0, 2), rel=1e-12)
    for part in (0.05, 0.5, 0.95):
        turned = np.angle(at((periods + part) * dt, 1) / at(0.0, 1 + periods)) / (2 * np.pi * frequency)
        assert turned == pytest.approx(np.full(3, -part * dt), rel=2e-3)


def test_a_loop_whose_margin_a_dead_time_takes_is_refused(ball_screw: Setup) -> None:
    late = ball_screw.stage._replace(drive=ball_screw.stage.drive._replace(dead_time=0.6e-3))
    with pytest.raises(design.DesignError) as error:
        design.design(late, ball_screw.file.control)
    assert error.value.phase == pytest.approx(math.radians(13.5), abs=math.radians(0.3))
