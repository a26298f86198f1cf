"""Margins, sensitivity, poles and step against python-control, which builds the same loop from its blocks."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import control
import numpy as np
import pytest

from stagectl import design
from stagectl.config.stage_file import load_stage
from stagectl.kernels import feedback, friction, law, observer, rollout, stage
from stagectl.tuning.robustness import (
    Loop,
    attenuated,
    bandwidth,
    characteristic,
    following,
    grid,
    loops,
    robustness,
    softest,
    stable,
    stepped,
    stiffness,
)
from tests.conftest import CONFIG

FILES = sorted(set(CONFIG.glob("*.yaml")) - {CONFIG / "xy.yaml"})


class Case(NamedTuple):
    stage: stage.Stage
    control: design.Settings

    @property
    def designed(self) -> design.Feedback:
        return design.designed_feedback(self.stage, self.control)


def drawn(rng: np.random.Generator, base: stage.Stage, cascaded: bool) -> Case:
    """A stage and a control of any size; stable or not."""
    dt = float(rng.choice([1.25e-4, 2.5e-4, 5e-4, 1e-3, 2e-3]))
    inertia = float(10.0 ** rng.uniform(-4.0, 2.0))
    mechanics = stage.Mechanics(inertia, float(rng.choice([0.0, inertia * 10.0 ** rng.uniform(-1.0, 1.2)])))
    drive = base.drive._replace(delay_samples=int(rng.integers(0, 4)), current_lag=float(rng.uniform(0.05, 0.8)) * dt)
    p = base._replace(
        mechanics=mechanics,
        motor=stage.Motor(float(10.0 ** rng.uniform(-1.0, 2.0))),
        drive=drive,
        encoder=base.encoder._replace(delay_samples=int(rng.integers(0, 3))),
    )
    hertz = float(rng.uniform(4e-3, 2.5e-2)) / dt
    if not cascaded:
        return Case(p, design.Control(dt, hertz))
    corner = 2.0 * math.pi * hertz
    ratio, filtering, integral = rng.uniform(3.0, 8.0), rng.uniform(3.0, 8.0), rng.uniform(3.0, 10.0)
    return Case(
        p,
        design.CascadeControl(
            dt, corner / ratio, hertz, integral / corner, 1.0 / (filtering * corner), 1.0, int(rng.integers(1, 3))
        ),
    )


def cases() -> Iterator[Any]:
    for path in FILES:
        setup = load_stage(path)
        yield pytest.param(Case(setup.stage, setup.file.control), id=path.stem)
    rng = np.random.default_rng(20)
    base = load_stage(CONFIG / "ball-screw.yaml").stage
    for number in range(24):
        yield pytest.param(drawn(rng, base, number % 2 == 1), id=f"{'cascade' if number % 2 else 'pid'}-{number}")


CASES = list(cases())


@contextmanager
def oracle() -> Iterator[None]:
    """python-control says which of its two ways to the margins it takes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="stability_margins: Falling back to 'frd'", category=UserWarning)
        yield


def _plant(p: stage.Stage, dt: float) -> Any:
    """Zero-order hold of lag and mechanics, and the delays."""
    size = p.motor.force_constant * dt * dt / p.mechanics.inertia  # taken out: near 1 its sampling loses no digits
    moved = control.tf([1.0 / (dt * dt)], [1.0, p.mechanics.viscous / p.mechanics.inertia, 0.0])
    lag = control.tf([1.0], [p.drive.current_lag, 1.0])
    delays = p.drive.delay_samples + p.encoder.delay_samples
    return size * control.sample_system(moved * lag, dt, "zoh") * control.tf([1.0], [1.0, *[0.0] * delays], dt)


def _pid(case: Case, dt: float) -> Any:
    g = case.designed
    assert isinstance(g, feedback.Gains)
    integral = control.sample_system(control.tf([g.integral], [1.0, 0.0]), dt, "tustin")
    derivative = control.sample_system(control.tf([g.derivative * g.pole, 0.0], [1.0, g.pole]), dt, "tustin")
    return g.proportional + integral + derivative


