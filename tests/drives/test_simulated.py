"""The stage model behind the drive protocol: power, stops either way, and noise that repeats."""

from __future__ import annotations

import pytest

from stagectl.drives.drive import Fault, Power, Simulation
from stagectl.drives.simulated import Plant, Simulated, draw
from stagectl.kernels.effects import Warming
from stagectl.kernels.plant import Dwell
from tests.drives.workbench import DT, linear_stage


def plant(**simulation: float) -> Plant:
    return Plant(linear_stage(), Simulation(substeps=4)._replace(**simulation), DT)  # type: ignore[arg-type]


def test_without_power_no_command_acts() -> None:
    p = linear_stage()
    dead = Plant(p._replace(drive=p.drive._replace(delay_samples=2)), Simulation(substeps=4), DT)
    for _ in range(20):
        dead.advance(5.0)
    dead.powered = True
    for _ in range(20):
        dead.advance(0.0)  # nor later, out of the delay line
    assert (dead.state.position, dead.state.current) == (0.0, 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_without_power_friction_stops_the_axis(sign: float) -> None:
    drive = Simulated(plant())
    drive.ask(Power.ON)
    for _ in range(60):
        drive.apply(sign)
    speed, began = drive.plant.state.velocity, drive.plant.state.position
    assert speed * sign > 0.2
    drive.ask(Power.QUICK_STOP)
    for _ in range(round(10.0 / DT)):
        drive.apply(sign)  # no current flows
    now = drive.sample()
    assert now.fault is Fault.DRIVE_FAULT  # it has no power any more, and says so
    # friction alone: 5 N and 5 N s/m against 10 kg
    assert (now.position - began) * sign == pytest.approx(speed**2 / (2 * 0.5), rel=0.2)
    assert abs(drive.plant.state.velocity) < 1e-3


def test_the_noise_has_its_own_sizes_and_repeats() -> None:
    settings = Simulation(current_noise=2.0, encoder_noise=1e-6, seed=5)
    current, position, _ = zip(*draw(settings, 4000), strict=True)
    for values, rms in ((current, 2.0), (position, 1e-6)):
        assert sum(v * v for v in values) / 4000 == pytest.approx(rms**2, rel=0.1)
    entry, other = (Plant(linear_stage(), settings, DT) for _ in range(2))
    for item in (entry, other):
        item.powered = True
        item.hear()
        for _ in range(50):
            item.advance(0.1)
    assert entry.state.position == other.state.position
    assert entry.position == other.position


def test_a_running_plant_hears_what_simulate_hears() -> None:
    settings = Simulation(current_noise=2.0, encoder_noise=1e-6, seed=5)
    drive, heard = Simulated(Plant(linear_stage(), settings, DT)), []
    drive.ask(Power.ON)
    drive.sample()
    for _ in range(5):
        heard.append(drive.plant._current_noise())
        drive.apply(0.0)
    assert heard == draw(settings, 5)


def test_a_machine_is_cold_until_it_first_gets_power() -> None:
    """What goes by the clock begins as in `simulate`, however long the machine has waited."""
    p = linear_stage()
    p = p._replace(friction=p.friction._replace(dwell=Dwell(0.1, 0.1), warming=Warming(0.3, 10.0)))
    drive = Simulated(Plant(p, Simulation(substeps=4), DT))
    for _ in range(100):
        drive.apply(0.0)
    for _ in range(2):  # power that comes again finds it warm
        drive.ask(Power.ON)
        drive.sample()
        began = drive.plant.state.memory
        drive.apply(0.0)
    assert (began.time, began.rested) == (DT, DT)
