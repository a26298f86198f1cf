"""Motor and load with a friction of their own, and the drag of a cable, against their equations solved by SciPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stagectl.kernels import friction_bristle, inverse, stage
from stagectl.kernels.plant import Cable, Transmission
from stagectl.kernels.plant_with_effects import Path, pulled_along
from tests.kernels.test_effects import DT, KT, D, J, frictional, mechanics, plant

Array = NDArray[np.float64]
SHARE, AT_LOAD, RESONANCE, DAMPING, GAP = 0.35, 0.4, 300.0, 0.1, 2e-3
TC, ZONE = 0.9, 3e-3
LOAD, MOTOR = SHARE * J, (1.0 - SHARE) * J
REDUCED, TURNING = LOAD * MOTOR / J, 2.0 * math.pi * RESONANCE
SPRING, DAMPER = REDUCED * TURNING**2, 2.0 * DAMPING * REDUCED * TURNING


def backlashed(at_load: float = AT_LOAD) -> stage.Stage:
    law = friction_bristle.Bristle(TC, TC / ZONE, 1.0)
    p = frictional(plant(D), bristle=law)
    return mechanics(p, transmission=Transmission(SHARE, RESONANCE, DAMPING, GAP, at_load))


def current(time: float) -> float:
    return 2.4 * math.sin(2.0 * math.pi * 8.0 * time)


def equations(time: float, x: Array, at_load: float) -> list[float]:
    """Dahl's law at each body, and a contact that only pushes."""
    motor, load, motor_speed, load_speed, motor_bristle, load_bristle = x
    wound = motor - load
    depth = wound - min(max(wound, -0.5 * GAP), 0.5 * GAP)
    pushed = SPRING * depth + DAMPER * (motor_speed - load_speed) if depth else 0.0
    pushed = pushed if pushed * depth > 0.0 else 0.0
    held = KT * current(DT * math.floor(time / DT + 1e-9))
    frictions = [TC / ZONE * z + D * v for z, v in ((motor_bristle, motor_speed), (load_bristle, load_speed))]
    bending = [v - abs(v) * z / ZONE for z, v in ((motor_bristle, motor_speed), (load_bristle, load_speed))]
    acceleration = (held - pushed - (1.0 - at_load) * frictions[0]) / MOTOR
    return [motor_speed, load_speed, acceleration, (pushed - at_load * frictions[1]) / LOAD, *bending]


def solved(periods: int, at_load: float) -> Array:
    """Positions (periods, 2) of motor and load at the end of each control period, whose current is held."""
    x, ends = np.zeros(6), []
    for k in range(periods):
        span = (k * DT, (k + 1) * DT)
        step = solve_ivp(equations, span, x, "DOP853", args=(at_load,), rtol=1e-9, atol=1e-12, max_step=DT / 8)
        x = step.y[:, -1]
        ends.append(x[:2])
    return np.array(ends)


def driven(p: stage.Stage, periods: int, substeps: int) -> Array:
    x, ends = stage.at_rest(p), []
    for k in range(periods):
        x = stage.period(p, x, current(k * DT), stage.SILENT, DT, substeps)
        ends.append((x.position, x.memory.load))
    return np.array(ends)


@pytest.mark.parametrize("at_load", [0.0, AT_LOAD, 1.0])
def test_motor_and_load_have_a_friction_of_their_own(at_load: float) -> None:
    """Impacts at both ends of the gap; the error falls as the step does."""
    exact, p = solved(300, at_load), backlashed(at_load)
    coarse, fine = (float(np.abs(driven(p, 300, substeps) - exact).max()) for substeps in (10, 40))
    assert np.ptp(exact[:, 0] - exact[:, 1]) > 0.95 * GAP
    assert fine < 0.5 * coarse
    assert fine < 2e-3 * np.ptp(exact)


@pytest.mark.parametrize("bristled", [True, False])
def test_the_load_rests_on_its_own_friction_while_the_motor_crosses_the_gap(bristled: bool) -> None:
    """The motor's bristle, or stop operators, are wound; those of the load are not."""
    p = backlashed() if bristled else mechanics(plant(D, TC), transmission=backlashed().mechanics.transmission)
    x = stage.at_rest(p)._replace(velocity=0.02)
    for _ in range(4):
        x = stage.period(p, x, 0.0, stage.SILENT, DT, 10)
    assert 0.0 < x.position < 0.5 * GAP and x.force > 0.0
    assert x.memory.load == 0.0 and x.memory.behind.force == 0.0
    assert bristled or (x.stops[0] > 0.0 and x.memory.stops[0] == 0.0)


def test_the_inverse_of_two_frictions_gives_the_current_back() -> None:
    """A spring without a gap: forth along the motor's motion, and the current is that which made it."""
    p = backlashed()
    p = mechanics(p, transmission=p.mechanics.transmission._replace(backlash=0.0))
    x, h, rows = stage.at_rest(p), DT / 40.0, []
    for k in range(400):
        for _ in range(40):
            x = stage.drifted(p, stage.commanded(p.drive, x, current(k * DT)), stage.SILENT, h, 1)
            rows.append((x.position, x.velocity))
    position, velocity = np.array(rows).T
    motion = np.column_stack([position, velocity, np.gradient(velocity, h)])
    out = np.empty(len(motion))
    inverse.along(p, stage.at_rest(p), motion, h, out)
    asked = np.repeat([current(k * DT) for k in range(400)], 40)
    smooth = np.abs(np.gradient(asked)) == 0.0
    assert np.median(np.abs(out - asked)[smooth]) < 0.01
    assert np.percentile(np.abs(out - asked)[smooth], 99) < 0.1


@pytest.mark.parametrize("exponent", [0.0, 1e-3, 0.3, 1.0, 1.7])
def test_a_cable_drags_by_dahls_law(exponent: float) -> None:
    """Against its equation, and the same in one step as in many."""
    cable = Cable(0.0, 0.0, 0.4, 0.1, exponent)
    whole = parts = Path(0.2, 0.0, 0.0, 0.0)
    for way in (0.06, -0.15, 0.02):
        exact = _dragged(whole.cable, way, exponent)
        whole = pulled_along(whole, cable, way)
        for _ in range(50):
            parts = pulled_along(parts, cable, way / 50)
        assert whole.cable == pytest.approx(exact, abs=2e-3 if 0.0 < exponent < 1.0 else 1e-6)
        assert parts.cable == pytest.approx(whole.cable, abs=1e-9)


def _dragged(element: float, way: float, exponent: float) -> float:
    side = math.copysign(1.0, way)

    def slope(_: float, s: Array) -> Array:
        left = np.maximum(1.0 - side * s, 0.0)
        return side * np.where(left > 0.0, left**exponent, 0.0) / 0.1

    solved = solve_ivp(slope, (0.0, abs(way)), [element], rtol=1e-9, max_step=1e-3)
    return float(solved.y[0, -1])
