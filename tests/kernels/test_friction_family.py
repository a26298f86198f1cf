"""The friction family against closed forms, the laws of thermodynamics, and each other."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from stagectl.kernels import friction, friction_bristle, friction_memory, friction_path, stage
from stagectl.kernels.friction_bristle import Bristle
from stagectl.kernels.friction_memory import Rheology, Table
from stagectl.kernels.jit import table
from tests.conftest import ROOT, SOURCES

Array = NDArray[np.float64]
COULOMB, STIFFNESS, DT = 2.0, 2e5, 1e-4  # N, N/m: a bristle of 10 um; s
STRIBECK = friction.Stribeck(0.4, 0.02, 2.0)
DAHL, LUGRE = Bristle(COULOMB, STIFFNESS), Bristle(COULOMB, STIFFNESS, 1.0, 50.0, STRIBECK)
TABLE = Table(table([0.0, 2e-6, 6e-6, 2e-5]), table([-COULOMB, -0.5, 1.0, COULOMB]))
RHEOLOGY = Rheology(COULOMB, 2e-5, 1.7, 1e4, 0.05)
GMS = friction.Gms(friction.bundle([0.8, 0.7, 0.5], [1e-6, 4e-6, 9e-6]), STRIBECK)


def dahl_force(moves: list[float], p: Bristle = DAHL, speed: float = 0.01) -> list[float]:
    x, forces = 0.0, []
    for dx in moves:
        force, x = friction_bristle.bent(p, x, math.copysign(speed, dx), dx, abs(dx) / speed)
        forces.append(force)
    return forces


def law(run: Callable[[Array, Array], None]) -> Callable[[Array], Array]:
    def forces(path: Array) -> Array:
        out = np.empty(len(path))
        run(path, out)
        return out

    return forces


def bristle(p: Bristle) -> Callable[[Array], Array]:
    def forces(path: Array) -> Array:
        out = np.empty((len(path), 2))
        friction_path.bristle(p, path, DT, out)
        return np.asarray(out[:, 0] + p.damping * out[:, 1])

    return forces


def gms(path: Array) -> Array:
    out = np.empty((len(path), 3))
    friction_path.operators(GMS, path, DT, out)
    return np.asarray(out @ np.asarray(GMS.operators.weight))


def rheology(path: Array) -> Array:
    out = np.empty((len(path), 2))
    friction_path.rheology(RHEOLOGY, path, DT, out)
    return np.asarray(out.sum(axis=1))


LAWS: dict[str, Callable[[Array], Array]] = {
    "dahl": bristle(DAHL),
    "dahl-exponent": bristle(DAHL._replace(exponent=1.6)),
    "lugre": bristle(LUGRE),
    "gms": gms,
    "rheology": rheology,
    "table": law(lambda x, out: friction_path.table(TABLE, x, out)),
    "table-continued": law(lambda x, out: friction_path.table(TABLE._replace(continues=True), x, out)),
}


def wandering(seed: int, count: int = 4000, scale: float = 2e-6) -> Array:
    """A random path (m), smooth at the step, that comes back over itself."""
    steps = np.random.default_rng(seed).normal(0.0, scale, count)
    walk = np.cumsum(np.convolve(steps, np.ones(20) / 20, mode="same"))
    return np.asarray(walk - walk[0])


@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_dahl_is_its_exponential_however_the_way_is_cut(cut: int) -> None:
    """``F = T_c (1 - exp(-sigma x / T_c))`` from rest, and from a full reversal twice of it: P. R. Dahl, 1968."""
    way = 15e-6
    assert dahl_force([way / cut] * cut)[-1] == pytest.approx(
        COULOMB * -math.expm1(-STIFFNESS * way / COULOMB), rel=1e-12
    )
    reversed_ = dahl_force([-1.0, *[way / cut] * cut])[-1]
    assert reversed_ == pytest.approx(COULOMB * (1.0 - 2.0 * math.exp(-STIFFNESS * way / COULOMB)), rel=1e-9)


@pytest.mark.parametrize("exponent", [0.5, 1.25, 2.0, 3.0])
def test_dahl_with_an_exponent_is_its_power_law(exponent: float) -> None:
    """``w^(1 - n) = 1 + (n - 1) sigma x / T_c`` with w = 1 - F / T_c; below 1 it arrives after a finite way."""
    p = DAHL._replace(exponent=exponent)
    for way in (3e-6, 12e-6, 25e-6):
        left = max(1.0 + (exponent - 1.0) * STIFFNESS * way / COULOMB, 0.0)
        expected = COULOMB * (1.0 - (left ** (1.0 / (1.0 - exponent)) if left else 0.0))
        assert dahl_force([way / 40] * 40, p)[-1] == pytest.approx(expected, rel=1e-12)
    assert dahl_force([1e-3], p._replace(exponent=0.5))[-1] == COULOMB


def test_the_exponents_limit_of_one_is_the_exponential() -> None:
    near = dahl_force([1e-6] * 30, DAHL._replace(exponent=1.0 + 1e-12))
    assert near == pytest.approx(dahl_force([1e-6] * 30), rel=1e-9)


@pytest.mark.parametrize("speed", [1e-3, 0.02, 0.3, -0.05])
def test_lugre_ends_on_stribecks_curve(speed: float) -> None:
    """Steady state: ``F = sgn(v) (T_c + (T_s - T_c) exp(-(v / v_s)^2))``; the micro-damping has died out."""
    x, force = 0.0, 0.0
    for _ in range(3000):
        force, x = friction_bristle.bent(LUGRE, x, speed, math.copysign(1e-6, speed), 1e-6 / abs(speed))
    steady = COULOMB * (1.0 + 0.4 * math.exp(-((speed / 0.02) ** 2)))
    assert force == pytest.approx(math.copysign(steady, speed), rel=1e-9)


def break_away(pulling: float, h: float = 2e-5) -> float:
    """Largest force (N) of a spring of 10 kN/m that pulls a kilogram at this speed (m/s) over 0.32 mm: 3.2 N."""
    p, z = LUGRE._replace(damping=500.0), 0.0
    x, v, force, most = 0.0, 0.0, 0.0, 0.0
    for k in range(round(3.2e-4 / (pulling * h))):
        pull = 1e4 * (pulling * h * k - x)
        most = max(most, pull)
        v += h * (pull - force)
        x += h * v
        force, z = friction_bristle.bent(p, z, v, h * v, h)
    return most


def test_lugre_breaks_away_just_below_the_static_friction_and_not_at_coulombs() -> None:
    """C. Canudas de Wit and others, 1995, section III.C: it creeps before it slides, so T_s is not quite reached."""
    assert 0.93 * 1.4 * COULOMB < break_away(1e-4) < 1.4 * COULOMB


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("seed", [1, 2])
def test_odd(name: str, seed: int) -> None:
    path = wandering(seed)
    np.testing.assert_array_equal(LAWS[name](-path), -LAWS[name](path))


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize(("seed", "scale"), [(1, 3e-7), (2, 2e-6), (3, 1e-5)])
def test_a_closed_path_gives_no_energy(name: str, seed: int, scale: float) -> None:
    """Over the same closed path again: the state is periodic from the second time on, and friction only takes.

    But for the plain table, which jumps to +-T_c at a partial reversal: inside its range it is no passive law.
    """
    work = periodic_work(name, wandering(seed, 1500, scale))
    assert work < 0.0 if name == "table" and scale < 1e-6 else work > 0.0


def periodic_work(name: str, there: Array) -> float:
    """Work (J) of the last two laps of three, there and back."""
    loop = np.concatenate([there, there[::-1]])
    laps = np.tile(loop, 3)
    force = LAWS[name](laps)
    work = np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(laps))
    return float(work[-1] - work[len(loop) - 1])


@pytest.mark.parametrize("reach", [0.5, 8.0])
def test_gms_gives_no_energy_to_a_lap_that_is_fast_out_and_slow_back(reach: float) -> None:
    """A stuck element is a spring: a lap within its slip costs nothing at any speeds, one beyond it costs energy."""
    way = reach * GMS.operators.slip[0]
    out, back = np.linspace(0.0, way, 50), np.linspace(way, 0.0, 2500)[1:]
    x = np.concatenate([out, back, out[1:], back])
    work = np.cumsum(0.5 * (gms(x)[1:] + gms(x)[:-1]) * np.diff(x))
    lap = float(work[-1] - work[len(out) + len(back) - 2])
    assert lap == pytest.approx(0.0, abs=1e-16) if reach < 1.0 else lap > 1e-7


def passive_below(p: Bristle) -> float:
    """Speed up to which it never gives out energy, ``T_c u^2 / ((u - 1) sigma_1)`` (rad/s | m/s); else inf.

    The least over u up to 1 + rise: with the rise itself, or with 1 where that is larger.
    """
    rise = min(p.stribeck.rise, 1.0)
    if p.damping == 0.0 or rise == 0.0:
        return math.inf
    return p.coulomb * (1.0 + rise) * (1.0 + rise) / (rise * p.damping)


def test_lugre_is_passive_where_the_condition_says_so() -> None:
    """Below its speed it never gives back more than the bristle had stored; without a rise at no speed."""
    assert passive_below(DAHL._replace(stribeck=STRIBECK)) == math.inf
    assert passive_below(LUGRE) == pytest.approx(COULOMB * 1.4**2 / (0.4 * 50.0))
    assert passive_below(LUGRE._replace(stribeck=friction.Stribeck(3.0))) == 4.0 * COULOMB / 50.0
    bare = LUGRE._replace(stribeck=friction.Stribeck())
    assert passive_below(bare) == math.inf
    assert np.abs(np.diff(wandering(5, 6000, 4e-6))).max() / DT < passive_below(LUGRE)
    for p, scale in ((LUGRE, 4e-6), (bare, 4e-6), (bare, 4e-3)):
        _never_gives(p, wandering(5, 6000, scale))


@pytest.mark.parametrize(("share", "gives"), [(0.9, False), (1.2, True)])
def test_lugre_gives_out_energy_just_above_that_speed(share: float, gives: bool) -> None:
    """The first instant of fast motion after slow motion: the bristle still carries the static friction."""
    v = share * passive_below(LUGRE)
    z = 1.4 * COULOMB / STIFFNESS
    h = 1e-9
    force, after = friction_bristle.bent(LUGRE, z, v, v * h, h)
    assert (force * v * h < 0.5 * STIFFNESS * (after * after - z * z)) is gives


def _never_gives(p: Bristle, path: Array) -> None:
    """The work taken, less what the bristle stores, never falls."""
    out = np.empty((len(path), 2))
    friction_path.bristle(p, path, DT, out)
    force, stored = out[:, 0] + p.damping * out[:, 1], 0.5 * out[:, 0] ** 2 / STIFFNESS
    taken = np.cumsum(force[1:] * np.diff(path)) - stored[1:]
    assert np.all(np.diff(taken) >= -1e-12)


def test_gms_without_stribeck_is_the_bundle_bit_for_bit() -> None:
    path = wandering(7)
    p, s, out = GMS._replace(stribeck=friction.Stribeck()), friction.relaxed(GMS.operators), np.empty(501)
    friction_path.gms(p, friction.relaxed(p.operators), path[:501], DT, out)
    assert out[1:].tolist() == [friction.stops(p.operators, s, dx) for dx in np.diff(path)[:500].tolist()]


def test_the_columns_of_a_bundle_are_the_bundle() -> None:
    path = wandering(8)
    expected = np.empty(len(path))
    friction_path.gms(GMS, friction.relaxed(GMS.operators), path, DT, expected)
    np.testing.assert_allclose(gms(path), expected, rtol=0.0, atol=1e-14)


def test_the_table_is_itself_after_a_full_reversal_and_half_of_it_from_rest() -> None:
    """Masing's rule, there and back; what is beyond the last row stays."""
    s = np.arange(0.0, 3e-5, 1e-7)
    rest = LAWS["table"](s)
    nodes = np.array([0.0, 1e-6, 3e-6, 1e-5])
    np.testing.assert_allclose(rest, np.interp(s, nodes, [0.0, 0.75, 1.5, 2.0]), atol=1e-12)
    back = LAWS["table"](np.concatenate([s, s[-2::-1]]))[len(s) :]
    expected = np.interp(1e-7 * np.arange(1, len(s)), np.asarray(TABLE.displacement), np.asarray(TABLE.force))
    np.testing.assert_allclose(back, -expected, atol=1e-9)