def _inner(case: Case, dt: float) -> tuple[Any, Any]:
    """PI with force filter, and the difference that measures the velocity."""
    c = case.control
    assert isinstance(c, design.CascadeControl)
    velocity = case.stage.mechanics.inertia * 2.0 * math.pi * c.velocity_bandwidth / case.stage.motor.force_constant
    pi = control.sample_system(control.tf([velocity * c.integral_time, velocity], [c.integral_time, 0.0]), dt, "tustin")
    held = control.sample_system(control.tf([1.0], [c.force_filter, 1.0]), dt, "zoh")
    filtered = held * control.tf([1.0, 0.0], [1.0], dt)  # the filter passes on what it has just read
    ends = [1.0, *[0.0] * (c.velocity_span - 1), -1.0]
    return pi * filtered, control.tf(ends, [c.velocity_span * dt, *[0.0] * c.velocity_span], dt)


def opened(case: Case) -> dict[str, Any]:
    """The open loops, by our names, as python-control's transfer functions."""
    dt = case.control.period
    plant = _plant(case.stage, dt)
    if isinstance(case.control, design.Control):
        return {"loop": plant * _pid(case, dt)}
    force, difference = _inner(case, dt)
    gain = case.control.position_gain
    velocity = plant * force * difference
    return {
        "whole loop": plant * force * (gain + difference),
        "velocity loop": velocity,
        "position loop": gain * control.feedback(plant * force, difference),
    }


def ours(case: Case) -> dict[str, Loop]:
    return loops(case.stage, case.designed, case.control.period)


@pytest.mark.parametrize("case", CASES)
def test_the_open_loops_are_those_of_python_control(case: Case) -> None:
    theirs = opened(case)
    assert list(theirs) == list(ours(case))
    for name, loop in ours(case).items():
        frequency = np.geomspace(2e-3, 0.49, 60) / case.control.period
        expected = theirs[name](np.exp(2j * np.pi * frequency * case.control.period))
        np.testing.assert_allclose(loop.at(frequency), expected, rtol=1e-8, atol=1e-14)


@pytest.mark.parametrize("case", CASES)
def test_margins_are_those_of_python_control(case: Case) -> None:
    loop, dt = next(iter(ours(case).values())), case.control.period
    with oracle():
        gm, pm, sm, wg, wp, _ = control.stability_margins(next(iter(opened(case).values())), returnall=True)
    reached = robustness(loop)
    low = 2.0 * math.pi * grid(dt)[0] * 10.0
    assert math.degrees(reached.phase) == pytest.approx(np.min(pm[wp > low]), abs=1e-4)
    assert reached.crossover == pytest.approx(wp[np.argmin(pm)] / (2.0 * math.pi), rel=1e-6)
    factors = gm[(wg > low) & (gm > 1e-4)]
    assert reached.raised.value == pytest.approx(np.min(factors[factors > 1.0], initial=np.inf), rel=1e-5)
    assert reached.lowered.value == pytest.approx(np.max(factors[factors < 1.0], initial=0.0), rel=1e-5)
    assert reached.modulus == pytest.approx(np.min(sm), rel=1e-5)
    if reached.stable:
        assert reached.delay == pytest.approx(reached.phase / (2.0 * math.pi * reached.crossover))


@pytest.mark.parametrize("case", CASES)
def test_poles_are_those_of_python_control(case: Case) -> None:
    """Polynomials are compared, as close poles are ill-conditioned; and the largest of the poles."""
    loop = next(iter(ours(case).values()))
    expected = control.feedback(next(iter(opened(case).values())), 1).poles()
    ring = 1.5 * np.exp(1j * np.linspace(0.0, math.pi, 9))
    mine = characteristic(loop)
    np.testing.assert_allclose(np.polyval(mine, ring - 1.0) / mine[0], np.polyval(np.poly(expected), ring), rtol=1e-6)
    largest = float(np.max(np.abs(expected)))
    if abs(largest - 1.0) > 1e-6:
        assert stable(loop) == (largest < 1.0)


