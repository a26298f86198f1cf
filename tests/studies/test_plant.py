"""The integrator's order, effects that vanish, and mechanics against closed forms."""

import itertools

import numpy as np
import pytest
from stagectl_studies.machine import trials
from stagectl_studies.machine.battery import MM
from stagectl_studies.machine.contact import MEMORY
from stagectl_studies.machine.controller import designed, prepared
from stagectl_studies.machine.effects import ALIENS, EFFECTS, Around, Rig, applied, draw_of
from stagectl_studies.machine.machine import Base, Coupling, Machine, Motion
from stagectl_studies.machine.motion import derivative, midpoint
from stagectl_studies.machine.plant import Setting, Trace, ideal, noise_of, remanent, run_loop, silent, simulated
from stagectl_studies.machine.reference import joined, rest, sine, turned
from stagectl_studies.machine.stages import LAWS, believed, stage

REFERENCE = joined(0.0, [*turned(0.5 * MM, 0.1), sine(1.0 * MM, 5.0, 1.0), rest(0.1)])
AROUND = Around(300.0, 12.0, 45.0, 35.0, 31.4)
NEUTRAL = sorted(
    set(EFFECTS) - {"compliance", "backlash", "current_loop", "current_saturation", "voltage_saturation"}
)  # the others are there or not there; a spring without compliance has no stiffness to integrate


def moved(rig: Rig, setting: Setting = Setting(), noise: bool = False) -> Trace:  # noqa: B008
    model = believed(stage("maxwell", np.random.default_rng(3)), np.random.default_rng(1), 0.0)
    rows = prepared(model, rig.loop, REFERENCE, np.zeros(REFERENCE.size))
    silence = silent(REFERENCE.size)
    sound = noise_of(rig.machine, REFERENCE.size, np.random.default_rng(4)) if noise else silence
    return simulated(rig.machine, rig.loop, rows, sound, setting)


def rig_of(kind: str) -> Rig:
    machine = stage(kind, np.random.default_rng(3))
    model = believed(stage("maxwell", np.random.default_rng(3)), np.random.default_rng(1), 0.0)
    return Rig(machine, designed(model, 40.0))


@pytest.mark.parametrize("kind", LAWS)
def test_halving_the_step_changes_nothing(kind: str) -> None:
    """At 40 kHz the position is within 0.3 nm of table travel of the run at 80 kHz, and the error falls fourfold."""
    rig = rig_of(kind)
    rig = rig._replace(machine=ideal(rig.machine))
    runs = [moved(rig, Setting(substeps=n)).true_position for n in (10, 20, 40)]
    first, second = (float(np.abs(a - b).max()) for a, b in itertools.pairwise(runs))
    assert second < 1.5e-7
    assert 3.0 < first / second < 5.5


def test_second_order_without_contact() -> None:
    """Midpoint steps halved: the error falls fourfold on a damped body with cable and current."""
    machine = rig_of("maxwell").machine
    machine = machine._replace(body=machine.body._replace(coulomb=0.0))
    machine = machine._replace(forces=machine.forces._replace(cable=20.0))

    def end(n: int) -> float:
        m, friction = Motion(0.3, 0.0, *np.zeros(8)), (0.0, 0.0)
        memory, h = (np.zeros(MEMORY), np.zeros(MEMORY)), 0.2 / n
        for k in range(n):
            m, friction = midpoint(machine, m, memory, friction, (0.0, 0.0, 0.0), (k * h, h))
        return m.x

    w, r = np.sqrt(20.0 / machine.body.inertia), 0.5 * machine.body.viscous / machine.body.inertia
    wd = np.sqrt(w * w - r * r)
    exact = 0.3 * np.exp(-r * 0.2) * (np.cos(wd * 0.2) + r / wd * np.sin(wd * 0.2))
    coarse, fine = abs(end(1600) - exact), abs(end(3200) - exact)
    assert 3.7 < coarse / fine < 4.1 and fine < 1e-6


@pytest.mark.parametrize("name", NEUTRAL)
def test_an_effect_of_no_size_is_absent_to_the_last_bit(name: str) -> None:
    plain = rig_of("maxwell")
    nothing = applied(name, plain, draw_of(name, 5, 0.0, AROUND))
    a, b = moved(plain, noise=True), moved(nothing, noise=True)
    for field, other in zip(a[:5], b[:5], strict=True):
        assert np.array_equal(field, other)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_an_effect_of_typical_size_is_there(name: str) -> None:
    """Each effect changes the record, by more than rounding."""
    plain = rig_of("maxwell")
    if name == "friction_lag":
        plain = applied("stribeck", plain, draw_of("stribeck", 5, 2.0, AROUND))
    peak = float(np.abs(moved(plain).command).max())
    around = AROUND._replace(peak_current=peak, peak_voltage=1.1 * peak, session=1.0)
    changed = applied(name, plain, draw_of(name, 5, 1.0, around))
    a, b = moved(plain), moved(changed, noise=name == "jitter")
    assert not b.lost
    assert float(np.abs(a.current - b.current).max()) > 1e-3