def test_a_stop_and_a_restart_in_the_same_direction_change_nothing() -> None:
    path = np.concatenate([np.linspace(0.0, 3e-6, 30), np.full(50, 3e-6), np.linspace(3e-6, 8e-6, 50)[1:]])
    moving = np.concatenate([path[:30], path[80:]])
    for name in ("dahl", "gms", "table"):
        np.testing.assert_allclose(LAWS[name](path)[80:], LAWS[name](moving)[30:], rtol=1e-12)


@pytest.mark.parametrize("exponent", [1.3, 2.0, 2.0000001, 3.5])
def test_the_rheology_spring_starts_at_zero_and_arrives_level(exponent: float) -> None:
    """g(0) = 0, g(1) = 1, g'(1) = 0; and for n = 2 the known curve xi (1 - ln xi)."""
    p = Rheology(COULOMB, 2e-5, exponent)
    x, forces = friction_memory.CREEP, []
    for _ in range(200):
        force, x = friction_memory.rheology(p, x, 1e-3, 1e-7, DT)
        forces.append(force)
    assert bool(np.all(np.diff(forces[:99]) > 0.0))
    assert forces[99:] == pytest.approx([COULOMB] * 101, rel=1e-9)
    assert forces[99] - forces[97] < 0.001 * COULOMB
    if abs(exponent - 2.0) < 1e-3:
        assert forces[24] == pytest.approx(COULOMB * 0.25 * (1.0 - math.log(0.25)), rel=1e-6)