@pytest.mark.parametrize(
    "case", [case for case in CASES if robustness(next(iter(ours(case.values[0]).values()))).stable]
)
def test_the_step_is_that_of_python_control(case: Case) -> None:
    dt = case.control.period
    if isinstance(case.control, design.Control):
        closed = control.feedback(opened(case)["loop"], 1)
    else:
        closed = control.feedback(opened(case)["position loop"], 1)
    expected = control.step_response(control.minreal(closed, tol=1e-12, verbose=False), T=dt * np.arange(300))
    next_state = stepped(following(case.stage, case.designed, dt), 300)
    np.testing.assert_allclose(next_state, np.squeeze(expected.outputs), atol=1e-6)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_step_is_that_of_the_law_that_runs(path: Path) -> None:
    """Kernels of law and stage, without friction, limits and steps; the cascade's reference velocity is 0."""
    setup = load_stage(path)
    p, dt = setup.stage, setup.dt
    bare = p._replace(
        drive=p.drive._replace(current_limit=1e300, current_quantum=0.0),
        friction=stage.Friction(friction.bundle([0.0], [1.0]), friction.Stribeck()),
        encoder=p.encoder._replace(step=0.0),
        mechanics=p.mechanics._replace(bias=0.0),
    )
    designed = design.designed_feedback(bare, setup.file.control)
    running = design.law_of(designed, dt, 1e300)
    setpoints, rows = np.zeros((200, rollout.SETPOINTS)), np.zeros((200, rollout.WIDTH))
    names = law.Setpoint._fields
    setpoints[:, names.index("target")] = 1e-3
    setpoints[:, names.index("closed")] = 1.0
    loop, inputs = rollout.Loop(running, bare), (setpoints, np.zeros((200, 2)), rows)
    rollout.closed_loop(loop, stage.at_rest(bare), inputs, dt, 40)
    simulated = 1e3 * rows[:, rollout.COLUMNS.index("measured")]
    np.testing.assert_allclose(stepped(following(bare, designed, dt), 200), simulated, atol=2e-3)


def _scaled(loop: Loop, factor: float) -> Loop:
    return loop._replace(cut=loop.cut._replace(numerator=factor * loop.cut.numerator))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_stability_ends_at_both_gain_margins_of_each_loop(path: Path) -> None:
    setup = load_stage(path)
    designed = design.designed_feedback(setup.stage, setup.file.control)
    for name, loop in loops(setup.stage, designed, setup.dt).items():
        reached = robustness(loop)
        assert reached.stable
        assert stable(_scaled(loop, 0.999 * reached.raised.value)), name
        assert not stable(_scaled(loop, 1.001 * reached.raised.value)), name
        if reached.lowered.value > 0.0:
            assert stable(_scaled(loop, 1.001 * reached.lowered.value)), name
            assert not stable(_scaled(loop, 0.999 * reached.lowered.value)), name


def test_stage_a_is_conditionally_stable() -> None:
    """Ki and the plant's damping: 40 Hz, nd = 1; the lower margin of the double integrator's PID."""
    setup = load_stage(CONFIG / "ball-screw.yaml")
    loop = loops(setup.stage, design.designed_feedback(setup.stage, setup.file.control), setup.dt)["loop"]
    reached = robustness(loop)
    assert 20.0 * math.log10(reached.lowered.value) == pytest.approx(-13.936, abs=0.001)
    assert 20.0 * math.log10(reached.raised.value) == pytest.approx(8.443, abs=0.001)
    assert math.degrees(reached.phase) == pytest.approx(25.8, abs=0.05)