def test_level_one_is_the_same_as_limit_and_as_scale() -> None:
    rig = rig_of("maxwell")
    other = rig._replace(machine=rig.machine._replace(speed=rig.machine.speed._replace(limits=True)))
    assert np.array_equal(moved(rig).position, moved(other).position)


def test_one_compiled_signature() -> None:
    for name in sorted(EFFECTS):
        moved(applied(name, rig_of("maxwell"), draw_of(name, 5, 0.0 if name in NEUTRAL else 1.0, AROUND)))
    assert len(run_loop.signatures) == 1  # type: ignore[attr-defined]


def eigenfrequencies(machine: Machine, states: tuple[str, ...]) -> list[float]:
    """Natural frequencies of the linear motion without contact, Hz, by difference quotients of its derivative."""
    zero = Motion(*np.zeros(10))
    columns = []
    for state in states:
        d = derivative(machine, zero._replace(**{state: 1e-3}), 0.0, (0.0, 0.0))
        columns.append([getattr(d, other) / 1e-3 for other in states])
    roots = np.linalg.eigvals(np.array(columns).T)
    return sorted({round(float(abs(root)) / (2.0 * np.pi), 6) for root in roots if root.imag > 1e-3})


def test_resonance_of_a_load_behind_a_spring() -> None:
    """w^2 = k (1/Jm + 1/Jl)."""
    machine = rig_of("maxwell").machine
    j, share, k = machine.body.inertia, 0.3, 800.0
    machine = machine._replace(coupling=Coupling(share=share, stiffness=k))
    frequencies = eigenfrequencies(machine, ("x", "v", "load", "load_speed"))
    wanted = np.sqrt(k * (1.0 / (j * share) + 1.0 / (j * (1.0 - share)))) / (2.0 * np.pi)
    assert frequencies == pytest.approx([wanted], rel=1e-6)


def test_two_bodies_hold_no_momentum_of_their_own() -> None:
    """Without outer torque the total momentum of motor and loads stays."""
    machine = rig_of("maxwell").machine
    coupling = Coupling(0.3, 500.0, 0.0, 0.2, 0.001, 0.0, 0.1, 200.0, 0.05)
    machine = machine._replace(coupling=coupling)
    motion = Motion(0.01, 1.0, -0.02, 2.0, 0.005, -1.0, 0.0, 0.0, 0.0, 0.0)
    d = derivative(machine, motion, 0.0, (0.0, 0.0))
    assert 0.6 * d.v + 0.3 * d.load_speed + 0.1 * d.second_speed == pytest.approx(0.0, abs=1e-9)


def test_the_base_rings_at_its_own_frequency() -> None:
    machine = rig_of("maxwell").machine._replace(base=Base(0.05, 2.0 * np.pi * 20.0, 0.0))
    assert eigenfrequencies(machine, ("base", "base_speed")) == pytest.approx([20.0], rel=1e-6)


def test_remanence_holds_no_torque() -> None:
    machine = rig_of("maxwell").machine
    z = remanent(machine, 1.0)[: machine.law.weights.size]
    assert float(machine.law.weights @ z) == pytest.approx(0.0, abs=1e-9) and float(np.abs(z).max()) > 0.3


LISTED = {
    *("inertia", "force_constant", "viscous", "viscous_nonlinear", "coulomb", "coulomb_asymmetry"),
    *("viscous_asymmetry", "stribeck", "presliding", "dwell", "friction_lag", "load_friction", "position_friction"),
    *("lead_friction", "cogging", "current_ripple", "ball_pass_ripple", "encoder_eccentricity"),
    *("encoder_interpolation", "current_quantisation", "dead_time", "jitter", "current_loop", "current_saturation"),
    *("voltage_saturation", "current_gain", "current_offset", "bias", "cable_spring", "cable_hysteresis"),
    *("thermal_viscous", "thermal_coulomb", "friction_step", "backlash", "compliance", "base_vibration"),
    *("time_shift", "controller"),
}


def test_the_table_is_the_list() -> None:
    assert set(EFFECTS) == LISTED and len(ALIENS) == 6 and not set(ALIENS) & set(EFFECTS)
    assert {"null-exact", "poor", "alien"} < set(trials.STRATA)