def test_a_branch_of_the_rheology_spring_begins_where_the_last_one_ended() -> None:
    """A partial reversal from half the range: ``F = F_0 - 2 T_c g(s / range)``, with g = xi (1 - ln xi), n = 2."""
    p, x = Rheology(COULOMB, 2e-5, 2.0), friction_memory.CREEP
    start, x = friction_memory.rheology(p, x, 1e-3, 5e-6, DT)
    assert start == pytest.approx(COULOMB * 0.5 * (1.0 - math.log(0.5)))
    for s in (1e-6, 2e-6, 3e-6):
        force, x = friction_memory.rheology(p, x, -1e-3, -1e-6, DT)
        xi = s / 2e-5
        assert force == pytest.approx(start - 2.0 * COULOMB * xi * (1.0 - math.log(xi)))


def test_the_creeping_spring_relaxes_with_its_time_constant() -> None:
    """After a move of T it is k v tau (1 - exp(-T / tau)), and then decays: a spring and a dashpot in series."""
    moved, x = RHEOLOGY, friction_memory.CREEP
    for _ in range(100):
        _, x = friction_memory.rheology(moved, x, 1e-2, 1e-6, DT)
    assert x.relaxing == pytest.approx(1e4 * 1e-2 * 0.05 * -math.expm1(-100 * DT / 0.05), rel=1e-12)
    before = x.relaxing
    for _ in range(500):
        _, x = friction_memory.rheology(moved, x, 0.0, 0.0, DT)
    assert x.relaxing == pytest.approx(before * math.exp(-500 * DT / 0.05), rel=1e-12)