def test_ms_bounds_the_other_margins() -> None:
    """GM >= Ms/(Ms - 1), GM- <= Ms/(Ms + 1) and PM >= 2 asin(1/(2 Ms)) (Skogestad and Postlethwaite, section 2.4.4)."""
    for case in CASES:
        for loop in ours(case.values[0]).values():
            reached = robustness(loop)
            if not reached.stable:
                continue
            peak = reached.sensitivity.value
            assert reached.raised.value >= peak / (peak - 1.0) - 1e-6
            assert reached.lowered.value <= peak / (peak + 1.0) + 1e-6
            assert reached.phase >= 2.0 * math.asin(0.5 / peak) - 1e-6


@pytest.mark.parametrize("case", CASES[: len(FILES)])
def test_bandwidths_are_where_the_gain_passes_minus_3_db(case: Case) -> None:
    way = following(case.stage, case.designed, case.control.period)
    loop = next(iter(ours(case).values()))
    there, below = bandwidth(way), attenuated(loop)
    assert abs(way.at(there)) == pytest.approx(math.sqrt(0.5), rel=1e-9)
    assert np.all(np.abs(way.at(np.geomspace(there / 1e3, 0.999 * there, 500))) > math.sqrt(0.5))
    assert abs(1.0 / (1.0 + loop.at(below))) == pytest.approx(math.sqrt(0.5), rel=1e-9)
    assert np.all(np.abs(1.0 + loop.at(np.geomspace(below / 1e3, 0.999 * below, 500))) > math.sqrt(2.0))


def test_stiffness_is_that_of_the_continuous_loop_where_the_period_is_short() -> None:
    """``|J s^2 + D s + Kt C(s)|`` without delay."""
    setup = load_stage(CONFIG / "ball-screw.yaml")
    p = setup.stage._replace(drive=setup.stage.drive._replace(current_lag=0.0, delay_samples=0))
    dt = 2e-5
    g = feedback.place_poles(p.mechanics, p.motor.force_constant, 40.0)
    loop = loops(p, g, dt)["loop"]
    s = 2j * math.pi * np.array([5.0, 20.0, 40.0, 80.0])
    acting = g.proportional + g.integral / s + g.derivative * s * g.pole / (s + g.pole)
    expected = np.abs(p.mechanics.inertia * s * s + p.mechanics.viscous * s + p.motor.force_constant * acting)
    np.testing.assert_allclose(stiffness(p, loop, s.imag / (2.0 * math.pi)), expected, rtol=0.01)
    least = softest(p, loop)
    around = stiffness(p, loop, least.frequency * np.array([0.99, 1.01]))
    assert np.all(around > least.value)
    assert around == pytest.approx(least.value, rel=1e-3)


def test_an_observer_is_in_the_loop() -> None:
    """``(C + M)/(1 + U)`` of `observer.transfer`; T of the target's way is ``C/(1 + U)`` of it."""
    setup = load_stage(CONFIG / "ball-screw.yaml")
    p, dt = setup.stage, setup.dt
    designed = design.gains(p, design.Control(dt, 20.0))
    watching = observer.designed(p, dt, 10.0)
    frequency = np.array([3.0, 20.0, 150.0])
    z = np.exp(2j * np.pi * frequency * dt)
    measured, current = observer.transfer(watching, z)
    moved, acting = design.plant(p, dt).at(z), design.compensator(designed, dt).at(z)
    open_loop = moved * (acting + measured) / (1.0 + current)
    loop, way = loops(p, designed, dt, watching)["loop"], following(p, designed, dt, watching)
    np.testing.assert_allclose(loop.at(frequency), open_loop, rtol=1e-6)
    np.testing.assert_allclose(way.at(frequency), moved * acting / (1.0 + current) / (1.0 + open_loop), rtol=1e-6)
    assert robustness(loop).phase < robustness(loops(p, designed, dt)["loop"]).phase