@settings(max_examples=30)
@given(st.lists(st.floats(-3e-5, 3e-5), min_size=1, max_size=40), st.floats(0.3, 3.0))
def test_never_beyond_coulomb(moves: list[float], exponent: float) -> None:
    p = DAHL._replace(exponent=exponent)
    assert max(abs(f) for f in dahl_force(moves, p)) <= COULOMB * (1.0 + 1e-12)


def plant(friction_: stage.Friction, bias: float = 0.0) -> stage.Stage:
    return stage.Stage(
        stage.Drive(0.0, 0, 100.0, 0.0),
        stage.Motor(1.0),
        stage.Mechanics(1.0, 0.0, bias),
        friction_,
        stage.Encoder(0.0, 0),
    )


NOTHING = friction.bundle([0.0], [1.0])


def pushed(p: stage.Stage, current: float, periods: int, substeps: int = 10) -> stage.State:
    x = stage.at_rest(p)
    for _ in range(periods):
        x = stage.period(p, x, current, stage.SILENT, 1e-3, substeps)
    return x


def test_the_plant_with_a_bristle_sticks_below_the_static_friction_and_slides_above() -> None:
    """Held at 90 % it stands where ``sigma_0 z`` carries the load; above T_s it runs with (u - T_c) / M."""
    p = plant(stage.Friction(NOTHING, friction.Stribeck(), LUGRE._replace(damping=800.0)))
    stuck = pushed(p, 0.9 * COULOMB, 400)
    assert abs(stuck.velocity) < 1e-6
    assert STIFFNESS * stuck.bristle == pytest.approx(0.9 * COULOMB, rel=1e-3)
    assert pushed(p, 2.0 * COULOMB, 500).velocity == pytest.approx(0.5 * COULOMB, rel=0.02)


def test_the_plant_rings_at_the_bristles_frequency() -> None:
    """Far inside presliding Dahl is a spring: omega = sqrt(sigma_0 / M)."""
    p = plant(stage.Friction(NOTHING, friction.Stribeck(), DAHL))
    x, crossings, last = stage.at_rest(p), [], 0.0
    for k in range(200):
        x = stage.period(p, x, 1e-3 * COULOMB, stage.SILENT, 1e-3, 20)
        if last < 0.0 <= x.velocity:
            crossings.append(k - x.velocity / (x.velocity - last))
        last = x.velocity
    period = 1e-3 * float(np.mean(np.diff(crossings)))
    assert 2.0 * math.pi / period == pytest.approx(math.sqrt(STIFFNESS), rel=0.01)


def test_the_bristle_carries_the_bias_at_rest() -> None:
    p = plant(stage.Friction(NOTHING, friction.Stribeck(), DAHL._replace(damping=300.0)), bias=-1.2)
    x = stage.at_rest(p, 0.3)
    assert (x.force, x.velocity) == (pytest.approx(-1.2), 0.0)
    assert abs(pushed(p, 0.0, 200).position) < 1e-7


def test_a_neutral_bristle_is_absent_bit_for_bit() -> None:
    """Whatever its other parameters."""
    operators = friction.bundle([0.5, 0.5], [1e-6, 9e-6])
    bare = stage.Friction(operators, STRIBECK)
    neutral = bare._replace(bristle=Bristle(0.0, 3e7, 1.7, 9.0, STRIBECK))
    a, b = pushed(plant(bare, 0.1), 1.5, 50), pushed(plant(neutral, 0.1), 1.5, 50)
    assert (a.position, a.velocity, a.force) == (b.position, b.velocity, b.force)


SCRIPT = """
import hashlib
import numpy as np
from stagectl.kernels import jit
from tests.kernels.test_friction_family import LAWS, wandering
print(hashlib.sha256(b"".join(LAWS[name](wandering(11, 600)).tobytes() for name in sorted(LAWS))).hexdigest())
"""


def test_compiled_and_interpreted_give_the_same_bits() -> None:
    environment = {**os.environ, "STAGECTL_KERNELS": "interpreted", "PYTHONPATH": SOURCES}
    command = [sys.executable, "-c", SCRIPT]
    run = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True)
    ours: Any = hashlib.sha256(b"".join(LAWS[name](wandering(11, 600)).tobytes() for name in sorted(LAWS)))
    assert run.stdout.strip() == ours.hexdigest()
